"""Plants, their draws and the balanced realisation in time and frequency, against SciPy; what logs excite."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg, signal

from archerfish2.identification.frequency import excited_band, frequency_response, measured_response
from archerfish2.identification.simulation import balanced, simulate
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord

A = np.array([[0.9, 0.2, 0.1, 0.0], [-0.2, 0.9, 0.0, 0.1], [0.0, 0.0, 0.7, 0.2], [0.0, 0.0, 0.0, 0.3]])
B = np.array([[0.1, 0.0], [0.2, 0.3], [-0.1, 0.5], [0.4, 0.1]])
PLANT = PlantRecord.from_state_space(A, B, np.array([[1.0, 0.5, -0.3, 0.2]]), np.array([[0.3, 0.0]]), 1e-3, 2)
DRAWS = {
    n: getattr(PLANT, n) + 0.01 * np.random.default_rng(4).normal(size=(3, *getattr(PLANT, n).shape)) for n in "ABCD"
}
UNCERTAIN = PLANT.replace(draws=DRAWS, draw_delays=np.array([2, 0, 7]))


def log(u, y=None):
    return Recording.from_arrays(u, u if y is None else y, 1e-3)


@pytest.mark.parametrize("count", [1, 2, 99, 2000])
def test_draws_respond_as_plants_of_their_own(count):
    u, hz = np.random.default_rng(3).normal(size=(count, 2)), np.array([0.5, 60.0, 300.0])
    found, response = simulate(UNCERTAIN, u, draws=True), frequency_response(UNCERTAIN, hz, draws=True)
    for k, late in enumerate((2, 0, 7)):
        a, b, c, d = (DRAWS[name][k] for name in "ABCD")
        held = u[np.maximum(np.arange(count) - late, 0)]
        assert_allclose(found[k], signal.dlsim((a, b, c, d, 1.0), held)[1], atol=1e-9)
        alone = PLANT.replace(A=a, B=b, C=c, D=d, delay_samples=late)
        assert_allclose(simulate(alone, u), found[k], atol=1e-9)
        expected = signal.dfreqresp((a, b[:, :1], c, d[:, :1], 1.0), 2e-3 * np.pi * hz)[1]
        assert_allclose(response[k, :, 0, 0], expected * np.exp(-2e-3j * np.pi * hz * late), rtol=1e-6)
        assert_allclose(frequency_response(alone, hz), response[k])
    assert simulate(PLANT, u, draws=True).shape == (0, count, 1)


def test_the_balanced_realisation_keeps_the_responses_and_has_equal_diagonal_gramians():
    found, u = balanced(UNCERTAIN), np.random.default_rng(3).normal(size=(300, 2))
    for draws in (False, True):
        assert_allclose(simulate(found, u, draws=draws), simulate(UNCERTAIN, u, draws=draws), atol=1e-9)
    for a, b, c in ((found.A, found.B, found.C), *zip(*(found.draws[name] for name in "ABC"), strict=True)):
        reach, observe = linalg.solve_discrete_lyapunov(a, b @ b.T), linalg.solve_discrete_lyapunov(a.T, c.T @ c)
        assert_allclose([reach, observe], [np.diag(np.diag(observe))] * 2, atol=1e-9 * reach.max())
    alike = PlantRecord.from_state_space(np.diag([0.5, 0.4]), [[1.0], [0.0]], np.ones((1, 2)), 0, 0.01)
    assert_allclose(balanced(alike).A, alike.A)  # not minimal


def test_white_inputs_measure_the_response_even_where_they_are_correlated():
    rng = np.random.default_rng(2)
    u = rng.normal(size=(40_000, 2)) @ np.array([[1.0, 0.7], [0.0, 1e3]])
    y = simulate(PLANT.replace(B=B * [[1, 0]], D=np.array([[0.3, 0.0]])), u) + 0.01 * rng.normal(size=(40_000, 1))
    parts = [slice(0, 25_000), slice(25_000, 40_000)]
    both = [Recording.from_arrays(u[part], y[part], 1e-3, input_names=("u", "v")) for part in parts]
    measured = measured_response(both)
    assert_allclose(measured.response[:, 0, 0], frequency_response(PLANT, measured.hz)[:, 0, 0], rtol=0.1)
    # The second input is a thousand times the first, but has no part in the output.
    assert measured.coherence[:, 0, 1].max() < measured.significant < 0.9 < np.median(measured.coherence[:, 0, 0])
    one = measured_response([log(u[:, 0], y)])
    hz, expected = signal.coherence(u[:, 0], y[:, 0], 1e3, nperseg=1024)
    assert_allclose(one.coherence[:, 0, 0], np.interp(one.hz, hz, expected), atol=1e-3)
    assert measured_response([log(np.ones(20))]).hz.size == 0


@pytest.mark.parametrize("size", [1.0, 0.05])
def test_what_a_sweep_leaks_is_not_excited_and_a_step_excites_low_frequencies_however_small(size):
    sweep = log(signal.chirp(1e-3 * np.arange(10_000), 2, 10, 50, phi=-90))
    step = log(100 + size * (np.arange(1500) >= 200))
    assert excited_band([sweep, log(np.full(1000, 0.1), sweep.outputs[:1000])]) == pytest.approx((2, 50), abs=0.5)
    assert excited_band([sweep, step])[0] == excited_band([step])[0] == pytest.approx(1 / 1.5)


def test_the_band_ends_where_noise_hides_the_response():
    u, noise = np.random.default_rng(0).normal(size=(2, 20_000, 1))
    y = simulate(PlantRecord.second_order(10, 0.7), u)
    assert excited_band([log(u)]) == pytest.approx((0.05, 500), rel=0.01)
    # The response falls below the noise at 10 √100 = 100 Hz, and below a third of it at 130 Hz.
    low, high = excited_band([log(u, y + 0.01 * noise)])
    assert low < 0.06 < 90 < high < 170
