import numpy as np
import pytest

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.evaluation.bounds.aim_problem import aim_problem, suite_parts
from archerfish.evaluation.bounds.combined import combined_bound
from archerfish.evaluation.bounds.engagement_bounds import engagement_bounds
from archerfish.evaluation.bounds.hit_chance import hit_chance
from archerfish.evaluation.bounds.information import aim_chances, make_prior
from archerfish.evaluation.bounds.reach import Interval, best_chance
from archerfish.evaluation.bounds.sights import sights
from archerfish.sensing.interfaces import fire_always

RADIUS = 0.06
STILL_FAR, MOVING_FAR = 3, 7
"""Indices of the suites at 4–5 m."""


def parts(shooting, suite: int, engagements: int = 2, **options):
    """Problem, sights and scenario of one suite."""
    world, trials = shooting("gate", engagements, **options)
    met, draws = suite_parts(trials, suite)
    return aim_problem(world, met, draws, RADIUS), sights(world, met, draws), trials.suites[suite].scenario


def centred(problem) -> np.ndarray:
    """Chance of shots at the armor's centre, shape (E, T)."""
    return hit_chance(np.zeros(2), problem.geometry.sd, problem.radius)


@pytest.mark.parametrize("suite", [STILL_FAR, MOVING_FAR])
def test_with_exact_sights_an_aim_hits_as_often_as_one_at_the_centre(shooting, suite) -> None:
    problem, seen, scenario = parts(shooting, suite)
    for engagement in range(2):
        found = aim_chances(
            problem.pick(slice(engagement, engagement + 1)), seen.pick(engagement), make_prior(scenario)
        )
        best = found.offset[np.arange(50), found.chance.argmax(axis=-1)]
        # Of a moving target one sight shows neither speed nor heading; two show all.
        known = slice(0 if suite == STILL_FAR else 1, None)
        np.testing.assert_allclose(found.chance.max(axis=-1)[known], centred(problem)[engagement, known], atol=1e-3)
        assert np.all(np.abs(best[known]) < 0.012)
    if suite == MOVING_FAR:
        assert found.chance.max(axis=-1)[0] < 0.9


def test_of_a_still_target_the_chance_is_that_of_two_errors_together(shooting) -> None:
    problem, seen, scenario = parts(shooting, STILL_FAR, robot=True)
    one, own = problem.pick(slice(0, 1)), seen.pick(0)
    found = aim_chances(one, own, make_prior(scenario))
    # The bearing is the mean of the frames so far; all weigh alike.
    frames = np.cumsum(own.fresh)
    sd = one.geometry.sd[0].copy()
    per_yaw = one.geometry.x[0] / np.cos(one.geometry.bearing[0]) ** 2
    sd[:, 1] = np.hypot(sd[:, 1], per_yaw * own.bearing_sd / np.sqrt(frames))
    np.testing.assert_allclose(found.chance.max(axis=-1), hit_chance(np.zeros(2), sd, RADIUS), atol=2e-3)


def test_the_aims_hit_as_often_as_the_filter_claims(shooting) -> None:
    # 30 engagements: the claim and what its aims hit differ by more than 4 standard errors once in 3,000 seeds.
    problem, seen, scenario = parts(shooting, MOVING_FAR, 30, robot=True, seed=3)
    prior, difference = make_prior(scenario, 24, 96), []
    for engagement in range(30):
        one = problem.pick(slice(engagement, engagement + 1))
        found = aim_chances(one, seen.pick(engagement), prior)
        aim = found.offset[np.arange(50), found.chance.argmax(axis=-1)]
        hit = best_chance(one, np.stack([0.0 * aim, aim])[None])[0]
        difference.append(np.mean(found.chance.max(axis=-1) - hit))
        assert np.mean(found.chance.max(axis=-1)) < np.mean(centred(one)) - 0.01
    assert abs(np.mean(difference)) < 4 * np.std(difference) / np.sqrt(30)


def test_the_combined_bound_is_below_what_either_leaves_and_above_an_aim_that_is_flown(shooting) -> None:
    world, trials = shooting("gate", 2, robot=True)
    found = engagement_bounds(world, trials, MOVING_FAR, RADIUS, 18)
    assert found.unsolved == 0
    assert np.all(found.combined <= found.information)
    assert np.all(found.hindsight <= found.reach)
    # Slewing costs at least three shots, early ignorance more.
    assert np.all(found.combined < found.information - 0.02)
    assert np.all(found.combined > 0.6)


def test_without_inertia_the_combined_bound_is_that_of_the_information(shooting) -> None:
    problem, seen, scenario = parts(shooting, MOVING_FAR, 1, robot=True)
    everything = np.full((1, 2, 50), 2.0)
    # Aims that follow the commands at once, whatever these were before.
    free = problem._replace(
        response=np.stack([np.eye(50)] * 2)[None],
        low=-everything,
        high=everything,
        step=np.full(2, np.inf),
        bend=np.full(2, np.inf),
    )
    chances = aim_chances(free, seen.pick(0), make_prior(scenario))
    found, solved = combined_bound(free, Interval(-everything, everything), chances, 10, 1.04)
    assert solved
    expected = chances.chance.max(axis=-1).sum()
    assert expected - 1e-3 <= found <= expected + 0.3


def test_sights_of_the_camera_are_those_of_a_gimbal_at_rest(shooting) -> None:
    world, trials = shooting("gate", 2, robot=True)
    seen = sights(world, trials.engagements, trials.draws)
    state, shown = world.reset(trials.engagements, trials.draws)
    for decision in range(50):
        plate = np.asarray(shown.plate[:, 0], np.float64)
        np.testing.assert_allclose(seen.bearing[:, decision], np.arctan2(plate[:, 1], plate[:, 0]), atol=1e-5)
        np.testing.assert_allclose(seen.exposed[:, decision], 0.02 * decision - shown.plate_age[:, 0], atol=1e-5)
        if decision > 0:
            np.testing.assert_array_equal(seen.fresh[:, decision], shown.fresh[:, 0])
        held = map_arrays(lambda each: 0.0 * each, shown.angle)
        state, shown, _ = world.step(state, fire_always(held))


def test_noisy_sights_of_another_kind_bound_nothing(shooting) -> None:
    world, trials = shooting("gate", 1)
    noisy = world._replace(position_noise=np.full(2, 0.01, np.float32))
    assert sights(noisy, trials.engagements, trials.draws) is None
    found = engagement_bounds(noisy, trials, MOVING_FAR, RADIUS, 16)
    assert np.all(np.isnan(found.combined))
    assert np.all(found.hindsight <= found.reach)
