import numpy as np
import pytest

from archerfish.identification.sensing.link_timing import link_timing
from archerfish.records.message_times import MessageTimes


def times(latency: np.ndarray) -> MessageTimes:
    sent = 0.005 * np.arange(len(latency))
    return MessageTimes(sent, sent + latency)


def test_mean_and_scatter_are_those_of_the_latencies() -> None:
    latency = np.random.default_rng(1).uniform(0.005, 0.015, 500)
    found = link_timing(times(latency))
    assert found.mean == pytest.approx(latency.mean())
    assert found.jitter == pytest.approx(np.std(latency, ddof=1))
    for value, (low, high) in ((found.mean, found.mean_interval), (found.jitter, found.jitter_interval)):
        assert 0.0 < low < value < high


@pytest.mark.parametrize("correlation", [0.0, 0.7])
def test_intervals_hold_for_latencies_that_depend_on_one_another(correlation: float) -> None:
    # AR(1) about 10 ms with a deviation of 1 ms. Of 400 intervals of the mean that hold 95 %, 365 to 393 hold in all
    # but 1 in 1000 sets; correlated ones may fall a little short.
    covered = 0
    for seed in range(400):
        normals = np.random.default_rng(seed).standard_normal(800)
        series = np.empty_like(normals)
        series[0] = normals[0]
        for index in range(1, len(series)):
            series[index] = correlation * series[index - 1] + np.sqrt(1 - correlation**2) * normals[index]
        low, high = link_timing(times(0.010 + 0.001 * series)).mean_interval
        covered += low <= 0.010 <= high
    assert covered >= (365 if correlation == 0.0 else 350)
    assert covered <= 393


def test_the_interval_of_the_jitter_holds() -> None:
    # Of 400 intervals that hold 95 %, 365 or more hold in all but 1 in 2000 sets.
    covered = 0
    for seed in range(400):
        low, high = link_timing(times(0.010 + 0.001 * np.random.default_rng(seed).standard_normal(200))).jitter_interval
        covered += low <= 0.001 <= high
    assert covered >= 365


def test_constant_latencies_have_no_jitter() -> None:
    found = link_timing(times(np.full(100, 0.008)))
    assert found.mean == pytest.approx(0.008)
    assert found.jitter == pytest.approx(0.0, abs=1e-12)
