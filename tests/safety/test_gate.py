"""The gate's modes, limits and reasons at literal inputs, and in random sequences under an independent monitor."""

import functools
import runpy
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import archerfish as af
from archerfish.arrays import map_arrays
from archerfish.dynamics.command_limits import limit_command
from archerfish.safety.gate import GateInput, Mode, Reason, gate, resting_gate
from archerfish.safety.rules import GateConfig, gate_rules

HERE, F = Path(__file__).parent, np.float32
ROBOT, TASK = af.Robot.load(HERE.parent / "infantry"), af.Task.load("any")
RULES = gate_rules(ROBOT, TASK)  # every 20 ms, yaw within 75°, 60 rad/s², pitch -25…10°, 100 rad/s²
CAMPAIGN = runpy.run_path(str(HERE / "campaign.py"))["campaign"]
USUAL = {"elapsed": 0.02, "feedback_age": 2e-3, "plate_age": 0.03, "base_yaw": 0, "shots_left": 10}


def given(**changes):
    """A good input, with the switch on, but for some changes."""
    values = {**USUAL, "desired": [0, 0], "angle": [0, 0], "fire": True, "switch_on": True, **changes}
    return GateInput(
        **{k: np.asarray(v, bool if k in ("fire", "switch_on", "plausible") else F) for k, v in values.items()}
    )


OFF, ON = given(switch_on=False), given()


def after(state, *inputs, rules=RULES):
    for each in inputs:
        state, verdict = gate(rules, state, each)
    return state, verdict


START = resting_gate(np.zeros(2, F))
ARMED, FIRST = after(START, *[OFF] * 25, *[ON] * 16)  # the last of them is the first that may fire


def outcome(state, *inputs, rules=RULES):
    """Mode, reason and cause of the last of some decisions."""
    _, verdict = after(state, *inputs, rules=rules)
    assert np.isfinite(verdict.angle).all()
    assert bool(verdict.fire) == (verdict.reason == Reason.NONE)
    return Mode(int(verdict.mode)).name, Reason(int(verdict.reason)).name, Reason(int(verdict.cause)).name


ARMS = ("ARMED", "SETTLING", "NONE")
FIRES = ("ARMED", "NONE", "NONE")


def disarmed(cause):
    return "DISARMED", "DISARMED", cause


def test_it_is_armed_by_a_switch_that_goes_on_after_half_a_second_of_good_input_and_says_why_it_is_not():
    assert Reason.SWITCH_ON_AT_START.text == "switch on at start"
    assert outcome(START, *[ON] * 60) == disarmed("SWITCH_ON_AT_START")
    assert outcome(START, OFF) == outcome(START, *[OFF] * 24) == disarmed("STARTING")
    assert outcome(START, *[OFF] * 25) == disarmed("SWITCH_OFF")
    assert outcome(START, *[OFF] * 24, ON) == ARMS  # which is the 25th
    assert outcome(START, *[OFF] * 23, ON) == outcome(START, *[OFF] * 23, *[ON] * 60) == disarmed("STARTING")
    slow = given(switch_on=False, elapsed=0.04)
    state, verdict = after(START, *[slow] * 300)
    assert (state.good_for, state.since_shot, verdict.cause) == (10.0, 10.0, Reason.SWITCH_OFF)  # timers are bounded
    assert outcome(START, *[slow] * 12, ON) == ARMS
    assert outcome(START, *[slow] * 11, ON) == disarmed("STARTING")
    late = given(switch_on=False, feedback_age=0.055)
    assert outcome(START, *[OFF] * 30, late, ON, ON) == disarmed("FEEDBACK_OLD")
    assert outcome(START, *[OFF] * 30, late, *[OFF] * 24) == disarmed("FEEDBACK_OLD")
    assert outcome(START, *[OFF] * 30, late, *[OFF] * 24, ON) == ARMS
    assert outcome(ARMED, OFF) == disarmed("SWITCH_OFF")
    assert outcome(ARMED, OFF, ON) == ARMS
    held, _ = after(ARMED, given(feedback_age=0.06))
    assert outcome(held, OFF) == disarmed("FEEDBACK_OLD")


