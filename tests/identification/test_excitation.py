import numpy as np
import pytest

from archerfish.identification.excitation import linear_sweep, step
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
    ],
)
def test_impossible_signals_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
