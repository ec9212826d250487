import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from archerfish.identification.rigid.coloured_residuals import coloured_covariance


def slopes(count, columns=2, outputs=1):
    time = np.arange(count)[:, None, None]
    return np.cos(0.02 * (1 + np.arange(columns)) * time + np.arange(outputs)[:, None])


def coloured(count, rho, seed, outputs=1):
    drawn = np.random.default_rng(seed).standard_normal((count + 300, outputs))
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], drawn, axis=0)[300:]


def mean_covariance(rho, count=1000, draws=40):
    G = slopes(count)
    return np.mean([coloured_covariance([G], [coloured(count, rho, seed)], [1], 2) for seed in range(draws)], axis=0)


@pytest.mark.parametrize(("rho", "rtol"), [(0.0, 0.1), (0.6, 0.15), (0.9, 0.25)])
def test_on_average_it_is_the_exact_covariance(rho, rtol):
    G = slopes(1000)[:, 0]
    bread = np.linalg.inv(G.T @ G)
    exact = bread @ G.T @ toeplitz(rho ** np.arange(1000)) @ G @ bread
    np.testing.assert_allclose(np.diag(mean_covariance(rho)), np.diag(exact), rtol=rtol)


def test_white_residuals_give_the_textbook_covariance():
    G = slopes(1000)[:, 0]
    np.testing.assert_allclose(np.diag(mean_covariance(0.0)), np.diag(np.linalg.inv(G.T @ G)), rtol=0.1)


def test_it_is_positive_and_symmetric_with_outputs_that_share_their_noise():
    G, noise = slopes(500, columns=3, outputs=2), coloured(500, 0.8, 0)
    found = coloured_covariance([G], [np.hstack([noise, noise])], [1], 3)
    np.testing.assert_allclose(found, found.T, atol=1e-12)
    assert np.linalg.eigvalsh(found).min() > 0


def test_two_outputs_with_the_same_noise_tell_no_more_than_one():
    G, noise = slopes(800), coloured(800, 0.5, 1)
    one = coloured_covariance([G], [noise], [1], 0)
    two = coloured_covariance([np.concatenate([G, G], axis=1)], [np.hstack([noise, noise])], [1], 0)
    np.testing.assert_allclose(two, one, rtol=1e-9)


def test_recordings_add_up():
    G, noise = slopes(600), coloured(600, 0.5, 2)
    once = coloured_covariance([G], [noise], [1], 0)
    np.testing.assert_allclose(coloured_covariance([G] * 2, [noise] * 2, [1, 1], 0), once / 2, rtol=1e-9)
