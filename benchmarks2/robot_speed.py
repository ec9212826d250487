"""Shots per second on the virtual robot, against the first edition.

Each edition runs in a process of its own; the two alternate, and medians of the pairs are compared:
`python benchmarks2/robot_speed.py`. The records of shared/second_edition/reference/infantry, eight cells with 12
engagements each, classical controllers with settings of their own for both editions. The goal is at least 1.0 of the
first edition's figures. The machine should do nothing else. Writes results/robot_speed.json.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import alternating

ROOT = Path(__file__).parents[1]
RECORDS = ROOT.parent / "shared" / "second_edition" / "reference" / "infantry"
SETTINGS = {"kalman": 2.0, "kalman-lq": 2.0, "imm-lq": 4.0, "parabola-lq": 0.0, "oracle": None}
"""Controller → standard deviation of the acceleration that its filter assumes [m/s²]; None of the oracle."""
ENGAGEMENTS = 12


def first_edition() -> dict[str, Callable[[], int]]:
    """Return what is measured of the first edition: name → a function that returns how many shots."""
    from archerfish.cli.evaluation_run import EvaluationTask, classical_entrant, make_ground
    from archerfish.cli.setting import SettingFiles, load_setting
    from archerfish.controllers.roster import Tuning
    from archerfish.evaluation.trial import fight

    parts = ("pitch", "yaw", "muzzle", "sensing", "limits")
    files: dict[str, Any] = {part: RECORDS / f"{part}.json" for part in parts}
    setting = load_setting(SettingFiles(**files, robot="infantry"))
    tuning = {name: Tuning(acceleration_sd=sd) for name, sd in SETTINGS.items() if sd is not None}
    task = EvaluationTask(setting, "gate", ENGAGEMENTS, 0, robot="infantry", tuning=tuning)
    ground = make_ground(task)

    def evaluation(name: str) -> Callable[[], int]:
        controller = classical_entrant(task, name).controller
        return lambda: fight(ground.world, controller, ground.trials).hits(0.06).size

    return {name: evaluation(name) for name in SETTINGS}


def second_edition() -> dict[str, Callable[[], int]]:
    """Return the same of the second edition."""
    from archerfish2.compiled import import_jax
    from archerfish2.controllers.registry import make_controller
    from archerfish2.controllers.tuning import Tuning
    from archerfish2.evaluation.draws import draw
    from archerfish2.evaluation.run import count
    from archerfish2.robot import Robot
    from archerfish2.task import Task
    from archerfish2.virtual_robot.virtual_robot import VirtualRobot

    import_jax()
    robot, task = Robot.load(ROOT / "tests2" / "infantry"), Task.load("paper")
    world = VirtualRobot.load("infantry").world(robot, task)
    drawn = draw(task.cells(), ENGAGEMENTS, 0, "evaluation", world.normals, world.plants)

    def evaluation(name: str) -> Callable[[], int]:
        sd = SETTINGS[name]
        controller = make_controller(name, robot, task, None if sd is None else Tuning(acceleration_sd=sd))
        return lambda: count(world, controller, *drawn).hit.size

    return {name: evaluation(name) for name in SETTINGS}


if __name__ == "__main__":
    alternating.run(__doc__, __file__, {"first": first_edition, "second": second_edition}, tuple(SETTINGS), pairs=5)
