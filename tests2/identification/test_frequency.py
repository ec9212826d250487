"""Frequency responses against SciPy, as measured against the plant's, and the band that logs excite."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from archerfish2.identification.frequency import excited_band, frequency_response, measured_response
from archerfish2.identification.simulation import simulate
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord

SWEEP = signal.chirp(1e-3 * np.arange(10_000), 2, 10, 50, phi=-90)


def log(u):
    return Recording.from_arrays(u, u, 1e-3)


def step(seconds, at, size=1.0, level=0.0):
    return log(level + size * (np.arange(round(1000 * seconds)) >= 1000 * at))


def two_inputs():
    """Return the plant of two inputs and two outputs, one a second order, the other a lag of both."""
    first = PlantRecord.second_order(60, 0.3)
    A, B = np.eye(3) * 0.8, np.zeros((3, 2))
    A[:2, :2], B[:2, :1], B[2] = first.A, first.B, (0.1, 0.2)
    return PlantRecord.from_state_space(A, B, np.array([[1, 0, 0], [0.5, 0, 1.0]]), 0, 1e-3, 2)


def test_responses_agree_with_scipy_draw_by_draw():
    plant, hz = two_inputs(), np.array([0.5, 60.0, 300.0])
    draws = {name: np.stack([getattr(plant, name), 0.9 * getattr(plant, name)]) for name in "ABCD"}
    plant = plant.replace(draws=draws, draw_delays=np.array([2, 5]))
    z = np.exp(2j * np.pi * hz * 1e-3)
    for k, found in enumerate(frequency_response(plant, hz, draws=True)):
        for j in range(2):
            zeros, poles = signal.ss2tf(*(draws[name][k] for name in "ABCD"), input=j)
            expected = [signal.freqz(b, poles, 2 * np.pi * hz * 1e-3)[1] * z ** -[2, 5][k] for b in zeros]
            assert_allclose(found[:, :, j].T, expected, rtol=1e-6, atol=1e-12)
    assert_allclose(frequency_response(plant, hz), frequency_response(plant, hz, draws=True)[0])


def test_white_inputs_measure_the_response_even_where_they_are_correlated():
    plant, rng = two_inputs(), np.random.default_rng(2)
    u = rng.normal(size=(40_000, 2)) @ np.array([[1.0, 0.7], [0.0, 1e3]])
    y = simulate(plant, u) + rng.normal(size=(40_000, 2))
    log = Recording.from_arrays(u, y, 1e-3, input_names=("u", "v"), output_names=("y", "x"))
    measured = measured_response([log.slice(0, 25_000), log.slice(25_000, 40_000)])
    found, expected = measured.response[:, 1, 1], frequency_response(plant, measured.hz)[:, 1, 1]
    assert np.median(np.abs(found / expected - 1)) < 0.02
    assert np.median(measured.coherence[:, 1, 1]) > 0.99
    # The second input is a thousand times the first, but has no part in the first output.
    assert np.mean(measured.coherence[:, 0, 1] > measured.significant) == 0
    one = measured_response([Recording.from_arrays(u[:, 1], y[:, 1], 1e-3)])
    hz, expected = signal.coherence(u[:, 1], y[:, 1], 1e3, nperseg=1024)
    assert_allclose(one.coherence[:, 0, 0], np.interp(one.hz, hz, expected), atol=1e-3)


def test_a_log_too_short_to_average_measures_nothing():
    assert measured_response([Recording.from_arrays(*np.ones((2, 20)), 1e-3)]).hz.size == 0


@pytest.mark.parametrize("size", [1.0, 0.05])
def test_what_the_ends_of_a_sweep_leak_is_not_excited_and_a_step_excites_low_frequencies_however_small(size):
    sweep = log(SWEEP)
    assert np.abs(np.fft.rfft(SWEEP))[1] > 0.1 * np.abs(np.fft.rfft(SWEEP)).max()  # the line at 0.1 Hz
    assert excited_band([sweep]) == pytest.approx((2, 50), abs=0.5)
    low, high = excited_band([step(1, 0.5, size, 100)])
    assert low == pytest.approx(1)
    assert 2 < high < 50
    assert excited_band([sweep, step(1.5, 0.2, size)])[0] == pytest.approx(1 / 1.5)
    dither = log(1e-4 * np.random.default_rng(0).normal(size=1000))
    assert excited_band([sweep, dither]) == pytest.approx((2, 50), abs=0.5)


def test_the_band_ends_where_noise_hides_the_response():
    rng = np.random.default_rng(0)
    u = rng.normal(size=(20_000, 1))
    y = simulate(PlantRecord.second_order(10, 0.7), u)
    assert excited_band([log(u)]) == pytest.approx((0.05, 500), rel=0.01)
    # The response falls below the noise at 10 √100 = 100 Hz, and below a third of it at 130 Hz.
    low, high = excited_band([Recording.from_arrays(u, y + 0.01 * rng.normal(size=y.shape), 1e-3)])
    assert low == pytest.approx(0.05)
    assert 90 < high < 170
