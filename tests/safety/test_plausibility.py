"""The identified plant as a watchdog: faults of the feedback that no checksum shows."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import archerfish as af
from archerfish.dynamics.linear_axis import advance, gimbal_angle, gimbal_rate, rest_state
from archerfish.safety.gate import GateInput, Mode, Reason, gate, resting_gate
from archerfish.safety.plausibility import THRESHOLD_RAD, compare_with_prediction, resting_prediction, thresholds
from archerfish.safety.rules import gate_rules

ROBOT = af.Robot.load(Path(__file__).parents[1] / "infantry")
MODEL = ROBOT.gimbal(0.02)
LIMIT = np.array(0.03)
SENT, NOT_SENT, FRESH = np.array(True), np.array(False), np.array(0.0)
FAULTS = {  # of the angle in a decision, and after how many of them it is implausible at the latest
    "none": (lambda angles: angles[-1], None),
    "yaw has the other sign": (lambda angles: angles[-1] * [1, -1], 3),
    "pitch has the other sign": (lambda angles: angles[-1] * [-1, 1], 3),
    "degrees": (lambda angles: np.degrees(angles[-1]), 3),
    "axes exchanged": (lambda angles: angles[-1][::-1], 3),
    "yaw 0.05 rad off": (lambda angles: angles[-1] + [0.0, 0.05], 3),
    "pitch 0.05 rad off": (lambda angles: angles[-1] - [0.05, 0.0], 3),
    "0.2 s late": (lambda angles: angles[-11], 11),
    "stuck": (lambda angles: angles[99], 11),
    "not finite": (lambda angles: np.full(2, np.nan), None),  # which the gate finds by itself
}


def judged(offsets, commands=None, threshold=0.01, past=None, ages=0.0):
    """Whether feedback that is off the prediction by so much was plausible, decision by decision, and what is kept."""
    offsets, threshold = np.array(offsets, float), np.array(threshold)
    commands = np.zeros_like(offsets) if commands is None else np.array(commands, float)
    past, found = past or resting_prediction(MODEL, commands[0]), []
    for offset, command in zip(offsets, commands, strict=True):
        plant = advance(MODEL, past.plant, command)
        angle = gimbal_angle(MODEL, plant) - ages * gimbal_rate(MODEL, plant) + offset
        past, plausible = compare_with_prediction(MODEL, threshold, past, command, SENT, angle, np.array(ages))
        found.append(bool(plausible))
    return found, past


def test_faults_of_the_feedback_are_found_within_some_decisions_and_good_feedback_is_plausible():
    rng, times = np.random.default_rng(3), 0.02 * np.arange(200)
    commands = np.stack([0.1 * np.sin(2.0 * times), 0.1 + 0.3 * np.sin(4.0 * times)], axis=-1)
    plant, angles = rest_state(MODEL, commands[0]), [commands[0]]
    for command in commands[:-1]:
        plant = advance(MODEL, plant, command)
        angles.append(gimbal_angle(MODEL, plant) + rng.normal(0.0, 2e-3, 2))
    past, found = resting_prediction(MODEL, np.array([angles[0]] * len(FAULTS))), dict.fromkeys(FAULTS)
    for at in range(1, 200):
        seen = [change(angles[: at + 1]) if at >= 100 else angles[at] for change, _ in FAULTS.values()]
        past, plausible = compare_with_prediction(
            MODEL,
            thresholds(ROBOT),
            past,
            commands[at - 1],
            np.full(len(FAULTS), True),
            np.array(seen),
            np.zeros(len(seen)),
        )
        for name in np.array([*FAULTS])[~plausible]:
            found[name] = found[name] or at - 99
    assert {name: within is not None for name, (_, within) in FAULTS.items()} == {
        k: v is not None for k, v in found.items()
    }
    assert all(found[name] <= within for name, (_, within) in FAULTS.items() if within), found


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_three_decisions_in_a_row_above_the_threshold_are_implausible_until_the_first_one_below(axis, sign):
    large, small = sign * 0.011 * np.eye(2)[axis], sign * 0.009 * np.eye(2)[axis]
    still = [[0, 0]] * 11
    assert judged([*still, large, large, large, large, small, large, large])[0][10:] == [
        *(True, True, True, False, False),
        *(True, True, True),
    ]
    assert all(judged([*still, *[large, large, small] * 9])[0])
    assert all(judged(still * 3, threshold=0.0)[0])
    assert all(judged([*still, *[large] * 9], threshold=np.array([1.0, 1.0]) - 0.99 * np.eye(2)[1 - axis])[0])
    assert not all(judged([*still, *[large] * 9], threshold=np.array([1.0, 1.0]) - 0.99 * np.eye(2)[axis])[0])


def test_the_prediction_begins_again_where_nothing_was_sent_and_does_not_judge_a_gimbal_that_was_moving():
    far = np.array([0.1, 0.5])
    _, past = judged([[0, 0]] * 5, [[0, 0], [0.2, 0.4], *[[0, 0]] * 3])
    assert np.all(past.lead > 0.01)
    past, plausible = compare_with_prediction(MODEL, LIMIT, past, 0 * far, NOT_SENT, far, FRESH)
    assert_array_equal(past.plant, rest_state(MODEL, far))
    assert (plausible, past.decisions, past.above, past.lead.tolist()) == (True, 0, 0, [0, 0])
    found, past = judged([[0, 0.04]] * 15, [far] * 15, LIMIT, past)
    assert found == [True] * 12 + [False] * 3
    assert (past.decisions, past.above) == (15, 5)
    past, plausible = compare_with_prediction(MODEL, LIMIT, past, far, SENT, far, FRESH)
    assert plausible
    for angle, begins_at in (
        ([0.0, 1000.0], [0.0, 1000.0]),
        ([0.0, 1001.0], far),
        ([np.nan, 0.0], far),
        ([0.0, -np.inf], far),
    ):
        past, _ = compare_with_prediction(MODEL, LIMIT, past, far, NOT_SENT, np.array(angle), FRESH)
        assert_array_equal(past.plant, rest_state(MODEL, np.array(begins_at)))


def test_the_age_of_the_feedback_is_taken_off_by_the_rate():
    commands = [[0.5 * yaw, yaw] for yaw in 0.04 * np.arange(30)]  # 2 rad/s
    late = [*[[0, 0]] * 20, *[[-0.02, -0.04]] * 10]
    assert all(judged(0 * np.array(late), commands, ages=0.02)[0])
    assert not all(judged(late, commands, threshold=0.005)[0])
    past, plausible = resting_prediction(MODEL, np.zeros((2, 2))), None
    ages = np.array([0.02, 0.0])
    for command in commands:
        command = np.array([command] * 2)
        angle = gimbal_angle(MODEL, advance(MODEL, past.plant, command)) - [0.02, 0.04]
        past, plausible = compare_with_prediction(MODEL, LIMIT / 6, past, command, np.full(2, True), angle, ages)
    assert plausible.tolist() == [True, False]


def test_more_is_tolerated_while_the_command_leads_and_for_a_moment_after_it():
    """The tolerance by hand: 10 mrad, and 5/rad of the largest lead's square, which loses 5 % in every decision."""
    commands = [[0, 0]] * 11 + [[0.1, -0.2]] * 40
    plant, lead, leads = rest_state(MODEL, np.zeros(2)), np.zeros(2), []
    for command in commands:
        plant = advance(MODEL, plant, np.array(command, float))
        distance = np.abs(command - gimbal_angle(MODEL, plant))
        lead = np.where(distance > 0.95 * lead, distance, 0.95 * lead)
        leads.append(lead)
    tolerated = 0.01 + 5.0 * np.array(leads) ** 2
    assert (0.1 < tolerated[13, 1] < 0.21, tolerated[-1, 1] < 0.02) == (True, True)
    for axis in (0, 1):
        for sign in (-1, 1):
            offsets = sign * tolerated * np.eye(2)[axis]
            assert all(judged(0.999 * offsets, commands)[0])
            assert judged(1.001 * offsets, commands)[0] == [True] * 12 + [False] * 39


