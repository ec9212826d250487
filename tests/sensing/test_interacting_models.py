import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from archerfish.sensing.interacting_models import (
    ONWARD,
    STILL,
    TURNED,
    ModelRates,
    begin_models,
    step_models,
    transition_probabilities,
)
from archerfish.sensing.kalman_filter import TrackerNoise, begin_track, measurement_covariance, predict, update

NOISE = TrackerNoise(*(np.asarray(each) for each in (0.6, 0.02, 0.004, 0.0, 0.001, 0.3)))
RATES = ModelRates(*(np.asarray(each) for each in (1.5, 0.2, 0.4)))
DT = 0.02
FRESH = np.asarray(True)


def turning(count: int, turn: int = 0, speed: float = 0.4) -> np.ndarray:
    """A target that drives left at 3 m and turns back at a step, seen with noise."""
    rng = np.random.default_rng(41)
    steps = np.arange(count)
    lateral = DT * speed * (np.minimum(steps, turn) - np.maximum(steps - turn, 0) if turn else steps)
    path = np.stack([np.full(count, 3.0), lateral - 0.2, np.full(count, 0.1)], axis=-1)
    return path + rng.normal(0.0, 0.004, path.shape)


def follow(plates, noise=NOISE, rates=RATES):
    tracks = begin_models(noise, rates, plates[0])
    for plate in plates[1:]:
        tracks = step_models(noise, rates, tracks, np.asarray(DT, plate.dtype), plate, FRESH)
    return tracks


def by_hand(plates: np.ndarray) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """The filter of Blom and Bar-Shalom with whole matrices: mix, predict, update, weigh."""
    one, none = np.eye(2), np.zeros((2, 2))
    carry, half = (np.block([[one, t * one], [none, one]]) for t in (DT, DT / 2))
    turn, halt = np.block([[one, DT * one], [none, -one]]), np.block([[one, none], [none, none]])
    stop = halt @ half
    begin = np.diag([0.0, 0.0, 0.09, 0.09])
    jumps = [[halt, halt, halt], [stop, np.eye(4), turn], [stop, turn, np.eye(4)]]
    push = np.vstack([DT**2 / 2 * one, DT * one])
    driven = [np.zeros((4, 4)), *[0.36 * push @ push.T] * 2]
    change = transition_probabilities(RATES, np.asarray(DT))
    first = measurement_covariance(NOISE, plates[0])
    means = [np.concatenate([plates[0, :2], [0.0, 0.0]])] * 3
    covariances = [np.block([[first, none], [none, s * one]]) for s in (0.0, 0.09, 0.09)]
    chance = np.array([0.4, 0.6, 0.0])
    for plate in plates[1:]:
        before = chance @ change
        mixed = []
        for j in range(3):
            share = chance * change[:, j] / before[j]
            begun = [jumps[i][j] @ means[i] for i in range(3)]
            spread = [jumps[i][j] @ covariances[i] @ jumps[i][j].T + (begin if i == 0 < j else 0.0) for i in range(3)]
            mean = sum(s * m for s, m in zip(share, begun, strict=True))
            mixed.append(
                (
                    mean,
                    sum(s * (p + np.outer(m - mean, m - mean)) for s, m, p in zip(share, begun, spread, strict=True)),
                )
            )
        means, covariances, likelihood = [], [], []
        for (mean, covariance), q in zip(mixed, driven, strict=True):
            mean, covariance = carry @ mean, carry @ covariance @ carry.T + q
            spread = covariance[:2, :2] + measurement_covariance(NOISE, plate)
            likelihood.append(multivariate_normal(mean[:2], spread).pdf(plate[:2]))
            gain = covariance[:, :2] @ np.linalg.inv(spread)
            means.append(mean + gain @ (plate[:2] - mean[:2]))
            covariances.append(covariance - gain @ covariance[:2])
        chance = before * likelihood / np.sum(before * np.array(likelihood))
    return chance, means, covariances


@pytest.mark.parametrize("count", [2, 3, 40])
def test_the_filter_is_that_of_blom_and_bar_shalom(count) -> None:
    chance, means, covariances = by_hand(turning(count, 25))
    tracks = follow(turning(count, 25))
    assert_allclose(tracks.probability, chance, rtol=1e-7, atol=1e-12)
    for index in range(3):
        assert_allclose(tracks.track.mean[index], means[index], rtol=1e-7, atol=1e-9)
        assert_allclose(tracks.track.covariance[index], covariances[index], rtol=1e-6, atol=1e-12)


def test_where_nothing_changes_it_is_the_plain_kalman_filter() -> None:
    plates = turning(40, 25)
    tracks = follow(plates, rates=ModelRates(*(np.asarray(0.0) for _ in range(3))))
    track = begin_track(NOISE, plates[0])
    for plate in plates[1:]:
        track = update(NOISE, predict(NOISE, track, np.asarray(DT)), plate, FRESH)
    assert_allclose(tracks.probability, [0.0, 1.0, 0.0], atol=1e-12)
    assert_allclose(tracks.track.mean[ONWARD], track.mean, rtol=1e-12)
    assert_allclose(tracks.track.covariance[ONWARD], track.covariance, rtol=1e-12, atol=1e-18)