@pytest.mark.parametrize(
    ("inside", "outside"),
    [
        ((RULES.limits.high[0] + F(0.035), 0), (0.22, 0)),
        ((RULES.limits.low[0] - F(0.035), 0), (-0.48, 0)),
        ((0, RULES.limits.high[1] + F(0.035)), (0, 1.35)),
        ((0, RULES.limits.low[1] - F(0.035)), (0, -1.35)),
    ],
)
def test_it_is_armed_within_two_degrees_of_the_range_and_begins_where_the_gimbal_is(inside, outside):
    for angle, expected in ((inside, "ARMED"), (outside, "DISARMED")):
        state, verdict = after(START, *[given(switch_on=False, angle=angle)] * 30, given(angle=angle))
        assert Mode(int(verdict.mode)).name == expected
        assert verdict.cause == (Reason.NONE if expected == "ARMED" else Reason.OUT_OF_RANGE)
        assert_array_equal(verdict.angle, np.clip(F(angle), RULES.limits.low, RULES.limits.high))
        assert_array_equal(state.rate, [0, 0])
    state, verdict = after(START, given(switch_on=False, angle=[0.05, 0.3]))
    assert_array_equal(verdict.angle, F([0.05, 0.3]))
    state, verdict = after(state, given(switch_on=False, angle=[np.nan, 0.2]))
    assert_array_equal(verdict.angle, F([0.05, 0.3]))


BAD = {
    ("feedback_age", "FEEDBACK_OLD"): {"HOLD": [0.0501, 0.1], "FAULT": [0.1001, np.nan, np.inf]},
    ("feedback_age", "FEEDBACK_FROM_FUTURE"): {"HOLD": [-0.0101, -0.0999], "FAULT": [-0.1001]},
    ("angle", "FEEDBACK_INVALID"): {"HOLD": [[np.nan, 0], [0, np.inf], [0, 1001]]},
    ("base_yaw", "BASE_INVALID"): {"HOLD": [np.nan, 1001, -0.51]},
    ("desired", "NO_COMMAND"): {"HOLD": [[np.nan, 0], [0, -np.inf], [0, 1001]]},
    ("elapsed", "DECISION_EARLY"): {"HOLD": [0.0099], "FAULT": [0.0, -1.0, np.nan]},
    ("elapsed", "DECISION_LATE"): {"HOLD": [0.0501], "FAULT": [0.1, np.inf]},
    ("plausible", "IMPLAUSIBLE"): {"HOLD": [False]},
}
GOOD = {
    "feedback_age": [0.0, 0.05, -0.01],
    "elapsed": [0.01, 0.05],
    "angle": [[0, 3.0], [0, -1000.0]],
    "base_yaw": [0.5, -0.5],
}


@pytest.mark.parametrize(("field", "cause"), BAD)
def test_bad_input_holds_or_is_a_fault_and_is_named(field, cause):
    for mode, values in BAD[field, cause].items():
        for value in values:
            bad = given(**{field: value})
            assert outcome(ARMED, bad) == (mode, mode, cause)
            assert outcome(ARMED, *[bad] * 12) == ("FAULT", "FAULT", cause)
            left = [outcome(ARMED, bad, *[ON] * count)[0] for count in (2, 3)]  # more than 50 ms of good input
            assert left == (["HOLD", "ARMED"] if mode == "HOLD" else ["FAULT", "FAULT"])


@pytest.mark.parametrize("field", GOOD)
def test_input_within_the_limits_is_good(field):
    for value in GOOD[field]:
        assert outcome(ARMED, given(**{field: value})) == outcome(ARMED, given(**{field: value}), ON) == FIRES


def test_a_fault_comes_after_a_tenth_of_a_second_and_stays_until_the_switch_was_off_with_good_input():
    bad = given(feedback_age=0.06)
    assert [outcome(ARMED, *[bad] * n)[0] for n in (1, 4, 5, 300)] == ["HOLD", "HOLD", "FAULT", "FAULT"]
    assert outcome(ARMED, *[bad] * 4, *[ON] * 3, *[bad] * 4)[0] == "HOLD"  # it counts from when it was armed again
    assert [outcome(ARMED, *[bad] * 4, *[ON] * 2, *[bad] * n)[0] for n in (0, 1)] == ["HOLD", "FAULT"]
    fault, _ = after(ARMED, *[bad] * 5)
    assert after(fault, *[given(elapsed=1.0)] * 12)[0].bad_for == 10.0
    assert outcome(fault, *[ON] * 100) == ("FAULT", "FAULT", "FEEDBACK_OLD")
    assert outcome(fault, *[OFF] * 24) == ("FAULT", "FAULT", "FEEDBACK_OLD")
    assert outcome(fault, *[OFF] * 24, ON, *[ON] * 9)[0] == "FAULT"
    assert outcome(fault, *[OFF] * 25) == disarmed("SWITCH_OFF")
    assert outcome(fault, *[OFF] * 25, ON) == ARMS
    assert outcome(fault, *[given(switch_on=False, elapsed=0.0501)] * 50)[0] == "FAULT"