def test_the_threshold_of_an_axis_is_ten_times_its_validation_residual_within_10_and_30_mrad():
    def of(pitch, yaw):
        plants = {axis: getattr(ROBOT, axis) for axis in ("pitch", "yaw")}
        residuals = {"pitch": pitch, "yaw": yaw}
        return thresholds(
            ROBOT.replace(**{axis: plants[axis].replace(validation_residual=residuals[axis]) for axis in plants})
        )

    assert_allclose(of(0.0012, 0.0025), [0.012, 0.025], rtol=1e-6)
    assert_allclose(of(0.0, 0.5), [0.01, 0.03], rtol=1e-6)
    assert_allclose(of(None, 0.002), [THRESHOLD_RAD, 0.02], rtol=1e-6)
    assert_array_equal(thresholds(af.Robot.paper()), np.float32([0.03, 0.03]))
    assert_allclose(thresholds(ROBOT), [0.013562, 0.01], rtol=1e-6)
    assert thresholds(ROBOT).dtype == np.float32


def test_nothing_is_fired_at_a_robot_with_exchanged_axes():
    """Armed in the moment in which the prediction can't judge yet; the command moves the wrong axis."""
    rules, state = gate_rules(ROBOT, af.Task.load("any")), resting_gate(np.zeros(2, np.float32))
    plant, past, fired, causes = rest_state(MODEL, np.zeros(2)), resting_prediction(MODEL, np.zeros(2)), 0, set()
    for at in range(100):
        plant = advance(MODEL, plant, state.command)
        angle = gimbal_angle(MODEL, plant)[::-1].astype(np.float32)
        is_sent = state.mode != Mode.DISARMED
        past, plausible = compare_with_prediction(MODEL, thresholds(ROBOT), past, state.command, is_sent, angle, FRESH)
        given = GateInput(
            elapsed=np.float32(0.02),
            desired=np.float32([0.05, 0.3]),
            fire=np.array(True),
            switch_on=np.array(at > 30),
            angle=angle,
            feedback_age=np.float32(0.0),
            plate_age=np.float32(0.03),
            base_yaw=np.float32(0.0),
            shots_left=np.float32(9.0),
            plausible=plausible,
        )
        state, verdict = gate(rules, state, given)
        fired += int(verdict.fire)
        causes.add((Mode(int(verdict.mode)).name, Reason(int(verdict.cause)).name))
    assert fired == 0
    assert {("ARMED", "NONE"), ("HOLD", "IMPLAUSIBLE"), ("FAULT", "IMPLAUSIBLE")} <= causes


def test_it_judges_alike_in_numpy_and_jax_at_any_batch_shape(quick_jit):
    jax = pytest.importorskip("jax")
    compiled, rng = quick_jit(compare_with_prediction), np.random.default_rng(0)
    for shape in ((), (3,), (2, 3)):
        past = found = resting_prediction(MODEL, np.zeros((*shape, 2)))
        for _ in range(40):
            command, angle = rng.normal(0.0, 0.02, (2, *shape, 2))
            rest = command, rng.random(shape) < 0.99, angle, np.full(shape, 0.002)
            past, plausible = compare_with_prediction(MODEL, thresholds(ROBOT), past, *rest)
            found, also = compiled(MODEL, thresholds(ROBOT), found, *rest)
            assert_array_equal(also, plausible)
            for one, other in zip(jax.tree.leaves(past), jax.tree.leaves(found), strict=True):
                assert_allclose(other, one, atol=1e-5)
