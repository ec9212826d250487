"""Shots per second of evaluations, and decisions per second of the world alone.

`python benchmarks/game_speed.py [--against REVISION]`: the paper's robot under `gate`, eight cells with 100
engagements each. The machine should do nothing else. Writes results/game_speed.json.
"""

import importlib
from collections.abc import Callable
from typing import Any

import alternating

CONTROLLERS = ("kalman", "kalman-lq", "imm-lq", "oracle")
MEMBERS = (512, 4096)
NAMES = (*CONTROLLERS, *(f"step, {n}" for n in MEMBERS))


def prepare() -> alternating.Work:
    """Return controller → an evaluation, which returns how many shots, and the world's steps alone."""
    from archerfish.compiled import import_jax
    from archerfish.controllers.registry import make_controller
    from archerfish.evaluation.draws import draw
    from archerfish.evaluation.run import count
    from archerfish.evaluation.tuning_search import tune
    from archerfish.robot import Robot
    from archerfish.simulation.world import make_world
    from archerfish.task import Task

    import_jax()
    robot, task = Robot.paper(), Task.load("paper")
    world = make_world(robot, task)
    engagements, normals = draw(task.cells(), 100, 0, "evaluation", world.normals, world.plants)

    def evaluation(name: str) -> Callable[[], int]:
        controller = make_controller(name, robot, task, None if name == "oracle" else tune(name, robot, task))
        return lambda: count(world, controller, engagements, normals).hit.size

    return {name: evaluation(name) for name in CONTROLLERS} | {
        f"step, {n}": _stepped(world, engagements, normals, n) for n in MEMBERS
    }


def _stepped(world: Any, engagements: Any, normals: Any, members: int) -> Callable[[], int]:
    """Return a run of all decisions under constant commands, in one compiled loop as a training has it."""
    import numpy as np

    from archerfish.protocols import aim

    jax: Any = importlib.import_module("jax")
    places = np.arange(members) % len(normals)
    drawn = jax.tree.map(lambda leaf: np.asarray(leaf)[places], engagements), normals[places]

    def program(world: Any, engagement: Any, normals: Any, angle: Any) -> Any:
        def step(state: Any, noise: Any) -> Any:
            return world.step(state, aim(angle), noise)

        begun = world.begin(engagement, normals)
        return jax.lax.scan(step, begun, jax.numpy.swapaxes(normals, 0, 1))[1].miss.sum()

    compiled, shots = jax.jit(program), drawn[1].shape[0] * drawn[1].shape[1]
    angle = 0.0 * drawn[1][:, 0, :2] + 0.05
    arguments = jax.tree.map(jax.numpy.asarray, (world, *drawn, angle))

    def run() -> int:
        jax.block_until_ready(compiled(*arguments))
        return int(shots)

    return run


if __name__ == "__main__":
    alternating.run(__doc__, __file__, prepare, NAMES, pairs=7)
