"""One decision of a controller on one robot: from what is seen of one plate to a command that the gate lets pass.

The same class decides in NumPy and is traced, so a printed file can be compared with it.
"""

import functools
import operator
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, leaves, namespace, select
from archerfish.codegen.trace import Trace, scalars_of, symbols_of
from archerfish.protocols import Barrel, Base, Frames, GimbalFeedback, Seen
from archerfish.safety.gate import MEASURABLE, GateInput, GateState, GateVerdict, Mode, gate, resting_gate
from archerfish.safety.rules import Rules

FIELDS = {
    "elapsed": 1, "gimbal_age": 1, "frame_age": 1, "muzzle_speed": 1, "base_yaw": 1, "shots_left": 1,
    "angle": 2, "rate": 2, "plate": 3, "found": 1, "switch_on": 1, "distrusted": 1,
}  # fmt: skip
"""What a caller gives at each decision, and how many numbers each has."""
TRUTHS = ("found", "switch_on", "distrusted")
"""Those that are true or false; they come last."""

UNSEEN_AGE = np.float32(1e6)
"""Age of a plate that was not seen yet [s]."""
NEAREST_PLATE_M, OLDEST_FRAME_S = 0.1, 1.0
"""A plate that is nearer, or in an older frame, counts as unseen."""
LONGEST_UNSEEN_S = 1.0
"""After a longer time without a plate the command stands, and the controller begins again with the next plate."""
LONGEST_PAUSE = 1000
"""A controller begins again after a pause of more decision periods, as after a clock was set."""
_NEEDED = ("gimbal_age", "muzzle_speed", "base_yaw", "angle", "rate")  # without one of them it does not decide
_FINITE = np.finfo(np.float32).max


class GatedState(NamedTuple):
    """What is remembered between decisions; C's memory has it in this order."""

    gate: GateState  # `GATE_SIZE` numbers, of which the command comes first
    plate_age: Array  # since the exposure of the last plate [s], at least `UNSEEN_AGE` before the first, ()
    waited: Array  # since the controller's last decision [s], ()
    begins: Array  # 1 where the controller begins at the next decision, else 0, ()
    inner: Any  # of the controller


GATE_SIZE = len(GateState._fields) + 2
"""Numbers of the gate's state, of which command and rate are two each."""


