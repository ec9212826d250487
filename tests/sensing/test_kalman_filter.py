import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.sensing.kalman_filter import (
    HEIGHT_DRIFT,
    INITIAL_SPEED,
    TrackerNoise,
    begin_track,
    log_likelihood,
    measurement_covariance,
    noise_from_record,
    position_after,
    predict,
    update,
)

NOISE = TrackerNoise(np.asarray(1.5), np.asarray(0.03), np.asarray(0.004))
DT = 0.02
FRESH = np.asarray(True)


def measurements(count: int) -> np.ndarray:
    rng = np.random.default_rng(31)
    time = DT * np.arange(count)[:, None]
    path = np.array([3.0, -1.0, 0.2]) + time * [0.4, 1.2, 0.0] + 0.2 * np.sin(3.0 * time) * [0.0, 1.0, 0.0]
    return path + rng.normal(0.0, 0.01, path.shape)


def rotated(plate: np.ndarray) -> np.ndarray:
    """Measurement covariance by turning a diagonal one into the line of sight."""
    bearing = math.atan2(plate[1], plate[0])
    turn = np.array([[math.cos(bearing), -math.sin(bearing)], [math.sin(bearing), math.cos(bearing)]])
    return turn @ np.diag([float(NOISE.along) ** 2, float(NOISE.across) ** 2]) @ turn.T


