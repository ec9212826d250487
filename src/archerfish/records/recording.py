"""Recordings: uniformly sampled logs of what went into a gimbal axis and what came out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from archerfish.records import storage
from archerfish.records.csv_table import read_csv_columns
from archerfish.records.errors import InputError, file_error

Array = NDArray[np.float64]

JITTER_LIMIT = 0.1
"""Largest departure of a sampling interval from the sampling period, as a share of it.

A difference equation assumes equal intervals; at a tenth of a period the timing error is below what rounding of the
stamps does in common logs.
"""


@dataclass(frozen=True)
class Recording:
    """One uninterrupted log; units are the log's own (an axis that follows its command has the same on both sides)."""

    time: Array
    """Time of each sample [s], shape (N,)."""
    inputs: Array
    """Input signals, shape (N, m)."""
    outputs: Array
    """Output signals, shape (N, p)."""
    input_names: tuple[str, ...]
    """Names of the m inputs."""
    output_names: tuple[str, ...]
    """Names of the p outputs."""
    sample_period_s: float
    """Sampling period [s]."""
    source: str = ""
    """Where the log comes from, for messages and titles."""
    input_units: tuple[str, ...] = ()
    """Units of the m inputs where the source states them ("deg"); "" for one that is unknown, empty if all are."""
    output_units: tuple[str, ...] = ()
    """Units of the p outputs, likewise."""

    def __post_init__(self) -> None:
        count = self.time.size
        expected = {
            "time": (count,),
            "inputs": (count, len(self.input_names)),
            "outputs": (count, len(self.output_names)),
        }
        for name, shape in expected.items():
            found = getattr(self, name)
            if found.shape != shape:
                raise InputError(f"recording.{name} must have shape {shape}, got {found.shape}; check the arrays")
            if not np.all(np.isfinite(found)):
                raise InputError(f"recording.{name} holds a value that is not finite; cut the log at the fault")
        if count == 0:
            raise InputError(f"{self.source or 'recording'}: holds no samples; pass a log that does")
        if not self.sample_period_s > 0:
            raise InputError(
                f"recording.sample_period_s must be > 0 s, got {self.sample_period_s}; check the time column"
            )

    def __len__(self) -> int:
        return int(self.time.size)


def make_recording(
    inputs: Array,
    outputs: Array,
    sample_period_s: float,
    *,
    input_names: Sequence[str] = ("u",),
    output_names: Sequence[str] = ("y",),
    source: str = "",
) -> Recording:
    """Make a recording from signals sampled from time 0 on.

    Args:
      inputs: input signals, shape (N,) or (N, m).
      outputs: output signals, shape (N,) or (N, p).
      sample_period_s: sampling period [s].
      input_names: names of the m inputs.
      output_names: names of the p outputs.
      source: where the signals come from.

    Raises:
      InputError: if the shapes don't agree or a value is not finite.
    """
    u, y = (
        np.asarray(each, dtype=np.float64).reshape(len(each), len(names))
        for each, names in ((inputs, input_names), (outputs, output_names))
    )
    return Recording(
        _stamps(len(u), sample_period_s), u, y, tuple(input_names), tuple(output_names), sample_period_s, source
    )


def _stamps(count: int, sample_period_s: float) -> Array:
    return np.arange(count, dtype=np.float64) * sample_period_s


def slice_recording(recording: Recording, start: int, stop: int) -> Recording:
    """Return samples `start` to `stop` (exclusive) of a recording.

    Raises:
      InputError: if the range is empty or reaches outside the recording.
    """
    if not 0 <= start < stop <= len(recording):
        raise InputError(
            f"{recording.source or 'recording'}: can't take samples {start} to {stop} of {len(recording)}; "
            "give a range inside the recording"
        )
    return replace(
        recording,
        time=recording.time[start:stop],
        inputs=recording.inputs[start:stop],
        outputs=recording.outputs[start:stop],
        source=f"{recording.source}[{start}:{stop}]",
    )


def read_recording_csv(
    path: Path,
    time: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    sample_period_s: float | None = None,
) -> Recording:
    """Read a recording from named columns of a CSV file.

    Args:
      path: the file.
      time: column of the time stamps [s].
      inputs: columns of the inputs.
      outputs: columns of the outputs.
      sample_period_s: sampling period [s] of a log without time stamps; `time` is then not read.

    Raises:
      InputError: if a column or a number is missing or bad, time does not increase, or the sampling intervals differ
        by more than `JITTER_LIMIT`.
    """
    if sample_period_s is None:
        table = read_csv_columns(path, [time, *inputs, *outputs])
        stamps, period = table.columns[time], _sample_period(path, table.columns[time], table.lines)
    else:
        table = read_csv_columns(path, [*inputs, *outputs])
        stamps, period = _stamps(len(table.lines), sample_period_s), sample_period_s
    u, y = (np.column_stack([table.columns[name] for name in names]) for names in (inputs, outputs))
    return Recording(stamps, u, y, tuple(inputs), tuple(outputs), period, path.name)


def _sample_period(path: Path, stamps: Array, lines: NDArray[np.int64]) -> float:
    if stamps.size < 2:
        raise file_error(path, "holds one sample only", "pass a longer log", "too-short")
    intervals = np.diff(stamps)
    if np.any(intervals <= 0):
        worst = int(np.argmax(intervals <= 0)) + 1
        problem = f"line {lines[worst]}: time {stamps[worst]:g} s does not come after {stamps[worst - 1]:g} s"
        code = "time-backward" if intervals[worst - 1] < 0 else "time-duplicate"
        raise file_error(path, problem, "remove the repeated or disordered lines", code)
    period = float(np.median(intervals))
    departure = np.abs(intervals - period)
    worst = int(np.argmax(departure)) + 1
    if departure[worst - 1] > JITTER_LIMIT * period:
        problem = (
            f"line {lines[worst]}: {intervals[worst - 1]:g} s since the sample before, where the sampling period is "
            f"{period:g} s (limit ±{JITTER_LIMIT:.0%})"
        )
        raise file_error(path, problem, "cut the log at the gap, or resample it to equal intervals", "jitter")
    return float((stamps[-1] - stamps[0]) / (stamps.size - 1))


def write_recording_csv(path: Path, recording: Recording, *, time: str = "time_s") -> None:
    """Write a recording whole, as a CSV file that `read_recording_csv` reads back exactly.

    Raises:
      InputError: if the folder can't be written.
    """
    names = [time, *recording.input_names, *recording.output_names]
    rows = np.column_stack([recording.time, recording.inputs, recording.outputs])
    lines = [",".join(names), *(",".join(repr(float(value)) for value in row) for row in rows)]
    storage.write_text(path, "\n".join(lines) + "\n")
