import numpy as np
import pytest

from archerfish.identification.muzzle.dependence import durbin_watson, widening


def autoregression(rho, count, seed=0):
    noise = np.random.default_rng(seed).standard_normal(count)
    for index in range(1, count):
        noise[index] += rho * noise[index - 1]
    return noise


def test_the_statistic_of_a_hand_calculation():
    assert durbin_watson(np.array([1.0, -1.0, 1.0, -1.0])).statistic == pytest.approx(12 / 4)


def test_independent_series_pass_and_drifting_ones_fail():
    # One in a hundred independent series fails.
    rng = np.random.default_rng(1)
    assert sum(durbin_watson(rng.standard_normal(100)).p_value < 0.01 for _ in range(200)) <= 6
    assert all(durbin_watson(autoregression(0.7, 100, seed)).p_value < 0.01 for seed in range(20))


def test_standard_errors_widen_by_the_root_of_the_long_run_variance():
    # Of an AR(1) mean: (1 + ρ)/(1 − ρ) times the variance.
    longer = widening(autoregression(0.5, 200_000)[:, None], np.eye(1))[0]
    assert longer == pytest.approx(np.sqrt(3), rel=0.05)
    assert widening(autoregression(0.0, 200_000)[:, None], np.eye(1))[0] == pytest.approx(1.0, abs=0.02)


def test_alternating_series_do_not_shorten_them():
    assert widening(autoregression(-0.6, 2000)[:, None], np.eye(1))[0] == 1.0


def test_widened_intervals_of_a_drifting_mean_hold():
    held = []
    for seed in range(300):
        sample = autoregression(0.7, 100, seed)
        deviation = (sample - sample.mean()) / sample.std()
        longer = widening(np.stack([deviation, deviation**2 - 1], axis=1), np.eye(2))[0]
        held.append(abs(sample.mean()) < 1.98 * longer * sample.std(ddof=1) / 10)
    # Of 95 % with three standard deviations of 300 sets, 3.8 %.
    assert np.mean(held) > 0.912
