"""One decision of a controller as a graph: state and frame in, next state and angle out."""

import math
from typing import Any, NamedTuple

from archerfish.controllers.guarded_policy import GuardedPolicy
from archerfish.controllers.policy import PolicyController
from archerfish.deployment.symbol import BATCH, BOOL, FLOAT, Symbol, graph_input, reshaped
from archerfish.deployment.symbolic_arrays import SYMBOLIC
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.sensing.interfaces import Seen

FRAME_SHAPES = Seen(
    elapsed=(),
    angle=(2,),
    rate=(2,),
    gimbal_age=(),
    command=(2,),
    plate=(1, 3),
    normal_yaw=(1,),
    plate_age=(1,),
    fresh=(1,),
    base=(4,),
    muzzle_speed=(),
    heat_left=(),
)
"""Shapes of what is seen, by one robot of one plate."""


class Part(NamedTuple):
    """A part of the state."""

    name: str
    """Dotted, as in the controller's memory."""
    shape: tuple[int, ...]
    """Of one member of the batch."""


class DecisionGraph(NamedTuple):
    """One decision: run it once per decision, and hand its `next_state` to the next run."""

    next_state: Symbol
    """Shape (batch, state size)."""
    angle: Symbol
    """Pitch and yaw command [rad], shape (batch, 2)."""
    fallback: Symbol | None
    """Whether it fell back on a simpler controller, shape (batch,); None for a policy without one."""
    state_parts: tuple[Part, ...]
    """What the state holds, in order."""


def decision_graph(controller: PolicyController | GuardedPolicy) -> DecisionGraph:
    """Write down what a policy does in one decision, at the first of an engagement and at all others.

    Args:
      controller: the policy, in NumPy.
    """
    controller = single_precision(controller)
    shapes = FRAME_SHAPES._asdict()
    seen = Seen(**{name: graph_input(name, shapes[name], BOOL if name == "fresh" else FLOAT) for name in shapes})
    first = graph_input("first", (), BOOL)
    begun = controller.reset(seen)
    parts = _named_parts(begun, "")
    packed = graph_input("state", (sum(math.prod(part.shape) for _, part in parts),))
    # What the state holds at the first decision does not matter: it is not even looked at.
    memory = _unpacked(begun, SYMBOLIC.where(first[..., None], _packed(begun), packed))
    memory, command = controller.step(memory, seen)
    fallback = command.fallback if isinstance(controller, GuardedPolicy) else None
    return DecisionGraph(_packed(memory), command.angle, fallback, tuple(part for _, part in parts))


def _named_parts(tree: Any, name: str) -> list[tuple[Symbol, Part]]:
    if isinstance(tree, Symbol):
        return [(tree, Part(name or "memory", tuple(int(size) for size in tree.shape[1:])))]
    names = tree._fields if hasattr(tree, "_fields") else map(str, range(len(tree)))
    pairs = zip(names, tree, strict=True)
    return [part for each, below in pairs for part in _named_parts(below, f"{name}.{each}" if name else each)]


def _packed(tree: Any) -> Any:
    return SYMBOLIC.concat([reshaped(each, (BATCH, -1)) for each, _ in _named_parts(tree, "")], axis=-1)


def _unpacked(like: Any, packed: Symbol) -> Any:
    start = 0

    def take(each: Symbol) -> Symbol:
        nonlocal start
        size = math.prod(int(length) for length in each.shape[1:])
        part = reshaped(packed[:, start : start + size], each.shape)
        start += size
        return part

    return map_arrays(take, like)