NOT_FIRED = {
    ("fire", "NOT_ASKED"): [False],
    ("plate_age", "PLATE_UNSEEN"): [0.2501, np.nan, -0.0101],
    ("desired", "LIMITED"): [[0.0601, 0], [0, -0.0441]],
    ("shots_left", "HEAT"): [0.99, np.nan],
    ("fire", "NONE"): [True],
    ("plate_age", "NONE"): [0.25, -0.01],
    ("desired", "NONE"): [[0.0599, 0], [0, -0.0439]],
    ("shots_left", "NONE"): [1],
}


@pytest.mark.parametrize(("field", "reason"), NOT_FIRED)
def test_a_shot_that_is_not_fired_has_a_reason(field, reason):
    for value in NOT_FIRED[field, reason]:
        assert outcome(ARMED, given(**{field: value})) == ("ARMED", reason, "NONE")


def test_a_command_that_the_limits_change_by_20_mrad_is_an_aim_yet():
    ends_ahead = RULES._replace(limits=RULES.limits._replace(high=F([0.1, 0.0])))
    assert outcome(ARMED, given(desired=[0, 0.02]), rules=ends_ahead) == FIRES
    assert outcome(ARMED, given(desired=[0, np.nextafter(F(0.02), F(1))]), rules=ends_ahead)[1] == "LIMITED"


def test_reasons_come_in_their_order_and_the_configured_ones_are_kept():
    strict = gate_rules(ROBOT, TASK, GateConfig(near_deg=2.0, shots_per_s=10.0))
    state, _ = after(ARMED, *[ON] * 5, rules=strict)
    wrong = {
        "NOT_ASKED": {"fire": False},
        "PLATE_UNSEEN": {"plate_age": 1},
        "LIMITED": {"desired": [0, 1]},
        "OFF_TARGET": {"angle": [0.1, 0]},
        "HEAT": {"shots_left": 0},
        "INTERVAL": {},
    }
    shot, _ = after(state, *[given(fire=False)] * 5, ON, rules=strict)
    for at, reason in enumerate(wrong):
        changes = dict(pair for each in [*wrong.values()][at:] for pair in each.items())
        assert outcome(shot, given(**changes), rules=strict)[1] == reason
    for angle, reason in (([strict.near, 0], "NONE"), ([0.036, 0], "OFF_TARGET"), ([0, -0.036], "OFF_TARGET")):
        assert outcome(shot, *[given(fire=False)] * 4, given(angle=angle), rules=strict)[1] == reason
    aside = {"angle": [0, 0.3], "desired": [0, 0.3]}
    there, _ = after(START, *[given(switch_on=False, **aside)] * 25, *[given(**aside)] * 16, rules=strict)
    quiet = [given(fire=False, **aside)] * 4
    for angle, reason in (([0, 0.3], "NONE"), ([0, -0.3], "OFF_TARGET")):
        assert outcome(there, *quiet, given(desired=[0, 0.3], angle=angle), rules=strict)[1] == reason
    fired, state = [], shot
    for _ in range(20):
        state, verdict = gate(strict, state, ON)
        fired.append(bool(verdict.fire))
    assert fired == [False, False, False, False, True] * 4
    assert outcome(START, *[OFF] * 25, *[ON] * 19, rules=strict._replace(interval=F(0.9)))[1] == "INTERVAL"
    assert outcome(START, *[OFF] * 25, *[ON] * 20, rules=strict._replace(interval=F(0.9)))[1] == "NONE"


