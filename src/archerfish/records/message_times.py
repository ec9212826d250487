"""When messages of a link were sent and received: one line per message."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.csv_table import read_csv_columns
from archerfish.records.errors import file_error

Array = NDArray[np.float64]

LONGEST_S = 2.0
"""A message that takes longer was stamped by two clocks [s]."""
FEWEST = 50
"""Messages that a distribution of latencies takes."""


class MessageTimes(NamedTuple):
    """Messages that arrived, both stamps by one clock or by synchronised ones."""

    sent: Array
    """When each was sent [s], increasing, shape (N,)."""
    received: Array
    """When each was received [s], shape (N,)."""

    @property
    def latency(self) -> Array:
        """Time that each took [s], shape (N,)."""
        return self.received - self.sent


def read_message_times_csv(path: Path) -> MessageTimes:
    """Read the columns sent_s and received_s of a CSV file.

    Raises:
      InputError: if a column or a number is missing or bad, times do not increase, a message was received before it was
        sent or long after, or there are fewer than 50.
    """
    table = read_csv_columns(path, ["sent_s", "received_s"])
    times = MessageTimes(table.columns["sent_s"], table.columns["received_s"])
    if len(times.sent) < FEWEST:
        raise file_error(path, f"{len(times.sent)} messages, expected at least {FEWEST}", "log for longer")
    for index in np.flatnonzero(np.diff(times.sent) <= 0)[:1]:
        raise file_error(path, f"line {table.lines[index + 1]}: sent_s does not increase", "sort by sent_s")
    for index in np.flatnonzero((times.latency < 0) | (times.latency > LONGEST_S))[:1]:
        problem = f"line {table.lines[index]}: received {times.latency[index]:.4g} s after it was sent, expected 0…2 s"
        raise file_error(path, problem, "stamp both ends by one clock, or by synchronised ones")
    return times
