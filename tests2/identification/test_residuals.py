"""Tests of residuals: how often they fail for a good model, and what they find, against sums by hand."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from archerfish2.identification.axis.fit import fit_axis
from archerfish2.identification.residuals import parameter_errors, residual_tests
from archerfish2.identification.simulation import simulate
from archerfish2.identification.validation import free_run
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord

SHARED = "shared/data/identification/quarter_drone"
DATA = next((each / SHARED for each in Path(__file__).parents if (each / SHARED).is_dir()), None)
COUNT = 800
TIME = 1e-3 * np.arange(COUNT)


def coloured(rng, pole, count=COUNT):
    return signal.lfilter([1.0], [1.0, -pole], rng.normal(size=count + 200))[200:]


INPUTS = {
    "white": lambda rng: rng.normal(size=COUNT),
    "coloured": lambda rng: coloured(rng, 0.95),
    "sweep": lambda _: signal.chirp(TIME, 2, 0.8, 50, phi=-90),
    "step": lambda _: (TIME >= 0.05).astype(float),
}


@pytest.mark.parametrize("excitation", INPUTS)
@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_a_good_model_fails_in_at_most_one_of_a_hundred_logs(excitation, pole):
    # 80 logs at 1 %: more than 4 failures have probability 0.1 % (binomial).
    rng = np.random.default_rng(0)
    tests = [residual_tests(coloured(rng, pole), INPUTS[excitation](rng)[:, None]) for _ in range(80)]
    assert sum(not each.independent for each in tests) <= 4
    assert sum(each.feedback for each in tests) <= 4
    white = sum(not np.any(np.abs(each.whiteness) > each.white_band) for each in tests)
    assert white >= 76 if pole == 0 else white == 0


def test_correlations_are_those_of_a_direct_sum_and_bands_wider_than_those_of_white_signals():
    rng = np.random.default_rng(1)
    e, u = coloured(rng, 0.95), np.stack([coloured(rng, 0.95), rng.normal(size=COUNT)])
    test = residual_tests(e, u.T)
    e, u = e - e.mean(), u[0] - u[0].mean()
    found, scale = dict(zip(test.lags.tolist(), test.correlation[0], strict=True)), np.sqrt((e @ e) * (u @ u))
    assert_allclose([found[3], found[-3]], [e[3:] @ u[:-3] / scale, e[:-3] @ u[3:] / scale])
    assert_allclose(test.whiteness[1], e[2:] @ e[:-2] / (e @ e))
    assert test.band[0].min() > 2 * 2.576 / np.sqrt(COUNT) > test.band[1].min()
    assert residual_tests(e[:199], u[:199, None]) is None


@pytest.mark.parametrize("lag", [0, 3, 25])
def test_what_past_inputs_explain_is_found(lag):
    rng = np.random.default_rng(3)
    u, noise = rng.normal(size=(2000, 2)), coloured(rng, 0.9, 2000)
    late = np.concatenate([np.full(lag, u[0, 1]), u[: 2000 - lag, 1]])
    test = residual_tests(noise + late, u)
    assert (test.independent, test.feedback) == (False, False)
    assert np.any(np.abs(test.correlation) > test.band, axis=1).tolist() == [False, True]
    assert test.explained_share == pytest.approx(late.var() / (late.var() + noise.var()), abs=0.05)


def test_an_input_made_from_the_output_shows_feedback():
    rng = np.random.default_rng(5)
    noise = coloured(rng, 0.9, 2000)
    u = rng.normal(size=2000) - 0.5 * np.append(0.0, noise[:-1])  # less what was measured the sample before
    assert residual_tests(noise, u[:, None]).feedback


def test_the_uncertainty_of_the_plant_is_no_fault_on_a_log_that_was_not_fitted():
    rng = np.random.default_rng(6)
    plant, u = PlantRecord.second_order(20, 0.5), rng.normal(size=(2000, 1))
    gains = 1 + 0.2 * rng.normal(size=100)
    draws = {n: gains[:, None, None] ** (n == "B") * getattr(plant, n) for n in "ABCD"}
    errors = parameter_errors(uncertain := plant.replace(draws=draws), u)
    y = 1.2 * simulate(plant, u) + 0.02 * rng.normal(size=(2000, 1))
    residual = (y - free_run(plant, u, y).outputs)[:, 0]
    assert not residual_tests(residual, u).independent
    assert residual_tests(residual, u, errors).independent
    other = uncertain.replace(B=draws["B"][0], draws={})
    changed = free_run(plant, u, y).outputs - free_run(other, u, y).outputs  # also by what the level takes
    assert np.std(changed[:, 0] + errors[0]) < 0.05 * errors[0].std()
    assert parameter_errors(plant, u).shape == (0, 2000)


def test_no_residual_an_idle_input_and_a_plant_without_draws_pass():
    rng, plant = np.random.default_rng(7), PlantRecord.second_order(20, 0.5)
    u, white = rng.normal(size=(2, 600, 1))
    perfect = residual_tests(np.zeros(600), u, parameter_errors(plant, u))
    assert (perfect.independent, perfect.feedback, perfect.explained_share) == (True, False, 0.0)
    assert residual_tests(white[:, 0], np.ones((600, 1))).independent


@pytest.mark.skipif(DATA is None, reason=f"no folder {SHARED} with recorded logs beside the clone")
@pytest.mark.parametrize(("column", "feedback"), [(1, False), (3, True)], ids=["set point", "actuator"])
def test_in_a_recorded_loop_the_actuator_depends_on_the_output(column, feedback):
    table = np.loadtxt(DATA / "sinal4_multiseno_malha_fechada.csv", delimiter=",", skiprows=1)
    log = Recording.from_arrays(table[:, column], table[:, 2], 0.01)
    run = free_run(fit_axis([log], 4).plant, log.inputs, log.outputs)
    assert residual_tests((log.outputs - run.outputs)[:, 0], log.inputs).feedback is feedback