class Gated:
    """A controller behind the gate; until it sees a plate it asks for the command in force."""

    def __init__(self, controller: Any, rules: Rules) -> None:
        """Take a controller, and the rules of the gate."""
        self.controller, self.rules = controller, rules

    def reset(self) -> GatedState:
        """Begin, shape (): disarmed, nothing seen."""
        zeros = {name: np.zeros((size,) * (size > 1), np.float32) for name, size in FIELDS.items()}
        ahead = {"plate": np.array([3.0, 0.0, 0.0], np.float32), "found": np.zeros((), bool)}
        begun = resting_gate(zeros["angle"])
        inner = self.controller.reset(seen_of(zeros | ahead, begun.command))
        zero = zeros["elapsed"]
        return GatedState(begun, zero + UNSEEN_AGE, zero, zero + np.float32(1.0), inner)

    def step(self, state: GatedState, given: Mapping[str, Array]) -> tuple[GatedState, GateVerdict]:
        """Decide from `FIELDS`, shape B or B + (size,).

        Nothing absurd reaches the controller. It begins again after a long time without a plate, after a clock was set,
        and after a command or a memory that is not finite.
        """
        xp = namespace(given["angle"])
        zero = xp.zeros_like(state.waited)
        runs_on = (given["elapsed"] >= 0.0) & (given["elapsed"] <= LONGEST_PAUSE * self.rules.period)
        elapsed = xp.where(runs_on, given["elapsed"], zero)

        # What the controller sees: only a plate that can be one, and while disarmed the gimbal's angle as the command.
        fits = {name: xp.abs(given[name]) <= MEASURABLE for name in (*_NEEDED, "plate")}
        fits |= {name: xp.all(fits[name], axis=-1) for name in fits if FIELDS[name] > 1}
        is_usable = functools.reduce(operator.and_, (fits[name] for name in _NEEDED))
        plate = select(fits["plate"], given["plate"], xp.zeros_like(given["plate"]))
        frame_age, shots_left = given["frame_age"], given["shots_left"]
        shows = given["found"] & is_usable & (frame_age >= 0.0) & (frame_age <= OLDEST_FRAME_S)
        shows = shows & (xp.sum(plate * plate, axis=-1) >= NEAREST_PLATE_M**2)
        begins = state.begins > 0.5
        waited = xp.where(begins, zero, state.waited + elapsed)
        age = xp.where(shows, frame_age, state.plate_age + elapsed)
        is_lost = age > LONGEST_UNSEEN_S
        clean = {name: select(is_usable, given[name], xp.zeros_like(given[name])) for name in _NEEDED}
        clean |= {"elapsed": waited, "found": shows, "frame_age": xp.where(shows, frame_age, zero)}
        clean |= {"shots_left": xp.where(shots_left >= 1.0, shots_left, zero)}
        clean |= {"plate": select(shows, plate, xp.zeros_like(plate))}
        is_followed = (state.gate.mode == Mode.DISARMED) & fits["angle"]
        command = select(is_followed, given["angle"], state.gate.command)
        seen = seen_of(clean, command)

        before = state.inner
        if xp is not np or np.any(begins):
            before = _one_of(begins, self.controller.reset(seen), before)
        inner, asked = self.controller.step(before, seen)
        if xp is np:  # a user's angle and fire may be lists or scalars
            angle = np.broadcast_to(np.asarray(asked.angle, np.float32), command.shape)
            asked = asked._replace(angle=angle, fire=np.reshape(np.asarray(asked.fire, bool), zero.shape))
        numbers = [asked.angle, *(leaf for leaf in leaves(inner) if hasattr(leaf, "shape"))]
        arrays = [xp.reshape(array, (*zero.shape, -1)) for array in numbers]
        finite = [xp.all(xp.abs(array) <= _FINITE, axis=-1) for array in arrays]
        is_finite = is_usable & functools.reduce(operator.and_, finite)
        desired = select(is_lost, command, asked.angle)
        inputs = GateInput(
            elapsed=given["elapsed"],
            desired=select(is_finite, desired, xp.full_like(desired, np.nan)),
            fire=asked.fire,
            switch_on=given["switch_on"],
            angle=given["angle"],
            feedback_age=given["gimbal_age"],
            plate_age=age,
            base_yaw=given["base_yaw"],
            shots_left=shots_left,
            plausible=~given["distrusted"],
        )
        following, verdict = gate(self.rules, state.gate, inputs)
        forgets = ~runs_on | is_lost | (is_usable & ~is_finite)
        still_begins = forgets | (begins & ~is_usable)
        kept = GatedState(
            gate=following,
            plate_age=xp.where(forgets, zero + UNSEEN_AGE, age),
            waited=xp.where(is_usable, zero, waited),
            begins=xp.where(still_begins, zero + 1.0, zero),
            inner=_one_of(is_finite, inner, before),
        )
        return kept, verdict


def _one_of(condition: Array, one: Any, other: Any) -> Any:
    """Choose as `select` does, between memories of any kind where the batch agrees: a user's need not be arrays."""
    if namespace(condition) is np and np.all(condition):
        return one
    if namespace(condition) is np and not np.any(condition):
        return other
    return select(condition, one, other)


