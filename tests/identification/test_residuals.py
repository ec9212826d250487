"""Responses of plants and logs against SciPy, and how often tests of residuals fail for a good model; plots."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg, signal

from archerfish.identification.axis.fit import fit_axis
from archerfish.identification.axis.plots import bode_plot, correlation_plot, run_plot, step_plot
from archerfish.identification.frequency import excited_band, frequency_response, measured_response
from archerfish.identification.residuals import residual_tests
from archerfish.identification.simulation import balanced, free_run, simulate
from archerfish.logs.recording import Recording
from archerfish.records.plant import PlantRecord
from archerfish.reports.style import svg_text

COUNT = 800
INPUTS = {
    "coloured": lambda rng: coloured(rng, 0.95),
    "sweep": lambda _: signal.chirp(1e-3 * np.arange(COUNT), 2, 0.8, 50, phi=-90),
    "step": lambda _: (np.arange(COUNT) >= 50).astype(float),
}


def coloured(rng, pole, count=COUNT):
    return signal.lfilter([1.0], [1.0, -pole], rng.normal(size=count + 200))[200:]


@pytest.mark.parametrize("excitation", INPUTS)
@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_a_good_model_fails_in_at_most_one_of_a_hundred_logs(excitation, pole):
    # 80 logs at 1 %: more than 4 failures have probability 0.1 % (binomial).
    rng = np.random.default_rng(0)
    tests = [residual_tests(coloured(rng, pole), INPUTS[excitation](rng)[:, None]) for _ in range(80)]
    assert max(sum(not each.independent for each in tests), sum(each.feedback for each in tests)) <= 4


@pytest.mark.parametrize("lag", [0, 3, 25])
def test_what_past_inputs_explain_is_found_by_correlations_that_are_direct_sums(lag):
    rng = np.random.default_rng(3)
    u, noise = rng.normal(size=(2000, 2)), coloured(rng, 0.9, 2000)
    late = np.concatenate([np.full(lag, u[0, 1]), u[: 2000 - lag, 1]])
    test = residual_tests(noise + late, u)
    assert (test.independent, test.feedback) == (False, False)
    assert np.any(np.abs(test.correlation) > test.band, axis=1).tolist() == [False, True]
    assert test.explained_share == pytest.approx(late.var() / (late.var() + noise.var()), abs=0.05)
    e, v = noise + late - np.mean(noise + late), u[:, 1] - u[:, 1].mean()
    sums = np.array([e[3:] @ v[:-3], e[:-3] @ v[3:]]) / np.sqrt((e @ e) * (v @ v))
    assert_allclose([test.correlation[1, 25 + 3], test.correlation[1, 25 - 3]], sums)


def test_a_residual_that_is_zero_and_an_idle_input_pass_and_a_short_log_is_not_tested():
    zero, idle = residual_tests(np.zeros(600), np.eye(600, 1)), residual_tests(np.arange(600.0), np.ones((600, 1)))
    assert (zero.independent, zero.feedback, zero.explained_share, idle.independent) == (True, False, 0.0, True)
    assert residual_tests(np.ones(199), np.ones((199, 1))) is None


def test_the_plots_draw_a_run_responses_and_correlations():
    rng, plant = np.random.default_rng(6), PlantRecord.second_order(20, 0.5, 0.02)
    gains, u = 1 + 0.2 * rng.normal(size=(100, 1, 1)), rng.normal(size=(3000, 1))
    plant = plant.replace(draws={n: gains ** (n == "B") * getattr(plant, n) for n in "ABCD"})
    log = Recording.from_arrays(u, 1.2 * simulate(plant, u) + 0.02 * rng.normal(size=(3000, 1)), 1e-3)
    run = free_run(plant, u, log.outputs)
    tests = residual_tests((log.outputs - run.outputs)[:, 0], u)
    bode = bode_plot(plant, measured_response([log]), (1, 50))
    figures = [run_plot(log, run), bode, step_plot(plant), correlation_plot(tests)]
    assert [len(each.axes) for each in figures if "<svg" in svg_text(each)] == [5, 2, 1, 1]
    own, measured = (line.get_data() for line in bode.axes[1].lines)
    assert own[1][-1] < -1440  # 20 ms up to 200 Hz are four turns
    near = measured[0] < 200
    assert np.abs(measured[1] - np.interp(measured[0], *own))[near].max() < 30
    assert figures[2].axes[0].lines[0].get_ydata()[-1] == pytest.approx(1, abs=0.01)
    lengths = [len(panel.lines[1].get_xdata()) for panel in figures[0].axes[:2]]
    assert lengths == [3000, 2000]  # all, and where the residual is largest


@pytest.mark.parametrize(("column", "feedback"), [(1, False), (3, True)], ids=["set point", "actuator"])
def test_in_a_recorded_loop_the_actuator_depends_on_the_output(column, feedback, shared):
    path = shared("data/identification/quarter_drone/sinal4_multiseno_malha_fechada.csv")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    log = Recording.from_arrays(table[:, column], table[:, 2], 0.01)
    run = free_run(fit_axis([log], 4).plant, log.inputs, log.outputs)
    assert residual_tests((log.outputs - run.outputs)[:, 0], log.inputs).feedback is feedback


A = np.array([[0.9, 0.2, 0.1, 0.0], [-0.2, 0.9, 0.0, 0.1], [0.0, 0.0, 0.7, 0.2], [0.0, 0.0, 0.0, 0.3]])
B = np.array([[0.1, 0.0], [0.2, 0.3], [-0.1, 0.5], [0.4, 0.1]])
PLANT = PlantRecord.from_state_space(A, B, np.array([[1.0, 0.5, -0.3, 0.2]]), np.array([[0.3, 0.0]]), 1e-3, 2)
DRAWN = {n: np.random.default_rng(4).normal(size=(3, *getattr(PLANT, n).shape)) for n in "ABCD"}
DRAWS = {n: getattr(PLANT, n) + 0.01 * DRAWN[n] for n in "ABCD"}
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
