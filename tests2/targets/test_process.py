"""The mixtures that trainings draw, and the random process with habits: statistics against hand calculation.

Bounds on shares are five standard deviations: were seeds free, one alarm in a million would be false.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.targets.mixture import MIXTURES
from archerfish2.targets.motion import STEP_S, ZERO
from archerfish2.targets.process import LEGS, PROCESS_UNIFORMS, random_process
from archerfish2.task import Task

ACCELERATION, RATE, LEFT, DWELL, DWELL_VARIES, SPEED_VARIES, REST, KEEPS, FORM, LONG = 0, 2, 3, 4, 5, 7, 8, 9, 10, 11


@pytest.fixture(scope="module")
def two_legs():
    """Draw targets of which all legs last 2 s; return uniforms, displacements, and velocities of the first two legs."""
    uniforms = np.random.default_rng(8).random((4000, PROCESS_UNIFORMS))
    uniforms[:, [LEFT, DWELL, DWELL_VARIES, LONG]] = 1.0, 1.0, 0.0, 1.0
    uniforms[:2500, REST] = np.repeat([0.5, 1.0], [2000, 500])
    moved = np.concatenate([random_process(each, np.ones(len(each))) for each in np.split(uniforms, 10)])
    return uniforms, moved, (moved[:, [100, 200]] - moved[:, [99, 199]]) / STEP_S  # at the ends of the legs


def check_share(found, share):
    assert abs(np.mean(found) - share) < 5.0 * (share * (1.0 - share) / len(found)) ** 0.5


def test_targets_drive_and_stand_as_often_and_as_fast_as_their_distributions_have_it(two_legs):
    uniforms, moved, velocity = two_legs
    speed = np.linalg.norm(velocity, axis=-1)
    drives = speed > 1e-9
    check_share(drives[:2000].ravel(), 1.0 - 0.9 * 0.5**1.57)
    check_share(drives[2000:2500].ravel(), 0.1)
    check_share(drives[2500:, 0], 1.0 - 0.9 / 2.57)
    assert speed[drives].min() > 0.1 - 1e-9
    assert speed[drives].max() < 2.5 + 1e-9
    check_share(speed[drives[:, 0], 0] < 0.5, 0.5)  # the logarithm's middle of 0.1 and 2.5
    assert_allclose(moved[:, ZERO], 0.0)
    both, varies = np.all(drives, axis=1), uniforms[:, SPEED_VARIES]
    departs = np.abs(np.log(speed[both, 1] / speed[both, 0]))
    assert np.all(departs <= np.log(25.0) * varies[both] + 1e-9)


def test_directions_change_by_the_habits(two_legs):
    uniforms, _, velocity = two_legs
    chosen = np.all(np.linalg.norm(velocity, axis=-1) > 1e-9, axis=1)
    uniforms, (first, then) = uniforms[chosen], np.moveaxis(velocity[chosen], 1, 0)
    sine = np.linalg.det(velocity[chosen]) / np.linalg.norm(first, axis=-1) / np.linalg.norm(then, axis=-1)
    line, steady = uniforms[:, FORM] < 0.6, uniforms[:, FORM] >= 0.8
    assert_allclose(sine[line], 0.0, atol=1e-9)
    assert np.all(np.abs(sine[~line & ~steady]) < np.sin(0.6))
    assert_allclose(np.abs(sine[steady]), np.abs(np.sin(2.0 * (3.0 * uniforms[steady, RATE] - 1.5))), atol=1e-9)
    check_share(np.sum(first * then, axis=-1)[line & (uniforms[:, KEEPS] > 0.5)] > 0.0, 0.75)


def test_legs_last_for_the_usual_dwell_of_the_target_or_for_their_own():
    uniforms = np.random.default_rng(9).random((40, PROCESS_UNIFORMS))
    uniforms[:, [ACCELERATION, LEFT, SPEED_VARIES, REST, KEEPS, FORM, LONG]] = 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0
    uniforms[:, DWELL_VARIES] = np.repeat([0.0, 1.0], 20)
    uniforms[:20, DWELL], uniforms[20:, 12 : 12 + LEGS] = 2 * [np.log(4.0) / np.log(20.0)]  # 0.4 s, of 0.1 to 2 s
    moved = random_process(uniforms, np.ones(40))
    assert_allclose(moved[:, 60:], moved[:, 20:-40], atol=1e-9)  # to and fro from 0.1 s on: every 0.8 s it is the same
    uniforms[:, LONG] = 0.2
    moved = np.diff(random_process(uniforms, np.ones(40)), axis=1)
    assert_allclose(np.ptp(moved[:, 20:124], axis=1), 0.0, atol=1e-9)  # straight on until 2.2 s


def test_legs_longer_than_their_ramp_change_speed_at_the_targets_acceleration(two_legs):
    uniforms, moved, velocity = two_legs
    most = np.max(np.linalg.norm(np.diff(moved, 2, axis=1), axis=-1), axis=1) / STEP_S**2
    drawn = 3.0 * 5.0 ** uniforms[:, ACCELERATION]
    assert np.all(most <= drawn * (1.0 + 1e-9))
    long = np.linalg.norm(velocity[:, 1] - velocity[:, 0], axis=-1) > 2.0 * STEP_S * drawn
    assert_allclose(most[long], drawn[long])


@pytest.mark.parametrize("name", MIXTURES)
def test_a_training_mixes_the_motions_by_their_weights(name):
    counts = {"any": [4, 12, 10, 8, 8, 6, 38, 114], "kinds": [30, 15, 50, 10, 50, 6, 6, 20, 60]}[name]
    scenario, total = Task.load(name).scenario(), sum(counts)
    drawn = np.full((total, scenario.uniforms), 0.4)
    drawn[:, 6] = (np.arange(total) + 0.5) / total  # which kind: spaced evenly, so that no alarm is by accident
    places = scenario.draw(drawn).target.motion.places
    ends = np.flatnonzero([True, *np.any(np.abs(places[1:] - places[:-1]) > 1e-6, axis=(1, 2)), True])
    assert np.diff(ends).tolist() == counts