def test_changes_follow_a_markov_process_in_time() -> None:
    # Turns alone are exact for any time; stops and starts to the first order.
    rates = RATES._replace(stop=np.asarray(0.0))
    generator = 1.5 * np.array([[0.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 1.0, -1.0]])
    for time in (0.02, 0.3, 2.0):
        assert_allclose(transition_probabilities(rates, np.asarray(time)), expm(generator * time), atol=1e-12)
    assert_allclose(np.sum(transition_probabilities(RATES, np.asarray(0.4)), axis=-1), 1.0)


def test_a_turn_is_noticed_and_the_velocity_kept() -> None:
    before, after = follow(turning(25, 25)), follow(turning(31, 25))
    assert before.probability[ONWARD] > 0.9
    assert before.track.mean[ONWARD, 3] == pytest.approx(0.4, abs=0.05)
    # Six sights after the turn, 5 cm on the way back.
    assert after.probability[TURNED] > 0.9
    assert after.track.mean[TURNED, 3] == pytest.approx(-0.4, abs=0.06)
    track = begin_track(NOISE, turning(31, 25)[0])
    for plate in turning(31, 25)[1:]:
        track = update(NOISE, predict(NOISE, track, np.asarray(DT)), plate, FRESH)
    assert track.mean[3] > 0.0  # the same filter alone still believes that it goes on


def test_a_target_that_stands_is_found_to_and_one_that_starts_too() -> None:
    plates = np.concatenate([turning(40, speed=0.0), turning(25) + np.array([0.0, 8e-3, 0.0])])
    standing, started = follow(plates[:40]), follow(plates)
    assert standing.probability[STILL] > 0.8
    assert np.all(standing.track.mean[STILL, 2:] == 0.0)
    assert started.probability[STILL] < 0.02
    moving = started.probability[ONWARD:] @ started.track.mean[ONWARD:, 3]
    assert moving == pytest.approx(0.4, abs=0.05)


def test_a_sight_that_is_not_new_leaves_only_time_to_pass() -> None:
    tracks = follow(turning(20))
    later = step_models(NOISE, RATES, tracks, np.asarray(0.1), np.array([9.0, 9.0, 9.0]), np.asarray(False))
    assert_allclose(later.probability, tracks.probability @ transition_probabilities(RATES, np.asarray(0.1)))
    same = step_models(NOISE, RATES, tracks, np.asarray(0.0), np.array([9.0, 9.0, 9.0]), np.asarray(False))
    assert_allclose(same.probability, tracks.probability, atol=1e-12)
    assert_allclose(same.track.mean[ONWARD], tracks.track.mean[ONWARD], atol=1e-12)


def test_it_stays_a_probability_in_float32() -> None:
    noise, rates = (type(each)(*(np.float32(value) for value in each)) for each in (NOISE, RATES))
    rng = np.random.default_rng(42)
    plates = np.concatenate([turning(200, 100), turning(200, speed=0.0)]).astype(np.float32)
    tracks = begin_models(noise, rates, plates[0])
    for plate in plates[1:]:
        elapsed = np.float32(DT * rng.integers(0, 3))
        tracks = step_models(noise, rates, tracks, elapsed, plate, np.asarray(elapsed > 0.0))
        assert tracks.probability.dtype == tracks.track.covariance.dtype == np.float32
        assert math.isclose(tracks.probability.sum(), 1.0, abs_tol=1e-5)
        assert np.all(np.linalg.eigvalsh(tracks.track.covariance.astype(np.float64)) > -1e-9)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(43)
    plates = rng.uniform(1.0, 1.02, (3, *shape, 3)) * [3.0, -0.5, 0.1]
    fresh = np.asarray(rng.random(shape) < 0.7)

    def everything(noise, rates, plates, elapsed, fresh):
        tracks = begin_models(noise, rates, plates[0], fresh)
        for plate in plates[1:]:
            tracks = step_models(noise, rates, tracks, elapsed, plate, fresh)
        return tracks

    tracks = agree_in_jax(everything, NOISE, RATES, plates, np.full(shape, DT), fresh, rtol=1e-4, atol=1e-5)
    assert tracks.probability.shape == (*shape, 3)
    assert tracks.track.mean.shape == (*shape, 3, 4)


def test_looks_at_one_sight_leave_the_covariance_as_it_is_however_their_times_round() -> None:
    # Rounding can make the time between two looks at one sight negative. In float32 that was enough for a negative
    # probability, and then for a covariance that no target has.
    plates = turning(40)
    rare = follow(plates)._replace(probability=np.array([1e-4, 0.9999 - 1e-8, 1e-8]))
    later = step_models(NOISE, RATES, rare, np.asarray(-6e-8), plates[-1], np.asarray(False))
    assert np.all(later.probability >= 0.0)
    assert_allclose(later.track.covariance, rare.track.covariance, atol=1e-6)
