import numpy as np
import pytest

from archerfish.identification.lack_of_fit import lack_of_fit


def test_the_figures_of_a_hand_calculation():
    # Group means 10 and 20, model 9 and 20: deviations 10 % and 0 %; scatter ±1 % within each group.
    setting = np.radians([0.0, 0.0, 5.0, 5.0])
    found = lack_of_fit(setting, np.array([9.9, 10.1, 19.8, 20.2]), np.array([9.0, 9.0, 20.0, 20.0]), 1)
    assert found.rms_percent == pytest.approx(10 / np.sqrt(2))
    assert found.worst_percent == pytest.approx(10.0)
    assert found.worst_pitch == 0.0
    # Four residuals of 1 % with two degrees of freedom.
    assert found.replicate_percent == pytest.approx(np.sqrt(2))
    # F(1, 2) = (2 · 0.1²) / 0.0002 = 100.
    assert found.p_value == pytest.approx(0.0098525, rel=1e-3)
    assert "does not fit" in found.statement


def test_a_model_within_the_scatter_passes():
    setting = np.repeat([0.0, 0.1, 0.2], 20)
    modelled = np.repeat([3.0, 4.0, 6.0], 20)
    measured = modelled * (1 + 0.02 * np.random.default_rng(3).standard_normal(60))
    found = lack_of_fit(setting, measured, modelled, 2)
    assert found.p_value > 0.05
    assert "no lack of fit shows" in found.statement


def test_without_repetition_there_is_no_verdict():
    found = lack_of_fit(np.array([0.0, 0.1]), np.array([3.0, 4.0]), np.array([3.1, 4.0]), 1)
    assert found.p_value is None
    assert "can't be told from scatter" in found.statement
