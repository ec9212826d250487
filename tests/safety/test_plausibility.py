"""The identified plant as a watchdog: faults of the feedback that no checksum shows."""

from pathlib import Path

import numpy as np

import archerfish as af
from archerfish.dynamics.linear_axis import advance, gimbal_angle, rest_state
from archerfish.safety.plausibility import THRESHOLD_RAD, compare_with_prediction, resting_prediction

MODEL = af.Robot.load(Path(__file__).parents[1] / "infantry").gimbal(0.02)
FAULTS = {  # of the angle in a decision, and after how many of them it is implausible at the latest
    "none": (lambda angles: angles[-1], None),
    "yaw has the other sign": (lambda angles: angles[-1] * [1, -1], 3),
    "degrees": (lambda angles: np.degrees(angles[-1]), 3),
    "axes exchanged": (lambda angles: angles[-1][::-1], 3),
    "0.05 rad off": (lambda angles: angles[-1] + [0.0, 0.05], 3),
    "0.2 s late": (lambda angles: angles[-11], 15),
    "stuck": (lambda angles: angles[99], 25),
    "not finite": (lambda angles: np.full(2, np.nan), None),  # which the gate finds by itself
}


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
            THRESHOLD_RAD,
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
    assert all(found[name] <= within for name, (_, within) in FAULTS.items() if within)


def test_the_prediction_begins_again_where_nothing_was_sent_and_does_not_judge_a_gimbal_that_was_moving():
    far, sent, none = np.array([0.0, 0.5]), np.array(True), np.array(False)
    past, _ = compare_with_prediction(
        MODEL, 0.03, resting_prediction(MODEL, 0 * far), 0 * far, none, far, np.array(0.0)
    )
    assert np.allclose(gimbal_angle(MODEL, past.plant), far, atol=1e-3)
    judged = []
    for _ in range(15):
        past, plausible = compare_with_prediction(MODEL, 0.03, past, far, sent, far + 0.04, np.array(0.0))
        judged.append(bool(plausible))
    assert judged == [True] * 12 + [False] * 3
    past, plausible = compare_with_prediction(MODEL, 0.03, past, far, sent, far, np.array(0.0))
    assert plausible


def test_the_age_of_the_feedback_is_taken_off_by_the_rate():
    past = both = resting_prediction(MODEL, np.zeros((2, 2)))
    ages = np.array([0.02, 0.0])
    for yaw in 0.04 * np.arange(40):  # 2 rad/s
        command = np.array([[0.0, yaw]] * 2)
        late = gimbal_angle(MODEL, advance(MODEL, past.plant, command)) - [0.0, 0.04]
        past, both = compare_with_prediction(MODEL, 0.03, past, command, np.full(2, True), late, ages)
    assert both.tolist() == [True, False]