def test_nothing_is_fired_until_the_prediction_has_settled_also_where_decisions_are_missed():
    assert Reason.SETTLING.text == "settling"
    assert outcome(START, *[OFF] * 25, given(fire=False)) == ("ARMED", "NOT_ASKED", "NONE")
    assert outcome(ARMED, OFF, ON, rules=RULES._replace(interval=F(0.1))) == ("ARMED", "INTERVAL", "NONE")
    hold = given(plausible=False)
    for changes, needed in (({}, 15), ({"elapsed": 0.049}, 15), ({"elapsed": 0.0101}, 30)):
        soon = given(**changes)
        assert outcome(START, *[OFF] * 25, ON, *[soon] * (needed - 1)) == ARMS
        assert outcome(START, *[OFF] * 25, ON, *[soon] * needed) == FIRES
        assert outcome(START, *[OFF] * 25, ON, hold, *[soon] * (needed - 1)) == FIRES  # it was sent, too
    assert outcome(ARMED, hold, *[ON] * 3) == FIRES
    assert outcome(ARMED, OFF, *[ON] * 15) == ARMS
    assert outcome(ARMED, OFF, *[ON] * 16) == FIRES
    assert after(ARMED, *[ON] * 600)[0].sent_for == 10.0
    assert after(ARMED, OFF)[0].sent_for == 0.0
    assert [RULES.settling, gate_rules(ROBOT, TASK.replace(period_s=0.04)).settling] == [F(0.3), F(0.6)]


def test_with_good_input_the_command_is_that_of_the_limits_bit_for_bit():
    rng, state = np.random.default_rng(0), ARMED
    zero = np.zeros(2, F)
    for desired in (state.command + np.cumsum(rng.normal(0, 0.1, (300, 2)), axis=0)).astype(F):
        expected = limit_command(RULES.limits, desired, state.command, state.rate, zero, RULES.period)
        rate = (expected - state.command) / RULES.period
        state, verdict = gate(RULES, state, given(desired=desired, elapsed=rng.uniform(0.011, 0.029)))
        assert_array_equal(verdict.angle, expected)
        assert_array_equal(state.rate, rate)


def test_a_held_command_brakes_and_one_of_a_missed_decision_begins_at_rest():
    to_the_left = given(desired=[0, 1])
    state, verdict = after(ARMED, to_the_left, to_the_left)
    assert_allclose(verdict.angle, [0, 3 * 0.024], atol=2e-6)
    for elapsed, expected in ((0.0299, 6), (F(1.5) * RULES.period, 4), (0.0301, 4)):
        assert_allclose(after(state, given(desired=[0, 1], elapsed=elapsed))[1].angle[1], 0.024 * expected, atol=3e-6)
    for changes in ({"feedback_age": 0.06}, {"desired": [0, np.nan]}, {"feedback_age": 0.2}):
        held, places = state, []
        for _ in range(4):
            held, verdict = gate(RULES, held, given(**changes))
            places.append(verdict.angle[1])
        assert_allclose(places, [4 * 0.024] * 4, atol=3e-6)
    fast, _ = after(state, *[to_the_left] * 3)
    held = given(angle=[0, 99], feedback_age=0.06)
    assert np.all(np.diff([after(fast, *[held] * n)[1].angle[1] for n in range(1, 9)]) >= 0)


def test_the_range_turns_with_the_chassis_and_an_absurd_one_does_not_move_the_command():
    place = {"angle": [0.1, 0.5], "base_yaw": 1.0, "desired": [0.1, 0.5]}
    state, verdict = after(START, *[given(switch_on=False, **place)] * 30, *[given(**place)] * 2)
    assert_allclose(verdict.angle, [0.1, 0.5])
    for aim, end in (([9, 9], RULES.limits.high), ([-9, -9], RULES.limits.low)):
        moved, verdict = after(state, *[given(base_yaw=1.0, desired=aim)] * 99)
        assert_allclose(verdict.angle, end + F([0, 1]), atol=1e-6)
        for wrong in (np.nan, np.inf, 30.0, -2000.0):
            assert_allclose(after(moved, given(base_yaw=wrong))[1].angle, verdict.angle, atol=1e-6)
        turned, carried = after(moved, given(base_yaw=1.0 - 0.2 * np.sign(aim[1]), desired=aim))
        assert_allclose(carried.angle[1] - verdict.angle[1], -0.2 * np.sign(aim[1]), atol=1e-6)
        assert_allclose(turned.rate[1], 0, atol=1e-4)
    jumped = given(switch_on=False, base_yaw=30.0, angle=[0, 30.5])
    assert_allclose(after(state, jumped)[1].angle, [0, 30.5])  # a clock or a gyro that begins again


def test_random_sequences_break_no_rule():
    with np.errstate(invalid="ignore"):
        monitor = CAMPAIGN(ROBOT, RULES, n=20_000, decisions=50, seed=5)
    assert monitor.wrong == dict.fromkeys(monitor.wrong, 0)
    assert min(monitor.done.values()) > 10_000


