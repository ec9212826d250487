"""Kalman filter and interacting models against textbooks."""

import functools

import numpy as np
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from archerfish2.tracking import interacting_models as imm
from archerfish2.tracking import kalman_filter as kalman
from archerfish2.tracking.detections import unwrapped

NOISE = kalman.TrackerNoise(*(np.asarray(each) for each in (0.6, 0.02, 0.004, 0.01, 0.001, 0.3)))
RATES = imm.ModelRates(*(np.asarray(each) for each in (1.5, 0.2, 0.4)))
DT, FRESH = np.asarray(0.02), np.asarray(True)


def turning(count: int, turn: int) -> np.ndarray:
    """A target that drives left at 0.4 m/s and turns back at a step, seen with noise."""
    steps, noise = np.arange(count), np.random.default_rng(41).normal(0.0, 0.004, (count, 3))
    lateral = 0.008 * (np.minimum(steps, turn) - np.maximum(steps - turn, 0)) - 0.2
    return noise + np.stack([0.0 * steps + 3.0, lateral, 0.0 * steps + 0.1], axis=-1)


def follow(places) -> kalman.Track:
    def step(track, place):
        return kalman.update(NOISE, kalman.predict(NOISE, track, DT), place, FRESH)

    return functools.reduce(step, places[1:], kalman.begin_track(NOISE, places[0]))


def follow_models(noise, rates, places, fresh=FRESH) -> imm.ModelTracks:
    def step(tracks, place):
        return imm.step_models(noise, rates, tracks, 0.02 + 0.0 * place[..., 0], place, fresh)

    return functools.reduce(step, places[1:], imm.begin_models(noise, rates, places[0]))


def test_the_filter_is_that_of_any_textbook() -> None:
    step, push = np.eye(4) + DT * np.eye(4, k=2), np.vstack([DT**2 / 2 * np.eye(2), DT * np.eye(2)])
    places = turning(40, 25)
    level = np.hypot(*places[:, :2].T)
    angle, sd = (
        np.arctan2(places[:, 1], places[:, 0]),
        np.array([np.hypot(0.02, 0.01 * level), np.hypot(0.004, 0.001 * level)]),
    )
    turn = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), -1, 0)
    measured = turn * (sd.T**2)[:, None, :] @ np.swapaxes(turn, 1, 2)
    mean, covariance = np.append(places[0, :2], [0.0, 0.0]), 0.09 * np.eye(4)
    covariance[:2, :2] = measured[0]
    for index in range(1, 40):
        mean, covariance = step @ mean, step @ covariance @ step.T + 0.36 * push @ push.T
        spread = covariance[:2, :2] + measured[index]
        gain = covariance[:, :2] @ np.linalg.inv(spread)
        density = multivariate_normal(mean[:2], spread).logpdf(places[index, :2]) + np.log(2.0 * np.pi)
        before = kalman.predict(NOISE, follow(places[:index]), DT)
        assert_allclose(kalman.log_likelihood(NOISE, before, places[index]), density, rtol=1e-7)
        mean, covariance = mean + gain @ (places[index, :2] - mean[:2]), covariance - gain @ covariance[:2]
    assert_allclose(follow(places).mean, mean, rtol=1e-8, atol=1e-11)
    assert_allclose(follow(places).covariance, covariance, rtol=1e-7, atol=1e-13)


def test_models_that_never_change_are_the_plain_filter_and_changes_a_markov_process() -> None:
    tracks = follow_models(NOISE, imm.ModelRates(*[np.asarray(0.0)] * 3), turning(40, 25))
    assert_allclose(tracks.probability, [0.0, 1.0, 0.0], atol=1e-12)
    assert_allclose(tracks.track.mean[imm.ONWARD], follow(turning(40, 25)).mean, rtol=1e-12)
    turns = 1.5 * np.array([[0.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 1.0, -1.0]])
    found = imm.transition_probabilities(RATES._replace(stop=np.asarray(0.0)), np.asarray(0.3))
    assert_allclose(found, expm(0.3 * turns), atol=1e-12)


def test_numpy_and_jax_agree(batch, agree) -> None:
    places = np.random.default_rng(43).uniform(1.0, 1.02, (3, *batch, 3)) * [3.0, -0.5, 0.1]
    fresh = np.asarray(np.random.default_rng(44).random(batch) < 0.7)
    found = agree(follow_models, NOISE, RATES, places, fresh, rtol=1e-4, atol=1e-5)
    assert found.track.mean.shape == (*batch, 3, 4)


def test_yaw_goes_on_beyond_half_a_turn() -> None:
    assert_allclose(unwrapped(np.array([3.0, -3.0]), np.array([-3.0, 9.4])), [3.0, 4.0 * np.pi - 3.0])
