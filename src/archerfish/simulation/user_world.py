"""A user's own world in the place of the robot's simulator: found, and tried before the work."""

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np

from archerfish.arrays import is_tree, leaves, single_precision
from archerfish.compiled import has_jax, import_jax
from archerfish.errors import InputError
from archerfish.plugins import find_plugin
from archerfish.protocols import Engagement, Seen, Shot, World, aim
from archerfish.robot import Robot
from archerfish.simulation.world import make_world
from archerfish.task import Task


class HasWorld(Protocol):
    """What has a world for each robot and task, as a virtual robot."""

    def world(self, robot: Robot, task: Task) -> World:
        """Return the world."""


WorldLike: TypeAlias = str | World | Callable[[Robot, Task], World] | HasWorld
"""A world as every verb takes it."""


def find_world(world: WorldLike | None, robot: Robot, task: Task) -> World:
    """Return the robot's simulator, or the world that was given instead.

    Args:
      world: as `evaluate` takes it.
      robot: its records.
      task: whose decision period the world must have.

    Raises:
      InputError: if it lacks what a world has, has another decision period than the task, or its code fails.
    """
    if world is None:
        return make_world(robot, task)
    if type(world).__module__ == "builtins" and not (isinstance(world, str) or callable(world)):
        expected = "./FILE.py:NAME, a World, a function of robot and task, or what has world(robot, task)"
        raise InputError(f"world: expected {expected}, got one of type {type(world).__name__}; give one of these")
    plugin = find_plugin(world, "world")
    with plugin.running():
        found: Any = plugin.value
        if hasattr(found, "world"):
            found = found.world(robot, task)
        elif isinstance(found, type) or (callable(found) and not hasattr(found, "begin")):
            found = found(robot, task)
        names = ("name", "compiled", "period_s", "normals", "plants", "begin", "see", "step", "truth")
        missing = [name for name in names if not hasattr(found, name)]
        if missing:
            raise InputError(f"a {type(found).__name__} lacks {', '.join(missing)}; give it what `World` has")
        if abs(found.period_s - task.period_s) > 1e-6:
            periods = f"{found.period_s:g} s, the task's {task.period_s:g} s"
            raise InputError(f"the decision period of a {type(found).__name__} is {periods}; make them equal")
        return _checked(single_precision(found) if is_tree(found) else found, task)


def _checked(world: Any, task: Task) -> World:
    """Let a world pass one decision, in NumPy and, where it is compiled, traced."""
    scenario = task.cells()[0].scenario
    engagement = scenario.draw(np.linspace(0.1, 0.9, 3 * scenario.uniforms, dtype=np.float32).reshape(3, -1))

    def decision(world: Any, engagement: Engagement, normals: Any) -> tuple[Any, Any]:
        state = world.begin(engagement, normals)
        state, shot = world.step(state, aim(world.see(state).command), normals[:, 0])
        return world.see(state), shot

    drawn = engagement, np.zeros((3, 2, world.normals), np.float32)
    for kind, answer in zip((Seen, Shot), decision(world, *drawn), strict=True):
        if not isinstance(answer, kind) or any(np.shape(each)[:1] != (3,) for each in leaves(answer)):
            expected = f"expected a {kind.__name__} of arrays as long as there are engagements"
            raise InputError(f"a {type(world).__name__} returns a {type(answer).__name__}, {expected}; correct it")
    if world.compiled and has_jax():
        import_jax().eval_shape(decision, world, *drawn)
    checked: World = world
    return checked
