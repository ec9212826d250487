import numpy as np
import pytest

from archerfish.identification.muzzle.lack_of_fit import lack_of_fit

NAMES = ("0° pitch", "5° pitch")


def test_the_figures_of_a_hand_calculation():
    # Group means 10 and 20, model 9 and 20: deviations 10 % and 0 %; scatter ±1 % within each group.
    group = np.array([0, 0, 1, 1])
    measured, modelled = np.array([9.9, 10.1, 19.8, 20.2]), np.array([9.0, 9.0, 20.0, 20.0])
    found = lack_of_fit(group, measured - modelled, np.repeat([10.0, 20.0], 2), measured, 1, NAMES, "It")
    assert found.rms_percent == pytest.approx(10 / np.sqrt(2))
    assert found.worst_percent == pytest.approx(10.0)
    assert found.worst_setting == "0° pitch"
    # Four residuals of 1 % with two degrees of freedom.
    assert found.replicate_percent == pytest.approx(np.sqrt(2))
    # F(1, 2) = (2 · 0.1²) / 0.0002 = 100.
    assert found.variance_ratio == pytest.approx(100)
    assert found.p_value == pytest.approx(0.0098525, rel=1e-3)
    assert found.shown
    assert "It leaves 7.1 % of the distance" in found.statement
    assert "does not fit" in found.statement


def test_a_model_within_the_scatter_passes():
    distance = np.repeat([3.0, 4.0, 6.0], 20)
    residual = 0.02 * distance * np.random.default_rng(3).standard_normal(60)
    found = lack_of_fit(np.repeat([0, 1, 2], 20), residual, distance, distance, 2, "abc", "It")
    assert found.p_value > 0.05
    assert not found.shown
    assert "no lack of fit shows" in found.statement


def test_what_chance_does_not_explain_may_still_be_a_trifle():
    distance = np.repeat([3.0, 4.0, 6.0], 4000)
    scatter = 0.02 * np.random.default_rng(3).standard_normal((3, 4000))
    bias = np.repeat([0.002, -0.002, 0.002], 4000)
    residual = distance * (bias + (scatter - scatter.mean(axis=1, keepdims=True)).ravel())
    found = lack_of_fit(np.repeat([0, 1, 2], 4000), residual, distance, distance, 2, "abc", "It")
    assert found.shown
    assert not found.matters
    assert "a trifle beside the scatter" in found.statement
    larger = lack_of_fit(np.repeat([0, 1, 2], 4000), residual + 3 * bias * distance, distance, distance, 2, "abc", "It")
    assert larger.matters
    assert "does not fit" in larger.statement


def test_without_repetition_there_is_no_verdict():
    found = lack_of_fit(np.array([0, 1]), np.array([0.1, 0.0]), np.ones(2), np.array([3.0, 4.0]), 1, NAMES, "It")
    assert found.p_value is None
    assert "can't be told from scatter" in found.statement