def test_the_monitor_finds_what_is_wrong():
    def broken(rules, state, given, change):
        state, verdict = gate(rules, state, given)
        return state._replace(command=change(verdict).angle), change(verdict)

    changes = {
        "range": lambda v: v._replace(angle=v.angle * F(2)),
        "acceleration": lambda v: v._replace(angle=v.angle + F(0.05) * (v.mode == 1)[:, None]),
        "held, not braking": lambda v: v._replace(angle=v.angle + F(0.05) * (v.mode > 1)[:, None]),
        "rate": lambda v: v._replace(angle=v.angle * F(-1)),
        "not finite": lambda v: v._replace(angle=v.angle / (v.mode != 2)[:, None].astype(F)),
        "fires too hot": lambda v: v._replace(fire=v.fire | (v.reason == Reason.HEAT)),
        "fires too soon": lambda v: v._replace(fire=v.fire | (v.reason == Reason.INTERVAL)),
        "fires at an unseen plate": lambda v: v._replace(fire=v.fire | (v.reason == Reason.PLATE_UNSEEN)),
        "fires while settling": lambda v: v._replace(fire=v.fire | (v.reason == Reason.SETTLING)),
        "fires while not armed": lambda v: v._replace(fire=v.fire | (v.mode == 0)),
        "fires on old feedback": lambda v: v._replace(fire=v.fire | (v.mode == 2)),
        "arms without the switch": lambda v: v._replace(mode=np.maximum(v.mode, F(1))),
    }
    with np.errstate(all="ignore"):
        for name, change in changes.items():
            monitor = CAMPAIGN(ROBOT, RULES, 400, 20, 1, functools.partial(broken, change=change))
            assert monitor.wrong[name], name


def test_it_decides_alike_in_numpy_and_jax_at_any_batch_shape(quick_jit):
    jax = pytest.importorskip("jax")
    compiled = quick_jit(gate)

    def step(rules, state, given):
        expected = gate(rules, state, given)
        pairs = map_arrays(lambda each: each.reshape(2, 3, *each.shape[1:]), (state, given))
        found = compiled(rules, *pairs)
        for one, other in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
            assert one.dtype == other.dtype
            assert_allclose(np.asarray(other).reshape(one.shape), one, atol=3e-5)
        return expected

    with np.errstate(invalid="ignore"):
        CAMPAIGN(ROBOT, RULES, 6, 200, 2, step)


def test_a_configuration_narrows_the_limits_and_never_widens_them(refused):
    yaw = af.Robot.paper().limits.yaw.replace(low=-1.0, high=1.2, max_rate=3.0, max_acceleration=50.0)
    rules = gate_rules(ROBOT, TASK, GateConfig(yaw=yaw, shots_per_s=5))
    narrow = [ROBOT.limits.pitch.low, -1, ROBOT.limits.pitch.high, 1.2, 12, 3, 100, 50]
    assert_allclose(np.ravel(rules.limits[:4]), narrow, rtol=2e-5)
    assert (rules.interval, rules.near) == (F(0.2), F(1e6))
    assert (RULES.stale, RULES.lost, RULES.steady, RULES.unseen, RULES.interval) == (*F([0.05, 0.1, 0.5, 0.25]), 0)
    assert gate_rules(ROBOT, TASK.replace(period_s=0.04)).late == F(0.1)
    for wrong in ({"low": -1.4}, {"high": 1.4}, {"max_rate": 12.1}, {"max_acceleration": 61}):
        config = GateConfig(yaw=yaw.replace(**wrong))
        refused(
            "gate.yaw: expected limits within AxisLimits.*; narrow them, or remove", gate_rules, ROBOT, TASK, config
        )
    config = GateConfig(pitch=ROBOT.limits.pitch.replace(low=-0.5))
    refused("gate.pitch: expected limits within", gate_rules, ROBOT, TASK, config)
    refused("there is no field stale_s", lambda: GateConfig(stale_s=9.0))
    refused("shots_per_s", lambda: GateConfig(shots_per_s=0.0))
    slow = TASK.replace(period_s=0.05)
    refused("task any: period_s: the gate needs at most 40 ms between decisions, got 50 ms", gate_rules, ROBOT, slow)
    refused("take gate or box", gate_rules, ROBOT, TASK.replace(command_limit="los-2deg"))
