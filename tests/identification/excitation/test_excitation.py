import numpy as np
import pytest

from archerfish.identification.excitation.signals import (
    linear_sweep,
    low_crest_phases,
    multisine,
    multisine_lines,
    prbs,
    staircase,
    step,
)
from archerfish.records.errors import InputError


def test_the_sweep_crosses_zero_as_often_as_its_mean_frequency_says():
    sweep = linear_sweep(10.0, 1e-3, low_hz=2.0, high_hz=50.0)
    crossings = np.count_nonzero(np.diff(np.signbit(sweep)))
    assert sweep.shape == (10000,)
    assert crossings == pytest.approx(2 * 10.0 * (2 + 50) / 2, abs=1)


def test_the_sweep_starts_slow_and_ends_fast():
    sweep = linear_sweep(10.0, 1e-3, low_hz=2.0, high_hz=50.0, amplitude=3.0)
    first, last = (np.count_nonzero(np.diff(np.signbit(part))) for part in (sweep[:1000], sweep[-1000:]))
    assert first == pytest.approx(2 * (2 + 4.4 / 2 + 0.2), abs=1.5)
    assert last == pytest.approx(2 * (50 - 2.4), abs=1.5)
    assert np.abs(sweep).max() == pytest.approx(3.0, rel=1e-3)


def test_the_step_rises_at_its_time():
    signal = step(1.0, 1e-3, start_s=0.05, amplitude=0.5)
    assert signal.shape == (1000,)
    assert np.flatnonzero(signal)[0] == 50
    assert set(signal) == {0.0, 0.5}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: linear_sweep(1.0, 1e-2, high_hz=50.0), "high_hz must be from 0 to below 50 Hz"),
        (lambda: linear_sweep(1.0, 0.0), "0 < sample_period_s"),
        (lambda: step(1.0, 1e-3, start_s=1.0), "start_s must be from 0 to below 1 s"),
        (lambda: multisine_lines(0.1, 1.0, 5.0), "no line from 1 to 5 Hz"),
        (lambda: multisine(np.array([60.0]), np.ones(1), np.zeros(1), 1.0, 0.01), "must be below 50 Hz"),
        (lambda: multisine(np.array([2.0]), np.ones(1), np.zeros(1), 0.505, 0.01), "whole number of sampling periods"),
        (lambda: prbs(1.0, 0.1, 0.01, bits=1), "2 to 32 bits"),
    ],
)
def test_impossible_signals_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_a_staircase_holds_each_level():
    np.testing.assert_array_equal(staircase([1.0, 0.0, -1.0], 0.02, 0.01), [1, 1, 0, 0, -1, -1])


def test_a_multisine_has_energy_at_its_lines_alone():
    lines = multisine_lines(2.0, 1.0, 5.0)
    np.testing.assert_allclose(lines, np.arange(2, 11) / 2)
    signal = multisine(lines, np.full(9, 0.3), np.zeros(9), 2.0, 1e-2)
    np.testing.assert_allclose(signal[0], 9 * 0.3)
    spectrum = np.abs(np.fft.rfft(signal)) * 2 / len(signal)
    np.testing.assert_allclose(spectrum[2:11], 0.3)
    np.testing.assert_allclose(np.delete(spectrum, np.arange(2, 11)), 0, atol=1e-12)


def crest(amplitude, phase, first=3):
    time = np.arange(20_000) / 20_000
    lines = first + np.arange(len(amplitude))
    signal = amplitude @ np.cos(2 * np.pi * lines[:, None] * time + phase[:, None])
    return np.abs(signal).max() / signal.std()


def test_clipping_lowers_the_crest_factor_below_schroeders():
    amplitude = np.ones(60)
    schroeder = -np.pi * np.arange(60) ** 2 / 60
    assert crest(amplitude, schroeder) > 1.85
    assert crest(amplitude, low_crest_phases(amplitude, 3, seed=0)) < 1.6
    assert crest(amplitude, np.random.default_rng(0).uniform(0, 6, 60)) > 2.3


def test_a_prbs_of_one_period_is_balanced_and_white():
    sequence = prbs(127 * 0.02, 0.02, 0.01, bits=7, seed=3)
    assert set(sequence) == {-1.0, 1.0}
    np.testing.assert_array_equal(sequence[::2], sequence[1::2])
    chips = sequence[::2]
    assert abs(chips.sum()) == 1
    correlation = [chips @ np.roll(chips, lag) for lag in range(1, 127)]
    np.testing.assert_array_equal(correlation, -1)


def test_the_seed_picks_where_a_prbs_begins():
    first, second = (prbs(2.54, 0.02, 0.01, bits=7, seed=seed) for seed in (1, 2))
    assert not np.array_equal(first, second)
    assert any(np.array_equal(first, np.roll(second, shift)) for shift in range(254))
