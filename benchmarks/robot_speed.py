"""Shots per second on the virtual robot.

`python benchmarks/robot_speed.py [--against REVISION]`: the infantry with its records in tests/infantry, the paper's
eight cells with 12 engagements each, controllers with fixed settings. The machine should do nothing else. Writes
results/robot_speed.json.
"""

from collections.abc import Callable

import alternating

SETTINGS = {"kalman": 2.0, "kalman-lq": 2.0, "imm-lq": 4.0, "parabola-lq": 0.0, "oracle": None}
"""Controller → standard deviation of the acceleration that its filter assumes [m/s²]; None of the oracle."""
ENGAGEMENTS = 12


def prepare() -> alternating.Work:
    """Return controller → an evaluation, which returns how many shots."""
    from archerfish.compiled import import_jax
    from archerfish.controllers.registry import make_controller
    from archerfish.controllers.tuning import Tuning
    from archerfish.evaluation.draws import draw
    from archerfish.evaluation.run import count
    from archerfish.robot import Robot
    from archerfish.task import Task
    from archerfish.virtual_robot.virtual_robot import VirtualRobot

    import_jax()
    robot, task = Robot.load(alternating.ROOT / "tests" / "infantry"), Task.load("paper")
    world = VirtualRobot.load("infantry").world(robot, task)
    drawn = draw(task.cells(), ENGAGEMENTS, 0, "evaluation", world.normals, world.plants)

    def evaluation(name: str) -> Callable[[], int]:
        sd = SETTINGS[name]
        controller = make_controller(name, robot, task, None if sd is None else Tuning(acceleration_sd=sd))
        return lambda: count(world, controller, *drawn).hit.size

    return {name: evaluation(name) for name in SETTINGS}


if __name__ == "__main__":
    alternating.run(__doc__, __file__, prepare, tuple(SETTINGS), pairs=5)
