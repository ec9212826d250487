"""The safety gate: at each decision the command that is sent, whether it fires, and why not.

A pure function of arrays that runs in NumPy, under JAX and traced into C. With good input a command passes as
`limit_command` gives it in the simulator. With bad input the command brakes and stands, and nothing is fired.
"""

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace
from archerfish.dynamics.command_limits import limit_command
from archerfish.safety.rules import Rules

MEASURABLE = 1e3
"""An angle [rad] or a time [s] beyond it is no measurement; float32 has steps of 6e-5 there."""
FUTURE_S = 0.01
"""How far the stamp of an input may be in the future, for what clocks differ [s]."""
_LONGEST_S = 10.0  # timers stop there
_TIMER_MARGIN_S = 1e-4  # in float32 five times 0.02 is less than 0.1
_RANGE_MARGIN = 0.035  # 2°: how far a gimbal may be outside its range when it is armed [rad]
_BASE_STEP = 0.5  # largest turn of the chassis between decisions [rad], 25 rad/s at 50 Hz
_NOTICEABLE = 0.02  # a command that the limits change by more is no aim: half a small plate at 3 m [rad]


class Mode(IntEnum):
    """What the gate does with commands."""

    DISARMED = 0
    """The gimbal is let go; the command follows it, so that arming is smooth."""
    ARMED = 1
    """The controller's commands are sent, within the limits."""
    HOLD = 2
    """The input is bad: the command brakes and stands until it has been good for more than 50 ms."""
    FAULT = 3
    """As hold, until the operator's switch is off and the input has been good for a while."""


class Reason(IntEnum):
    """Why a shot is not fired, why the robot is not armed, or what is wrong with the input."""

    NONE = 0
    DISARMED = 1
    FAULT = 2
    HOLD = 3
    NOT_ASKED = 4
    """The controller does not fire."""
    PLATE_UNSEEN = 5
    LIMITED = 6
    """The limits changed the command."""
    OFF_TARGET = 7
    """The gimbal is far from its command, where `near_deg` asks for that."""
    HEAT = 8
    INTERVAL = 9
    """The last shot was too short a time ago."""
    SWITCH_OFF = 10
    """All is ready; the operator's switch is off."""
    SWITCH_ON_AT_START = 11
    """The switch must go off first."""
    STARTING = 12
    """The input has not been good for long enough since the start."""
    OUT_OF_RANGE = 13
    """The gimbal is outside its range."""
    FEEDBACK_INVALID = 14
    """The angle is not finite, or absurd."""
    FEEDBACK_OLD = 15
    FEEDBACK_FROM_FUTURE = 16
    BASE_INVALID = 17
    """The yaw of the chassis is not finite, absurd, or jumps."""
    NO_COMMAND = 18
    """The controller's command is not finite, or absurd."""
    DECISION_EARLY = 19
    DECISION_LATE = 20
    IMPLAUSIBLE = 21
    """The gimbal does not do what its identified plant says."""
    SETTLING = 22
    """Armed so recently that the plant's prediction could not judge the feedback yet."""

    @property
    def text(self) -> str:
        """In words."""
        return self.name.lower().replace("_", " ")


class GateState(NamedTuple):
    """What the gate remembers; `resting_gate` begins it."""

    command: Array  # in force [rad], B + (2,)
    rate: Array  # at which it was reached [rad/s], B + (2,)
    base_yaw: Array  # of the chassis, the last one that was good [rad], B
    mode: Array  # a `Mode`, B
    good_for: Array  # time for which the input has been good [s], B
    bad_for: Array  # time for which it has been bad [s], B
    since_shot: Array  # time since the last shot, or since the start [s], B
    sent_for: Array  # time for which commands have been sent since it was armed, at most a period a decision [s], B
    switch_on: Array  # operator's switch at the last decision, 0 or 1, B
    cause: Array  # `Reason` why the input was bad, the last time that it was, B
    obstacle: Array  # `Reason` why the robot is not armed, or was not when the switch went on, B


