import numpy as np
import pytest
from scipy.stats import chi2

from archerfish.identification.muzzle.profile_likelihood import interval_end, mean_threshold, spread_threshold


def test_a_parabola_ends_where_its_root_says():
    assert interval_end(lambda x: (x - 1) ** 2, 4.0, 1.0, 0.3, 10.0) == pytest.approx(3.0, abs=0.01)
    assert interval_end(lambda x: (x - 1) ** 2, 4.0, 1.0, 50.0, -10.0) == pytest.approx(-1.0, abs=0.01)


def test_a_curved_profile_ends_where_it_has_risen_enough():
    end = interval_end(lambda x: np.expm1(x) ** 2, 3.84, 0.0, 0.1, 9.0)
    assert np.expm1(end) ** 2 == pytest.approx(3.84, rel=0.01)


def test_a_flat_side_ends_at_its_bound():
    assert interval_end(lambda x: max(x, 0.0) * 10, 3.84, 0.0, 0.3, -3.0) == -3.0


def test_thresholds_have_the_limits_of_many_shots():
    for threshold in (mean_threshold, spread_threshold):
        assert threshold(1e7) == pytest.approx(chi2.ppf(0.95, 1), rel=1e-5)


@pytest.mark.parametrize("freedom", [4, 15])
def test_the_interval_of_a_standard_deviation_covers(freedom):
    # Exactly: the deviance of a variance is ν (R − 1 − log R) with R = χ²_ν / ν.
    draws = np.random.default_rng(0).chisquare(freedom, 400_000) / freedom
    rise = freedom * (draws - 1 - np.log(draws))
    assert np.mean(rise <= spread_threshold(freedom)) == pytest.approx(0.95, abs=2e-3)
