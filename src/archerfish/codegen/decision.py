"""One decision of a controller on one robot: from what is seen of one plate to a command within the limits.

The same class decides in NumPy and is traced, so a printed file can be compared with it.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, namespace, select, single_precision
from archerfish.codegen.trace import Trace, scalars_of, symbols_of
from archerfish.dynamics.command_limits import CommandLimits, limit_command
from archerfish.protocols import Barrel, Base, Command, Frames, GimbalFeedback, Seen, Truth

FIELDS = {
    "elapsed": 1, "gimbal_age": 1, "frame_age": 1, "muzzle_speed": 1, "base_yaw": 1,
    "angle": 2, "rate": 2, "command": 2, "plate": 3, "found": 1,
}  # fmt: skip
"""What a caller gives at each decision, and how many numbers each has; `found` is true or false."""


UNSEEN_AGE = np.float32(1e6)
"""Age of a plate that was not seen yet [s]."""


class GatedState(NamedTuple):
    """What is remembered between decisions."""

    inner: Any  # of the controller
    command: Array  # in force at the last decision [rad], (2,)
    plate_age: Array  # since the exposure of the last plate [s], at least `UNSEEN_AGE` before the first, ()


class Gated:
    """A controller whose commands keep the limits of its robot, as in the simulator, and stay until it sees a plate."""

    def __init__(self, controller: Any, limits: CommandLimits, period_s: float) -> None:
        """Take a controller, the limits of its commands, and the decision period [s]."""
        self.controller, self.limits, self.period = controller, single_precision(limits), np.float32(period_s)

    def reset(self, seen: Seen, truth: Truth | None = None) -> GatedState:  # noqa: ARG002
        """Begin, shape ()."""
        return GatedState(self.controller.reset(seen), seen.command, 0.0 * seen.elapsed + UNSEEN_AGE)

    def step(self, state: GatedState, seen: Seen) -> tuple[GatedState, Command]:
        """Decide, shape ()."""
        inner, command = self.controller.step(state.inner, seen)
        xp = namespace(seen.command)
        plate_age = xp.where(seen.frames.found[..., 0, 0], seen.frames.age[..., 0], state.plate_age + seen.elapsed)
        shown = plate_age < UNSEEN_AGE
        wanted = xp.where(shown[..., None], command.angle, seen.command)
        turned = xp.stack([0.0 * seen.base.yaw, seen.base.yaw], axis=-1)
        limits = self.limits._replace(low=self.limits.low + turned, high=self.limits.high + turned)
        # Where a decision was missed the command has stood still since.
        rate = (seen.elapsed < 1.5 * self.period)[..., None] * (seen.command - state.command) / self.period
        angle = limit_command(limits, wanted, seen.command, rate, 0.0 * turned, self.period)
        return GatedState(inner, seen.command, plate_age), command._replace(angle=angle, fire=command.fire & shown)


def seen_of(given: Mapping[str, Array]) -> Seen:
    """Return what is seen, shape (), from `FIELDS`; NumPy's arrays or traced ones, a base that does not move."""
    still, zero, found, age = np.zeros(3, np.float32), 0.0 * given["elapsed"], given["found"], given["frame_age"]
    frames = found[None], age[None], found[None, None], given["plate"][None, None], zero[None, None]
    gimbal = GimbalFeedback(given["angle"], given["rate"], given["gimbal_age"])
    base, barrel = Base(still, still, given["base_yaw"], zero), Barrel(given["muzzle_speed"], zero + 1e6)
    return Seen(given["elapsed"], gimbal, given["command"], Frames(*frames), base, barrel)


class Decision(NamedTuple):
    """A traced decision."""

    memory: list[Any]  # scalars that the next decision gets as the inputs "memory"
    command: list[Any]  # pitch and yaw [rad]
    fire: Any  # whether to fire


def trace_decision(gated: Gated) -> Decision:
    """Trace a decision; its inputs are `FIELDS`, "memory", and "first", whether it is the first one.

    Raises:
      TypeError: if the controller's formulas can't be traced.
    """
    trace = Trace()
    shapes = {name: np.zeros((n,) * (n > 1), bool if name == "found" else float) for name, n in FIELDS.items()}
    given = {name: trace.like(each, "input", name) for name, each in shapes.items()}
    first = trace.like(np.asarray(True), "input", "first")
    seen = seen_of(given | {"elapsed": namespace(first).where(first, 0.0, given["elapsed"])})
    begun = gated.reset(seen)
    state, command = gated.step(select(first, begun, trace.like(begun, "input", "memory")), seen)
    memory = scalars_of(state)
    if any(each.is_bool for each in symbols_of(memory)):
        raise TypeError("its memory holds truths; it needs numbers")
    return Decision(memory, scalars_of(command.angle), scalars_of(command.fire)[0])


def example_decisions(gated: Gated, count: int, seed: int = 0) -> Iterator[tuple[dict[str, Array], Command]]:
    """Yield what is seen, in float32, and the command in NumPy, as a target moves and some frames show nothing.

    Args:
      gated: decides, and is followed by a gimbal that lags.
      count: of decisions.
      seed: of targets and noise.
    """
    rng, state, period = np.random.default_rng(seed), None, float(gated.period)
    angle = command = np.clip(0.0, gated.limits.low, gated.limits.high)
    plates = rng.uniform([1.5, -0.3, -0.1], [4.5, 0.3, 0.2]) + np.cumsum(rng.normal(0.0, 0.01, (count, 3)), axis=0)
    for at, plate in enumerate(plates):
        moved, found = 0.4 * (command - angle), at == 0 or rng.random() > 0.15
        angle = angle + moved
        values = (period * (at > 0), 2e-3, rng.uniform(0.02, 0.05), 18.0, 0.02 * at, angle, moved / period, command)
        pairs = zip(FIELDS, (*values, plate * found), strict=False)
        given = {name: np.asarray(value, np.float32) for name, value in pairs} | {"found": np.asarray(found)}
        seen = seen_of(given)
        state, made = gated.step(gated.reset(seen) if state is None else state, seen)
        command = made.angle
        yield given, made
