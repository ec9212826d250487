import numpy as np
import pytest
from scipy.stats import binomtest

from archerfish.identification.sensing.stamp_timing import (
    Z95,
    frame_timing,
    long_run_covariance,
    share_interval,
    standard_error,
)
from archerfish.records.errors import InputError

GRID = np.arange(1600) / 80


def test_rate_and_missed_frames_of_an_even_camera_are_exact():
    kept = np.ones(1600, dtype=bool)
    kept[[5, 6, 100, 900]] = False
    timing = frame_timing(1.7e9 + GRID[kept])
    assert timing.period == pytest.approx(1 / 80, rel=1e-6)
    assert (timing.seen, timing.missed, timing.out_of_view) == (1596, 4, 0)


@pytest.mark.parametrize("jitter", [2e-4, 1.5e-3])
def test_the_interval_of_the_period_holds_under_jitter_and_misses(jitter):
    covered, missed = 0, []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        stamps = np.sort(GRID + jitter * rng.standard_normal(GRID.size))
        timing = frame_timing(stamps[rng.random(GRID.size) > 0.1])
        covered += abs(timing.period - 1 / 80) <= Z95 * timing.period_sd
        missed.append(timing.missed / (timing.seen + timing.missed))
    # Of 400 intervals that hold 95 %, 365 to 393 hold in all but 1 in 1000 sets.
    assert 365 <= covered <= 393
    assert np.mean(missed) == pytest.approx(0.1, abs=0.003)


def test_the_interval_holds_for_a_timer_that_starts_anew_with_each_frame():
    covered = 0
    for seed in range(60):
        stamps = np.cumsum(1 / 80 + 5e-4 * np.random.default_rng(seed).standard_normal(1600))
        timing = frame_timing(stamps)
        covered += abs(timing.period - 1 / 80) <= Z95 * timing.period_sd
    assert covered >= 50


def test_a_plate_out_of_view_is_no_row_of_misses():
    timing = frame_timing(GRID[(GRID < 5) | (GRID > 9)])
    assert (timing.missed, timing.out_of_view) == (0, 1)


def test_most_frames_may_be_missed():
    rng = np.random.default_rng(0)
    assert frame_timing(GRID[rng.random(GRID.size) > 0.6]).period == pytest.approx(1 / 80, rel=1e-6)


def test_too_few_stamps_are_refused():
    with pytest.raises(InputError, match="19 detections are too few"):
        frame_timing(GRID[:19])


def test_the_standard_error_knows_serial_correlation():
    # AR(1) with 0.5: the long-run variance is 1 / (1 - 0.5)² = 4 times the innovation's.
    rng = np.random.default_rng(1)
    series = np.zeros(20_000)
    for index, draw in enumerate(rng.standard_normal(series.size - 1)):
        series[index + 1] = 0.5 * series[index] + draw
    assert long_run_covariance(series[:, None]).item() == pytest.approx(4.0, rel=0.15)
    assert standard_error(series) == pytest.approx(np.sqrt(4.0 / series.size), rel=0.1)


def test_the_interval_of_a_share_is_wilsons():
    for count in (0, 3, 40):
        interval = binomtest(count, 40).proportion_ci(method="wilson")
        assert share_interval(count, 40) == pytest.approx((interval.low, interval.high), abs=1e-12)