class GateInput(NamedTuple):
    """What the gate takes at a decision."""

    elapsed: Array  # since the last decision [s], B
    desired: Array  # command of the controller: pitch and yaw [rad], B + (2,)
    fire: Array  # whether the controller would fire, bool, B
    switch_on: Array  # operator's switch, bool, B
    angle: Array  # of the gimbal, measured [rad], B + (2,)
    feedback_age: Array  # of that measurement [s], B
    plate_age: Array  # since the exposure that last showed a plate [s], B
    base_yaw: Array  # of the chassis [rad], B
    shots_left: Array  # that the heat limit allows, B
    plausible: Array = np.True_  # whether the feedback is what the plant says, see `plausibility`, bool, B


class GateVerdict(NamedTuple):
    """What the gate decides."""

    angle: Array  # command to send: pitch and yaw [rad], B + (2,)
    fire: Array  # bool, B
    mode: Array  # a `Mode`, B
    reason: Array  # `Reason` why it does not fire, 0 where it does, B
    cause: Array  # `Reason` why it is not armed, or why it holds; 0 while it is armed, B


def resting_gate(angle: Array) -> GateState:
    """Return the state at the start: disarmed, and a switch that is on must go off first.

    Args:
      angle: of the gimbal [rad], shape B + (2,).
    """
    xp = namespace(angle)
    zero = xp.zeros_like(angle[..., 0])
    return GateState(
        command=angle,
        rate=xp.zeros_like(angle),
        base_yaw=zero,
        mode=zero,
        good_for=zero,
        bad_for=zero,
        since_shot=zero,
        sent_for=zero,
        switch_on=xp.ones_like(zero),
        cause=xp.full_like(zero, float(Reason.STARTING)),
        obstacle=xp.full_like(zero, float(Reason.SWITCH_ON_AT_START)),
    )


