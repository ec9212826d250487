"""Shots per second of evaluations, and decisions per second of the world alone, against the first edition.

Each edition runs in a process of its own; the two alternate, and medians of the pairs are compared:
`python benchmarks2/game_speed.py`. The paper's robot under `gate`, eight cells with 100 engagements each. The goal is
at least 0.95 of the first edition's figures. The machine should do nothing else.
"""

import importlib
from collections.abc import Callable
from typing import Any

import alternating

CONTROLLERS = ("kalman", "kalman-lq", "imm-lq", "oracle")
MEMBERS = (512, 4096)


def first_edition() -> dict[str, Callable[[], int]]:
    """Return what is measured of the first edition: name → a function that returns how many shots or decisions."""
    from archerfish.cli.evaluation_run import EvaluationTask, classical_entrant, make_ground
    from archerfish.cli.setting import SettingFiles, load_setting
    from archerfish.controllers.roster import Tuning
    from archerfish.evaluation.trial import fight
    from archerfish.paper.tuning import paper_settings
    from archerfish.sensing.interfaces import fire_always

    names = {"kalman": "kalman-tuned"}
    tuning = {name: Tuning(**settings) for name, settings in paper_settings("gate").items()}
    task = EvaluationTask(load_setting(SettingFiles()), "gate", 100, 0, tuning=tuning)
    ground = make_ground(task)

    def evaluation(name: str) -> Callable[[], int]:
        controller = classical_entrant(task, names.get(name, name)).controller
        return lambda: fight(ground.world, controller, ground.trials).hits(0.06).size

    def steps(members: int) -> Callable[[], int]:
        drawn = _members(ground.trials.engagements, ground.trials.draws, members)

        def begin(world: Any, engagement: Any, normals: Any) -> Any:
            return world.begin(engagement, normals[:, 0])

        def step(world: Any, state: Any, angle: Any, normals: Any) -> Any:
            return world.shoot(state, fire_always(angle), normals)

        return _stepped(begin, step, ground.world, drawn)

    return {name: evaluation(name) for name in CONTROLLERS} | {f"step, {n}": steps(n) for n in MEMBERS}


def second_edition() -> dict[str, Callable[[], int]]:
    """Return the same of the second edition."""
    from archerfish2.compiled import import_jax
    from archerfish2.controllers.registry import make_controller
    from archerfish2.evaluation.draws import draw
    from archerfish2.evaluation.run import count
    from archerfish2.evaluation.tuning import tune
    from archerfish2.protocols import aim
    from archerfish2.robot import Robot
    from archerfish2.simulation.world import make_world
    from archerfish2.task import Task

    import_jax()
    robot, task = Robot.paper(), Task.load("paper")
    world = make_world(robot, task)
    engagements, normals = draw(task.cells(), 100, 0, "evaluation", world.normals, world.plants)

    def evaluation(name: str) -> Callable[[], int]:
        controller = make_controller(name, robot, task, None if name == "oracle" else tune(name, robot, task))
        return lambda: count(world, controller, engagements, normals).hit.size

    def steps(members: int) -> Callable[[], int]:
        drawn = _members(engagements, normals, members)

        def begin(world: Any, engagement: Any, normals: Any) -> Any:
            return world.begin(engagement, normals)

        def step(world: Any, state: Any, angle: Any, normals: Any) -> Any:
            return world.step(state, aim(angle), normals)

        return _stepped(begin, step, world, drawn)

    return {name: evaluation(name) for name in CONTROLLERS} | {f"step, {n}": steps(n) for n in MEMBERS}


def _members(engagements: Any, normals: Any, count: int) -> tuple[Any, Any]:
    import jax
    import numpy as np

    places = np.arange(count) % len(normals)
    return jax.tree.map(lambda each: np.asarray(each)[places], engagements), normals[places]


def _stepped(
    begin: Callable[..., Any], step: Callable[..., Any], world: Any, drawn: tuple[Any, Any]
) -> Callable[[], int]:
    """Return a run of all decisions under constant commands, in one compiled loop as a training has it."""
    jax: Any = importlib.import_module("jax")

    def program(world: Any, engagement: Any, normals: Any, angle: Any) -> Any:
        begun = begin(world, engagement, normals)
        scanned = jax.numpy.swapaxes(normals, 0, 1)
        return jax.lax.scan(lambda state, each: step(world, state, angle, each), begun, scanned)[1].miss.sum()

    compiled, normals = jax.jit(program), drawn[1]
    angle = 0.0 * normals[:, 0, :2] + 0.05
    arguments = jax.tree.map(jax.numpy.asarray, (world, *drawn, angle))

    def run() -> int:
        jax.block_until_ready(compiled(*arguments))
        return int(normals.shape[0] * normals.shape[1])

    return run


if __name__ == "__main__":
    NAMES = (*CONTROLLERS, *(f"step, {n}" for n in MEMBERS))
    alternating.run(__doc__, __file__, {"first": first_edition, "second": second_edition}, NAMES, pairs=7)
