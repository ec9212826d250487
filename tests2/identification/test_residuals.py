"""Tests of residuals: how often they fail for a good model, and what they find; and the plots of an axis."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from archerfish2.identification.axis.fit import fit_axis
from archerfish2.identification.axis.plots import bode_plot, correlation_plot, run_plot, step_plot
from archerfish2.identification.frequency import measured_response
from archerfish2.identification.residuals import residual_tests
from archerfish2.identification.simulation import free_run, simulate
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.style import svg_text

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
    tests, bode = (
        residual_tests((log.outputs - run.outputs)[:, 0], u),
        bode_plot(plant, measured_response([log]), (1, 50)),
    )
    figures = [run_plot(log, run), bode, step_plot(plant), correlation_plot(tests)]
    assert [len(each.axes) for each in figures if "<svg" in svg_text(each)] == [2, 2, 1, 1]
    own, measured = (line.get_data() for line in bode.axes[1].lines)
    assert own[1][-1] < -1440  # 20 ms up to 200 Hz are four turns
    near = measured[0] < 200
    assert np.abs(measured[1] - np.interp(measured[0], *own))[near].max() < 30
    assert figures[2].axes[0].lines[0].get_ydata()[-1] == pytest.approx(1, abs=0.01)
    assert len(figures[0].axes[0].lines[0].get_xdata()) == 2000  # where the residual is largest


@pytest.mark.parametrize(("column", "feedback"), [(1, False), (3, True)], ids=["set point", "actuator"])
def test_in_a_recorded_loop_the_actuator_depends_on_the_output(column, feedback, shared):
    path = shared("data/identification/quarter_drone/sinal4_multiseno_malha_fechada.csv")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    log = Recording.from_arrays(table[:, column], table[:, 2], 0.01)
    run = free_run(fit_axis([log], 4).plant, log.inputs, log.outputs)
    assert residual_tests((log.outputs - run.outputs)[:, 0], log.inputs).feedback is feedback
