import numpy as np
import pytest
from scipy.optimize import minimize

from archerfish.identification.muzzle.restricted_likelihood import Residuals, deviance, fit_variances, profile_deviance


def mixed(seed=0, sds=(0.5, 2.0)):
    rng = np.random.default_rng(seed)
    scales = np.stack([np.linspace(1, 9, 60), np.linspace(4, 0.5, 60)])
    columns = np.stack([np.ones(60), np.linspace(-1, 1, 60)], axis=1)
    sd = np.sqrt(np.square(sds) @ scales)
    return Residuals(columns @ [3.0, 1.0] + sd * rng.standard_normal(60), columns, scales)


def test_one_variance_is_the_unbiased_one_of_regression():
    residuals = mixed()._replace(scales=np.ones((1, 60)))
    left = residuals.residual - residuals.columns @ np.linalg.lstsq(residuals.columns, residuals.residual)[0]
    assert fit_variances(residuals)[0] == pytest.approx(left @ left / 58, rel=1e-9)


def test_the_deviance_is_that_of_contrasts_free_of_the_mean():
    # Restricted likelihood is the likelihood of K r for any full-rank K with K X = 0.
    residuals = mixed()
    contrasts = np.linalg.svd(residuals.columns)[0][:, 2:].T

    def of_contrasts(variances):
        covariance = contrasts @ np.diag(variances @ residuals.scales) @ contrasts.T
        seen = contrasts @ residuals.residual
        return np.linalg.slogdet(covariance)[1] + seen @ np.linalg.solve(covariance, seen)

    sets = np.array([[0.25, 4.0], [1.0, 1.0]])
    difference = np.diff(deviance(residuals, sets))[0]
    assert difference == pytest.approx(of_contrasts(sets[1]) - of_contrasts(sets[0]), rel=1e-9)


@pytest.mark.parametrize("sds", [(0.5, 2.0), (1.0, 0.0)])
def test_two_variances_are_at_the_minimum_that_a_general_search_finds(sds):
    residuals = mixed(1, sds)
    found = fit_variances(residuals)
    searched = minimize(
        lambda sd: deviance(residuals, sd[None] ** 2 + 1e-12)[0], [1.0, 1.0], method="Nelder-Mead", tol=1e-9
    )
    assert deviance(residuals, found[None])[0] == pytest.approx(searched.fun, abs=1e-3)


def test_the_profile_is_least_at_the_estimate():
    residuals = mixed(2)
    best = fit_variances(residuals)
    least = deviance(residuals, best[None])[0]
    for component in (0, 1):
        assert profile_deviance(residuals, component, best[component]) == pytest.approx(least, abs=2e-3)
        for factor in (0.3, 3.0):
            assert profile_deviance(residuals, component, factor * best[component]) > least