def textbook(plates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The filter as in any textbook, with whole matrices."""
    F, G = np.eye(4), np.zeros((4, 2))
    F[0, 2] = F[1, 3] = DT
    G[:2], G[2:] = 0.5 * DT**2 * np.eye(2), DT * np.eye(2)
    Q, H = float(NOISE.acceleration) ** 2 * G @ G.T, np.eye(2, 4)
    x, P = np.concatenate([plates[0, :2], np.zeros(2)]), INITIAL_SPEED**2 * np.eye(4)
    P[:2, :2] = rotated(plates[0])
    for plate in plates[1:]:
        x, P = F @ x, F @ P @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + rotated(plate))
        x, P = x + K @ (plate[:2] - H @ x), (np.eye(4) - K @ H) @ P
    return x, P


def track_of(plates: np.ndarray, noise: TrackerNoise = NOISE):
    track = begin_track(noise, plates[0])
    for plate in plates[1:]:
        track = update(noise, predict(noise, track, np.asarray(DT, plate.dtype)), plate, FRESH)
    return track


@pytest.mark.parametrize("count", [1, 2, 40])
def test_the_filter_is_the_textbooks(count) -> None:
    mean, covariance = textbook(measurements(count))
    track = track_of(measurements(count))
    assert_allclose(track.mean, mean, rtol=1e-9, atol=1e-12)
    assert_allclose(track.covariance, covariance, rtol=1e-8, atol=1e-14)


def test_a_guess_of_the_place_is_forgotten_at_the_first_sight() -> None:
    noise = NOISE._replace(acceleration=np.asarray(0.3))
    guess, plates = np.array([3.0, 0.0, 0.0]), np.tile([3.0, 1.5, 0.2], (4, 1))
    track = begin_track(noise, guess, np.asarray(False))
    for plate, elapsed in zip(plates, (1.0, DT, DT, DT), strict=True):
        track = update(noise, predict(noise, track, np.asarray(elapsed)), plate, FRESH)
    assert_allclose(track.mean[:2], plates[0, :2], atol=0.005)
    assert np.abs(track.mean[2:]).max() < 0.05  # the way from the guess is no speed
    assert track.height == pytest.approx(0.2, abs=1e-3)
    for known, again in zip(begin_track(noise, guess), begin_track(noise, guess, np.asarray(True)), strict=True):
        assert np.array_equal(known, again)


def test_without_acceleration_the_filter_is_batch_least_squares() -> None:
    plates = measurements(30)
    noise = NOISE._replace(acceleration=np.asarray(0.0), initial_speed=np.asarray(0.3))
    # Unknown: position and velocity at the last moment; the filter's prior holds at the first.
    information, right = np.zeros((4, 4)), np.zeros(4)
    for index, plate in enumerate(plates):
        row = np.hstack([np.eye(2), DT * (index - 29) * np.eye(2)])
        weight = np.linalg.inv(rotated(plate))
        information, right = information + row.T @ weight @ row, right + row.T @ weight @ plate[:2]
    information[2:, 2:] += np.eye(2) / 0.3**2
    track = track_of(plates, noise)
    assert_allclose(track.mean, np.linalg.solve(information, right), rtol=1e-8)
    assert_allclose(track.covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-14)


@pytest.mark.parametrize("plate", [(3.0, 0.0, 0.5), (0.0, 2.0, 0.0), (2.0, -2.0, 1.0)])
def test_measurement_noise_lies_along_and_across_the_line_of_sight(plate) -> None:
    plate = np.array(plate)
    found = measurement_covariance(NOISE, plate)
    along = plate[:2] / np.linalg.norm(plate[:2])
    across = np.array([-along[1], along[0]])
    assert_allclose(found, rotated(plate), atol=1e-18)
    assert along @ found @ along == pytest.approx(0.03**2)
    assert across @ found @ across == pytest.approx(0.004**2)


def test_noise_in_proportion_to_the_distance_adds_in_squares() -> None:
    noise = NOISE._replace(along_share=np.asarray(0.015), across_angle=np.asarray(0.0017))
    for plate in (np.array([3.0, 0.0, 0.5]), np.array([2.0, -2.0, 1.0])):
        level = np.linalg.norm(plate[:2])
        along = plate[:2] / level
        across = np.array([-along[1], along[0]])
        found = measurement_covariance(noise, plate)
        assert along @ found @ along == pytest.approx(0.03**2 + (0.015 * level) ** 2)
        assert across @ found @ across == pytest.approx(0.004**2 + (0.0017 * level) ** 2)
        assert along @ found @ across == pytest.approx(0.0, abs=1e-18)


def test_a_record_tells_noise_as_angle_and_as_share_of_the_distance() -> None:
    camera = CameraRecord(
        rate_hz=80.0,
        time_offset=0.0,
        stamp_jitter=0.0,
        bearing_sd=0.0017,
        elevation_sd=0.0016,
        range_sd=0.06,
        noise_range=4.0,
        miss_probability=0.0,
        outlier_share=0.0,
    )
    noise = noise_from_record(SensingRecord(camera, LinkRecord(feedback_rate_hz=1000.0)), 2.5)
    assert_allclose(noise, [2.5, 1e-3, 1e-3, 0.015, 0.0017, INITIAL_SPEED])


def test_the_height_is_a_filter_of_its_own() -> None:
    # A random walk seen with noise: the textbook's scalar filter.
    heights = np.random.default_rng(33).normal(0.2, 0.01, 30)
    plates = np.stack([np.full(30, 3.0), np.zeros(30), heights], axis=-1)
    noise = NOISE._replace(across_angle=np.asarray(0.002))
    measured = 0.004**2 + (0.002 * 3.0) ** 2
    mean, variance = heights[0], measured
    for height in heights[1:]:
        variance += HEIGHT_DRIFT**2 * DT
        gain = variance / (variance + measured)
        mean, variance = mean + gain * (height - mean), (1 - gain) * variance
    track = track_of(plates, noise)
    assert track.height == pytest.approx(mean)
    assert track.height_variance == pytest.approx(variance)
    assert position_after(track, np.asarray(0.5))[2] == track.height


def test_the_covariance_stays_symmetric_and_positive_in_float32() -> None:
    noise = TrackerNoise(*(np.float32(each) for each in NOISE))
    track = track_of(measurements(300).astype(np.float32), noise)
    assert track.covariance.dtype == np.float32
    assert_allclose(track.covariance, track.covariance.T, rtol=0, atol=0)
    assert np.all(np.linalg.eigvalsh(track.covariance.astype(np.float64)) > 0.0)


def test_float32_knows_what_float64_knows_after_a_guess_or_a_silence() -> None:
    single = TrackerNoise(*(np.float32(each) for each in NOISE))
    for shown, silence in ((False, 0.02), (True, 3.0)):
        tracks = []
        for noise, kind in ((NOISE, np.float64), (single, np.float32)):
            plates = measurements(3).astype(kind)
            track = begin_track(noise, plates[0], np.asarray(shown))
            for plate, elapsed in zip(plates[1:], (silence, DT), strict=True):
                track = update(noise, predict(noise, track, np.asarray(elapsed, kind)), plate, FRESH)
            tracks.append(track)
        assert_allclose(tracks[1].mean, tracks[0].mean, rtol=1e-4)
        assert_allclose(tracks[1].height, tracks[0].height, rtol=1e-4)
        assert_allclose(tracks[1].height_variance, tracks[0].height_variance, rtol=1e-4)
        scale = np.sqrt(np.diag(tracks[0].covariance))
        assert_allclose(tracks[1].covariance / np.outer(scale, scale), tracks[0].covariance / np.outer(scale, scale),
                        atol=1e-4)  # fmt: skip


def test_a_measurement_that_is_not_new_changes_nothing() -> None:
    track = track_of(measurements(5))
    kept = update(NOISE, track, np.array([9.0, 9.0, 9.0]), np.asarray(False))
    for found, expected in zip(kept, track, strict=True):
        assert np.array_equal(found, expected)


def test_a_steady_target_is_predicted_where_it_will_be() -> None:
    time = DT * np.arange(60)[:, None]
    track = track_of(np.array([3.0, -1.0, 0.2]) + time * [0.2, 0.5, 0.0])
    assert_allclose(position_after(track, np.asarray(0.3)), [3.0 + 0.2 * 1.48, -1.0 + 0.5 * 1.48, 0.2], atol=2e-3)


def test_a_decayed_velocity_carries_a_target_less_far() -> None:
    time = DT * np.arange(60)[:, None]
    track = track_of(np.array([3.0, -1.0, 0.2]) + time * [0.2, 0.5, 0.0])
    whole, none, part = (position_after(track, np.asarray(0.3), np.asarray(share)) for share in (1.0, 0.0, 0.6))
    assert_allclose(none[:2], track.mean[:2])
    assert_allclose(part, 0.6 * whole + 0.4 * none)


def test_the_likelihood_of_a_sight_is_the_normal_density() -> None:
    plates = measurements(6)
    track = predict(NOISE, track_of(plates[:-1]), np.asarray(DT))
    density = multivariate_normal(track.mean[:2], track.covariance[:2, :2] + rotated(plates[-1]))
    expected = density.logpdf(plates[-1, :2]) + math.log(2.0 * math.pi)
    assert log_likelihood(NOISE, track, plates[-1]) == pytest.approx(expected, rel=1e-9)


def test_a_longer_silence_leaves_more_doubt() -> None:
    track = track_of(measurements(20))
    short, long = (predict(NOISE, track, np.asarray(time)).covariance for time in (DT, 5 * DT))
    assert np.all(np.linalg.eigvalsh(long - short) > -1e-15)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(32)
    first, second = rng.uniform(1.0, 4.0, (2, *shape, 3))

    def everything(noise, first, second, elapsed, fresh):
        track = update(noise, predict(noise, begin_track(noise, first), elapsed), second, fresh)
        return track, position_after(track, elapsed)

    fresh = rng.random(shape) < 0.7
    _, later = agree_in_jax(everything, NOISE, first, second, np.full(shape, DT), np.asarray(fresh), atol=1e-5)
    assert later.shape == (*shape, 3)