def gate(rules: Rules, state: GateState, given: GateInput) -> tuple[GateState, GateVerdict]:
    """Decide what is sent, any batch shape B.

    Comparisons are written so that what is not finite fails them, and is never part of a sum that is used.

    Args:
      rules: of the robot and the task.
      state: of the last decision, or `resting_gate`.
      given: arrays; whatever is in them, the verdict's angle is finite and within the limits.
    """
    xp = namespace(state.command, given.desired, given.angle)
    zero = xp.zeros_like(state.mode)

    def first(*cases: tuple[Array, Any], otherwise: Array = zero) -> Array:
        """Return the code of the first case that holds, shape B."""
        code = otherwise
        for holds, value in reversed(cases):
            code = xp.where(holds, float(value) if isinstance(value, IntEnum) else value, code)
        return code

    def valid(value: Array) -> Array:
        return xp.abs(value) <= MEASURABLE

    # The input. A chassis that jumps would carry the range with it, and with the range the command.
    on, was_on = given.switch_on, state.switch_on > 0.5
    is_idle = ~on | (state.mode == Mode.DISARMED)
    angle_valid = xp.all(valid(given.angle), axis=-1)
    base_valid = valid(given.base_yaw) & (is_idle | (xp.abs(given.base_yaw - state.base_yaw) <= _BASE_STEP))
    fault = first(
        (~angle_valid, Reason.FEEDBACK_INVALID),
        (~(given.feedback_age <= rules.stale), Reason.FEEDBACK_OLD),
        (given.feedback_age < -FUTURE_S, Reason.FEEDBACK_FROM_FUTURE),
        (~base_valid, Reason.BASE_INVALID),
        (~xp.all(valid(given.desired), axis=-1), Reason.NO_COMMAND),
        (~(given.elapsed >= 0.5 * rules.period), Reason.DECISION_EARLY),
        (~(given.elapsed <= rules.late), Reason.DECISION_LATE),
        (~given.plausible, Reason.IMPLAUSIBLE),
    )
    good = fault == Reason.NONE
    cause = xp.where(good, state.cause, fault)
    base_yaw = xp.where(base_valid, given.base_yaw, state.base_yaw)
    measured = xp.where(angle_valid[..., None], given.angle, state.command)

    # Timers. A clock that stands, runs back or is not finite counts as long.
    elapsed = xp.where(valid(given.elapsed) & (given.elapsed > 0.0), given.elapsed, rules.lost)
    good_for = xp.where(good, xp.minimum(state.good_for + elapsed, _LONGEST_S), zero)
    # After bad input a single good one is not enough: a line without time stamps may have kept an old report back.
    recovered = good & ((state.mode == Mode.ARMED) | (good_for > rules.stale))
    still_bad_for = xp.where(good, state.bad_for, xp.minimum(state.bad_for + elapsed, _LONGEST_S))
    bad_for = xp.where(recovered, zero, still_bad_for)
    since_shot = xp.minimum(state.since_shot + elapsed, _LONGEST_S)
    is_steady = good_for >= rules.steady - _TIMER_MARGIN_S
    is_lost = (bad_for >= rules.lost - _TIMER_MARGIN_S) | ~(xp.abs(given.feedback_age) <= rules.lost)

    # The range of the yaw turns with the chassis.
    turned = xp.stack([zero, base_yaw], axis=-1)
    low, high = lift(rules.limits.low, turned) + turned, lift(rules.limits.high, turned) + turned
    limits = rules.limits._replace(low=low, high=high)
    inside = xp.all((measured >= low - _RANGE_MARGIN) & (measured <= high + _RANGE_MARGIN), axis=-1)

    # The mode. What stood against arming when the switch went on is shown until the switch goes off.
    readiness = first((~is_steady, cause), (~inside, Reason.OUT_OF_RANGE))
    obstacle = first(
        (on & was_on, state.obstacle),
        (on, readiness),
        (readiness == Reason.NONE, Reason.SWITCH_OFF),
        otherwise=readiness,
    )
    arms = on & ~was_on & (state.mode == Mode.DISARMED) & is_steady & inside
    runs = on & ((state.mode == Mode.ARMED) | (state.mode == Mode.HOLD))
    mode = first(
        (arms | (runs & recovered), Mode.ARMED),
        (runs & is_lost, Mode.FAULT),
        (runs, Mode.HOLD),
        ((state.mode == Mode.FAULT) & (on | ~is_steady), Mode.FAULT),
    )

    # The command. The first one is where the gimbal is. Where a decision was missed, the command has stood still since.
    # Where the range has turned over the command, it carries it along; that is no motion of the command's own.
    begins = (state.mode == Mode.DISARMED) | (mode == Mode.DISARMED)
    decided_for = xp.minimum(elapsed, rules.period)  # the prediction takes a decision as a period, too
    sent_for = xp.where(begins, zero, xp.minimum(state.sent_for + decided_for, _LONGEST_S))
    follows = ((mode == Mode.ARMED) & ~begins)[..., None]
    previous = xp.clip(xp.where(begins[..., None], measured, state.command), low, high)
    stood = begins | ~(elapsed < 1.5 * rules.period)
    rate = xp.where(stood[..., None], xp.zeros_like(turned), state.rate)
    wanted = xp.where(follows, given.desired, previous)
    angle = limit_command(limits, wanted, previous, rate, xp.zeros_like(turned), rules.period)

    reason = first(
        (mode == Mode.DISARMED, Reason.DISARMED),
        (mode == Mode.FAULT, Reason.FAULT),
        (mode == Mode.HOLD, Reason.HOLD),
        (~given.fire, Reason.NOT_ASKED),
        (~((given.plate_age >= -FUTURE_S) & (given.plate_age <= rules.unseen)), Reason.PLATE_UNSEEN),
        (xp.any(xp.abs(angle - given.desired) > _NOTICEABLE, axis=-1), Reason.LIMITED),
        (~xp.all(xp.abs(measured - angle) <= rules.near, axis=-1), Reason.OFF_TARGET),
        (~(given.shots_left >= 1.0), Reason.HEAT),
        (since_shot < rules.interval - _TIMER_MARGIN_S, Reason.INTERVAL),
        (sent_for < rules.settling - _TIMER_MARGIN_S, Reason.SETTLING),
    )
    fire = reason == Reason.NONE
    following = GateState(
        command=angle,
        rate=(angle - previous) / rules.period,
        base_yaw=base_yaw,
        mode=mode,
        good_for=good_for,
        bad_for=bad_for,
        since_shot=xp.where(fire, zero, since_shot),
        sent_for=sent_for,
        switch_on=xp.where(on, xp.ones_like(zero), zero),
        cause=cause,
        obstacle=obstacle,
    )
    shown = first((mode == Mode.DISARMED, obstacle), (mode != Mode.ARMED, cause))
    return following, GateVerdict(angle, fire, mode, reason, shown)
