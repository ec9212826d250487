"""Logs of an axis that is identified for decisions of a given period: the samples must fit into the decisions."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from archerfish.identification.doctor.time_stamps import GAP_PERIODS
from archerfish.records.csv_table import read_csv_columns
from archerfish.records.errors import file_error
from archerfish.records.recording import Recording, make_recording

_EVEN = 0.02
"""Share of the period by which stamps of an even log may be off."""
_FEWEST = 100
_LOST = 1.5
"""Times the median interval, above which a report has been lost in between."""


def read_axis_log(path: Path, decision_s: float) -> Recording:
    """Read the columns time_s, u and y, with a sampling period of which a decision takes a whole number.

    A log whose reports came evenly and at such a period is taken as it is. Any other one is resampled to the nearest
    such period that is not longer than between two reports, lost ones aside: the angle by a cubic spline, the command,
    which is held between its stamps, by its mean over each new period.

    Args:
      path: CSV file.
      decision_s: decision period [s].

    Raises:
      InputError: if a column or a number is missing or bad, there are too few samples, time does not increase, the
        samples are further apart than decisions, or there is a gap: what happened in it can't be interpolated.
    """
    table = read_csv_columns(path, ["time_s", "u", "y"])
    time, command, angle = (table.columns[name] for name in ("time_s", "u", "y"))
    if len(time) < _FEWEST:
        raise file_error(path, f"{len(time)} samples, expected at least {_FEWEST}", "record for longer", "too-short")
    for index in np.flatnonzero(np.diff(time) <= 0)[:1]:
        problem = f"line {table.lines[index + 1]}: time does not increase"
        raise file_error(path, problem, "sort the log", "time-backward")
    between = _interval(time)
    if between > decision_s * (1 + _EVEN):
        raise file_error(
            path, f"samples every {between:.4g} s", f"log at least every {decision_s} s, as often as it decides"
        )
    for index in np.flatnonzero(np.diff(time) > max(decision_s, GAP_PERIODS * between))[:1]:
        problem = f"line {table.lines[index + 1]}: {time[index + 1] - time[index]:.4g} s since the sample before"
        remedy = f"cut the log there, or record it again without interruptions of more than {decision_s:g} s"
        raise file_error(path, problem, remedy)
    period = decision_s / np.ceil(decision_s / between - _EVEN)
    even = np.abs(np.diff(time) - period).max() <= _EVEN * period
    if not even:
        edges = time[0] + period * np.arange(int((time[-1] - time[0]) / period) + 1)
        held = np.concatenate([[0.0], np.cumsum(command[:-1] * np.diff(time))])
        angle = CubicSpline(time, angle)(edges[:-1])
        command = np.diff(np.interp(edges, time, held)) / period
    return make_recording(command, angle, period, input_names=("u",), output_names=("y",), source=path.name)


def _interval(time: NDArray[np.float64]) -> float:
    """Return the mean time between two reports [s]; where some are lost, chance must not decide on it."""
    between = np.diff(time)
    return float(between[between <= _LOST * np.median(between)].mean())