def seen_of(given: Mapping[str, Array], command: Array) -> Seen:
    """Return what is seen, shape B, on a base that does not move; NumPy's arrays or traced ones.

    Args:
      given: `FIELDS`.
      command: in force [rad], shape B + (2,).
    """
    xp, found, age, plate = namespace(command), given["found"], given["frame_age"], given["plate"]
    zero, still = xp.zeros_like(age), xp.zeros_like(plate)
    one_frame, one_slot = (..., None), (..., None, None)
    frames = found[one_frame], age[one_frame], found[one_slot], plate[..., None, None, :], zero[one_slot]
    gimbal = GimbalFeedback(given["angle"], given["rate"], given["gimbal_age"])
    base, barrel = Base(still, still, given["base_yaw"], zero), Barrel(given["muzzle_speed"], given["shots_left"])
    return Seen(given["elapsed"], gimbal, command, Frames(*frames), base, barrel)


class Decision(NamedTuple):
    """A traced decision."""

    memory: list[Any]  # scalars that the next decision gets as the inputs "memory"
    angle: list[Any]  # pitch and yaw to send [rad]
    fire: Any  # whether to fire
    codes: list[Any]  # mode, reason and cause
    refused: Any  # whether the input is bad


def trace_decision(gated: Gated) -> Decision:
    """Trace a decision; its inputs are `FIELDS`, "memory", and "first", whether it is the first one, of any time.

    Raises:
      TypeError: if the controller's formulas can't be traced.
    """
    trace = Trace()
    shapes = {name: np.zeros((size,) * (size > 1), bool if name in TRUTHS else float) for name, size in FIELDS.items()}
    given = {name: trace.like(each, "input", name) for name, each in shapes.items()}
    first = trace.like(np.asarray(True), "input", "first")
    xp = namespace(first)
    given["elapsed"] = xp.where(first, gated.rules.period, given["elapsed"])
    begun = gated.reset()
    state, verdict = gated.step(select(first, begun, trace.like(begun, "input", "memory")), given)
    memory = scalars_of(state)
    if any(each.is_bool for each in symbols_of(memory)):
        raise TypeError("its memory holds truths; it needs numbers")
    fire, refused = scalars_of((verdict.fire, state.gate.good_for <= 0.0))
    codes = scalars_of((verdict.mode, verdict.reason, verdict.cause))
    return Decision(memory, scalars_of(verdict.angle), fire, codes, refused)


ARMING = 11
"""Decisions of an example before the switch goes on: half a second of good input, at the longest time between them."""
EXAMPLES = ARMING + 24
"""Decisions of the self-test of a C file."""
UNTRACEABLE = (TypeError, ValueError, AttributeError, IndexError)
"""What controllers raise that can't be traced."""


def example_decisions(gated: Gated, count: int, seed: int = 0) -> Iterator[tuple[dict[str, Array], GateVerdict]]:
    """Yield what is seen, in float32, and the verdict in NumPy, as a target moves and some frames show nothing.

    Args:
      gated: decides, and is followed by a gimbal that lags; its switch goes on after `ARMING` decisions.
      count: of decisions.
      seed: of targets and noise.
    """
    rng, state, period = np.random.default_rng(seed), gated.reset(), float(gated.rules.period)
    angle = command = np.clip(0.0, gated.rules.limits.low, gated.rules.limits.high)
    plates = rng.uniform([1.5, -0.3, -0.1], [4.5, 0.3, 0.2]) + np.cumsum(rng.normal(0.0, 0.01, (count, 3)), axis=0)
    for at, plate in enumerate(plates):
        moved, found = 0.4 * (command - angle), at == 0 or rng.random() > 0.15
        angle = angle + moved
        given: dict[str, Any] = {
            "elapsed": float(gated.rules.late) if 0 < at < ARMING else period,
            "gimbal_age": 2e-3,
            "frame_age": rng.uniform(0.02, 0.05),
            "muzzle_speed": 18.0,
            "base_yaw": 0.02 * at,
            "shots_left": 100.0,
            "angle": angle,
            "rate": moved / period,
            "plate": plate * found,
        }
        given = {name: np.asarray(value, np.float32) for name, value in given.items()}
        given |= {"found": np.asarray(found), "switch_on": np.asarray(at >= ARMING), "distrusted": np.asarray(False)}
        state, verdict = gated.step(state, given)
        command = verdict.angle
        yield given, verdict
