import numpy as np
import pytest
from scipy.stats import norm

from archerfish.identification.profile_likelihood import maximise_likelihood, profile_interval

VALUES = np.random.default_rng(4).normal(3.0, 2.0, 40)
BOUNDS = [(-50.0, 50.0), (-5.0, 5.0)]


def normal(point):
    return -norm.logpdf(VALUES, point[0], np.exp(point[1])).sum()


def test_the_maximum_is_mean_and_deviation():
    best = maximise_likelihood(normal, [np.array([0.0, 0.0]), np.array([10.0, 2.0])], BOUNDS)
    np.testing.assert_allclose(best, [VALUES.mean(), np.log(VALUES.std())], atol=1e-4)


def test_the_profile_of_a_normal_mean_has_a_closed_form():
    # 2 (max − profile) = n ln(1 + (m − x̄)²/s²) = χ²₁(95 %).
    best = np.array([VALUES.mean(), np.log(VALUES.std())])
    half = VALUES.std() * np.sqrt(np.exp(3.841458820694124 / VALUES.size) - 1)
    low, high = profile_interval(normal, best, 0, BOUNDS)
    assert low == pytest.approx(VALUES.mean() - half, abs=2e-3)
    assert high == pytest.approx(VALUES.mean() + half, abs=2e-3)


def test_a_flat_side_ends_at_its_bound():
    def ramp(point):
        return float(max(point[0], 0.0) * 10 + point[1] ** 2)

    low, high = profile_interval(ramp, np.zeros(2), 0, [(-3.0, 3.0), (-1.0, 1.0)])
    assert low == -3.0
    assert high == pytest.approx(0.1920729, abs=1e-3)
