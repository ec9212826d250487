import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.spectra import delayed
from archerfish.identification.excitation.signals import linear_sweep, step
from archerfish.identification.validation.confidence_bands import parameter_errors
from archerfish.identification.validation.residual_tests import LAGS, long_enough, residual_tests

COUNT = 800


def coloured(rng, pole, count=COUNT):
    return lfilter([1.0], [1.0, -pole], rng.standard_normal(count + 200))[200:]


INPUTS = {
    "white": lambda rng: rng.standard_normal(COUNT),
    "coloured": lambda rng: coloured(rng, 0.95),
    "sweep": lambda _: linear_sweep(COUNT * 1e-3, 1e-3),
    "step": lambda _: step(COUNT * 1e-3, 1e-3),
}


@pytest.mark.parametrize("excitation", INPUTS)
@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_a_good_model_is_refused_in_one_of_a_hundred_logs(excitation, pole):
    # 80 logs at 1 %: more than 4 refusals have probability 0.1 % (binomial). Seed fixed.
    rng = np.random.default_rng(0)
    tests = [residual_tests(coloured(rng, pole), INPUTS[excitation](rng)[:, None]) for _ in range(80)]
    assert sum(not each.independent for each in tests) <= 4
    assert sum(each.feedback for each in tests) <= 4
    if pole == 0:
        assert sum(not each.whiteness.passed for each in tests) <= 4
    else:
        assert not any(each.whiteness.passed for each in tests)


def test_the_naive_band_would_fail_a_good_model():
    # Both coloured: 2.58 / √N is left at some lag in far more than 1 % of logs; ours is wider.
    rng = np.random.default_rng(1)
    test = residual_tests(coloured(rng, 0.95), coloured(rng, 0.95)[:, None]).independence[0]
    assert test.half_width.min() > 2 * 2.576 / np.sqrt(COUNT)


def test_correlations_are_those_of_a_direct_sum():
    rng = np.random.default_rng(2)
    e, u = rng.standard_normal((2, 300))
    test = residual_tests(e, u[:, None])
    e, u = e - e.mean(), u - u.mean()
    scale = np.sqrt((e @ e) * (u @ u))
    found = dict(zip(test.independence[0].lag, test.independence[0].correlation, strict=True))
    assert sorted(found) == list(range(-LAGS, LAGS + 1))
    assert found[3] == pytest.approx(e[3:] @ u[:-3] / scale)
    assert found[-3] == pytest.approx(e[:-3] @ u[3:] / scale)
    assert test.whiteness.correlation[1] == pytest.approx(e[2:] @ e[:-2] / (e @ e))


@pytest.mark.parametrize("lag", [0, 3, 25])
def test_what_past_inputs_explain_is_found(lag):
    rng = np.random.default_rng(3)
    u = rng.standard_normal((2000, 1))
    noise = coloured(rng, 0.9, 2000)
    late = delayed(u, lag)[:, 0]
    test = residual_tests(noise + late, u)
    assert not test.independent
    assert not test.feedback
    share = late.var() / (late.var() + noise.var())
    assert test.explained_share == pytest.approx(share, abs=0.05)


def test_of_several_inputs_the_guilty_one_is_named():
    rng = np.random.default_rng(4)
    u = rng.standard_normal((2000, 2))
    test = residual_tests(rng.standard_normal(2000) + 0.3 * u[:, 1], u)
    assert [each.passed for each in test.independence] == [True, False]


def test_feedback_shows_at_negative_lags_alone():
    rng = np.random.default_rng(5)
    noise = coloured(rng, 0.9, 2000)
    # The input is an excitation less what was measured the sample before.
    u = rng.standard_normal(2000) - 0.5 * np.concatenate([[0.0], noise[:-1]])
    assert residual_tests(noise, u[:, None]).feedback


def test_the_plants_own_uncertainty_is_no_fault_on_a_log_that_was_not_fitted():
    rng = np.random.default_rng(6)
    u = rng.standard_normal((2000, 1))
    error = 0.2 * u[:, 0]
    spread = rng.standard_normal((100, 1)) * error
    residual = rng.standard_normal(2000) + error
    assert not residual_tests(residual, u).independent
    assert residual_tests(residual, u, spread).independent


def test_a_perfect_residual_and_an_idle_input_pass(resonant_plant, white):
    plant = resonant_plant()
    test = residual_tests(np.zeros(600), white, parameter_errors(plant, white[:, :1]))
    assert test.independent
    assert not test.feedback
    assert residual_tests(white[:, 0], np.ones((600, 1))).independent


def test_short_recordings_are_not_tested():
    assert long_enough(200)
    assert not long_enough(199)
    assert not long_enough(200, inputs=2)
