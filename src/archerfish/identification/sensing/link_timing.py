"""How long messages take over a link, from the stamps of both ends."""

from typing import NamedTuple

from archerfish.identification.sensing.command_delay import scatter_interval
from archerfish.identification.sensing.stamp_timing import Interval, around, standard_error
from archerfish.records.message_times import MessageTimes


class LinkTiming(NamedTuple):
    """Latency of the messages in one direction."""

    mean: float
    """[s]."""
    jitter: float
    """Standard deviation [s]."""
    mean_interval: Interval
    """95 % interval of the mean, which holds for latencies that depend on one another."""
    jitter_interval: Interval
    """95 % interval of the standard deviation."""


def link_timing(times: MessageTimes) -> LinkTiming:
    """Estimate mean and scatter of the latency."""
    latency = times.latency
    mean, jitter = float(latency.mean()), float(latency.std(ddof=1))
    return LinkTiming(mean, jitter, around(mean, standard_error(latency)), scatter_interval(latency))
