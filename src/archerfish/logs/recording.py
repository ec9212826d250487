"""What a log is on its way: columns as its file has them, rows of signals, recordings at equal intervals; findings."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archerfish.arrays import real_array
from archerfish.errors import InputError, checked_arguments, file_error, one_line
from archerfish.reports.style import Figure, new_figure, plot_style
from archerfish.storage import write_bytes

Values = NDArray[np.floating[Any]]
MAX_BYTES = 512 * 2**20
"""Of the largest file, and the largest array unpacked: an hour of two axes at 1 kHz as text."""
BAGS = {b"#ROSBAG": ".bag", b"SQLite f": ".db3", b"\x89MCAP": ".mcap"}
"""How files of a bag begin, and the ending of their names, by which rosbags recognises them."""
GAP = 3.0
"""Interval in periods from which a log is interrupted: what happened within can't be known from its ends."""
_EVEN = 0.1  # of a period, within which stamps are those of equal intervals
_LARGEST_VALUE = 1e30  # its square is finite


class Finding(NamedTuple):
    """What was found in a log. Faults that make it useless are raised as an `InputError` with the same codes."""

    code: str  # short, stable name
    severity: Literal["refused", "repaired", "warning"]  # what came of it
    place: str  # the file, and the line or row in it
    message: str  # what is there
    remedy: str  # what to do about it
    samples: int = 0  # that were left out


@dataclass(frozen=True, eq=False)
class LogTable:
    """Columns of a log, not at equal intervals yet.

    Raises:
      InputError: if there is no sample, or a value is infinite or beyond all units.
    """

    columns: dict[str, Values]  # by name, each of shape (N,); NaN where a value is missing
    places: Sequence[int]  # line or row of the file that each sample comes from, counted from 1; shape (N,)
    place_kind: str  # "line" or "row"
    source: str  # the file, for messages
    findings: tuple[Finding, ...] = ()  # what the reader repaired
    starts: tuple[int, ...] = ()  # rows, from 0 on, above which the names are repeated

    def __post_init__(self) -> None:
        if not len(self.places):
            raise log_fault(self.source, "has names but no samples", "pass a log that has some", "no-data")
        for name, values in self.columns.items():
            for row in np.flatnonzero(np.abs(values) > _LARGEST_VALUE)[:1]:
                problem = f'"{name}" is {values[row]:g}, expected a number within ±{_LARGEST_VALUE:g}'
                raise log_fault(self.place(row), problem, "cut the log there into two", "infinite")

    def place(self, index: int) -> str:
        """Return file and place of a sample."""
        return f"{self.source}: {self.place_kind} {self.places[index]}"


class Signals(NamedTuple):
    """Names of the signals that are read from a log."""

    inputs: tuple[str, ...]  # at least one
    outputs: tuple[str, ...]  # at least one
    time: str | None  # of the stamps; None of a log without them

    def columns(self) -> list[str]:
        """Return all names, each once."""
        return list(dict.fromkeys([*([self.time] if self.time else []), *self.inputs, *self.outputs]))

    def remedy(self, there: Sequence[str]) -> str:
        """Return where to name signals of a log that has other ones: if as many, in their order."""
        lacking = [name for name in self.columns() if name not in there]
        left = [other for other in there if other not in self.columns()]
        others = left if len(left) == len(lacking) else ["NAME"] * len(lacking)
        meant = dict(zip(lacking, others, strict=True))
        roles = {"time": [self.time] if self.time else [], "inputs": self.inputs, "outputs": self.outputs}
        words = dict[str, str]()
        for role, names in roles.items():
            word = ", ".join(f'"{meant.get(name, name)}"' for name in names)
            words[role] = f"({word})" if len(names) > 1 else word
        call = ", ".join(f"{role}={word}" for role, word in words.items() if word)
        lines = ", ".join(f"{role.removesuffix('s')} = {word}" for role, word in words.items() if word)
        return f"name them: read_log(FILE, {call}), or in logs.toml: {lines}"


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a log on their way to recordings. NaN stands for what a row lacks."""

    time: Values  # stamps [s], (N,)
    inputs: Values  # (N, m)
    outputs: Values  # (N, p)
    table: LogTable  # that they come from
    numbers: NDArray[np.intp]  # their rows in the table, from 0 on, (N,)
    signals: Signals
    starts: tuple[int, ...] = ()  # rows in the table at which another recording of the file begins

    @classmethod
    def of(cls, table: LogTable, signals: Signals, period_s: float) -> Self:
        """Return the rows of a table, which are some seconds apart where it has no stamps."""
        inputs, outputs = (np.column_stack([table.columns[name] for name in names]) for names in signals[:2])
        numbers = np.arange(len(inputs))
        time = table.columns[signals.time] if signals.time else period_s * numbers
        return cls(time, inputs, outputs, table, numbers, signals)

    def __len__(self) -> int:
        return len(self.time)

    def select(self, kept: slice | NDArray[Any]) -> Self:
        """Return some of the rows, by slice, by index or by a mask of shape (N,)."""
        time, inputs, outputs = self.time[kept], self.inputs[kept], self.outputs[kept]
        return replace(self, time=time, inputs=inputs, outputs=outputs, numbers=self.numbers[kept])

    def place(self, index: int) -> str:
        """Return file and place of a row."""
        return self.table.place(int(self.numbers[index]))


@dataclass(frozen=True, eq=False)
class Recording:
    """What went into an axis and what came out, sampled at equal intervals without interruption.

    Units are the log's own. An input is in force from its sample to the next one.

    Raises:
      InputError: if shapes disagree, a value is not finite, or there is no sample.
    """

    inputs: Values  # (N, m)
    outputs: Values  # (N, p)
    period_s: float  # sampling period [s]
    start_s: float = 0.0  # time of the first sample, since that of its log [s]
    input_names: tuple[str, ...] = ("u",)  # of the m inputs
    output_names: tuple[str, ...] = ("y",)  # of the p outputs
    source: str = "recording"  # where it comes from, for messages and titles

    def __post_init__(self) -> None:
        for letter, values, names in (("u", self.inputs, self.input_names), ("y", self.outputs, self.output_names)):
            if values.ndim != 2 or values.shape[1] != len(names) or not values.size:
                problem = f"{letter} has shape {values.shape}, expected (N, {len(names)}) of {listed(names)}"
                remedy = 'samples come first, several signals are named: input_names=("u", "v")'
                raise InputError(f"{self.source}: {problem}, not empty; {remedy}")
        if len(self) != len(self.outputs):
            problem = f"u has {len(self):,} samples and y {len(self.outputs):,}, expected as many"
            raise InputError(f"{self.source}: {problem}; cut both to the same samples")
        if not (np.isfinite(self.inputs).all() and np.isfinite(self.outputs).all() and np.isfinite(self.start_s)):
            raise InputError(f"{self.source}: has a value that is not finite; cut the recording there")
        if not 0 < self.period_s < np.inf:
            raise InputError(f"{self.source}: period_s is {self.period_s}, expected above 0 s; check the stamps")

    def __len__(self) -> int:
        return len(self.inputs)

    def __repr__(self) -> str:
        signals = f"{', '.join(self.input_names)} → {', '.join(self.output_names)}"
        length_s = self.period_s * len(self)
        return f"Recording({signals}: {len(self):,} samples every {self.period_s:g} s, {length_s:g} s, {self.source})"

    @property
    def time(self) -> Values:
        """Time of each sample [s], shape (N,)."""
        return np.asarray(self.start_s + self.period_s * np.arange(len(self)), dtype=np.float64)

    @classmethod
    @checked_arguments
    def from_arrays(
        cls, u: ArrayLike, y: ArrayLike, period_s: float | None = None, *, time: ArrayLike | None = None, **fields: Any
    ) -> Self:
        """Return a recording of signals in memory, with a sampling period or with even stamps.

        Args:
          u: inputs, shape (N,) or (N, m).
          y: outputs, shape (N,) or (N, p).
          period_s: sampling period [s].
          time: stamps instead of it [s], shape (N,); `read_log({"time_s": time, "u": u, "y": y})` takes uneven ones.
          **fields: other fields of a recording; input_names for several inputs, output_names for several outputs.

        Raises:
          InputError: if shapes disagree, a value is not finite, names are lacking, or stamps are uneven.
        """
        if (period_s is None) == (time is None):
            raise InputError("from_arrays: expected period_s, a number, or time; pass from_arrays(u, y, time=stamps)")
        inputs, outputs = (np.atleast_2d(real_array("from_arrays", signal).T).T for signal in (u, y))
        if time is None:
            return cls(inputs, outputs, float(period_s or 0), **fields)
        stamps = real_array("from_arrays: time", time)
        if stamps.shape != (len(inputs),) or len(stamps) < 2:
            raise InputError(f"from_arrays: time has shape {stamps.shape}, expected ({len(inputs)},), 2 or more")
        even = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
        if not (stamps[1:] > stamps[:-1]).all():
            raise InputError("from_arrays: time does not increase from sample to sample; sort the samples by time")
        late = np.abs(stamps - stamps[0] - even * np.arange(len(stamps))).max()
        if not 0 <= late < _EVEN * even:
            remedy = 'read_log({"time_s": time, "u": u, "y": y}) resamples them'
            raise InputError(f"from_arrays: stamps are uneven, {late:.3g} s off at most; {remedy}")
        return cls(inputs, outputs, float(f"{even:.12g}"), **fields)

    def write_csv(self, path: str | Path, time: str = "time_s") -> None:
        """Write a CSV file, from which `read_log` reads the same values.

        Args:
          path: of the file.
          time: name of its column of stamps [s].

        Raises:
          InputError: if it can't be written.
        """
        rows = csv.writer(text := io.StringIO(), lineterminator="\n")
        rows.writerow((time, *self.input_names, *self.output_names))
        rows.writerows(np.column_stack([self.time, self.inputs, self.outputs]).tolist())
        write_bytes(Path(path), text.getvalue().encode())


@dataclass(frozen=True, eq=False)
class Log:
    """A log that was read."""

    recordings: tuple[Recording, ...]  # its uninterrupted stretches, at least one, with one sampling period
    findings: tuple[Finding, ...]  # what was repaired, and what may spoil an estimate
    samples: int  # rows of the source, those included that findings left out
    source: str  # the file
    sha256: str  # of its content

    def plot(self) -> Figure:
        """Draw its signals over time, one above the other."""
        first = self.recordings[0]
        time = np.concatenate([part.time for part in self.recordings])
        signals = np.vstack([np.hstack([part.inputs, part.outputs]) for part in self.recordings]).T
        names = [*first.input_names, *first.output_names]
        return drawn_signals([(name, time, signal) for name, signal in zip(names, signals, strict=True)], "time [s]")

    def __repr__(self) -> str:
        lines = [*map(repr, self.recordings)]
        lines += [f"{found.severity}, {found.place}: {found.message}; {found.remedy}" for found in self.findings]
        return "\n  ".join([f"Log({self.source or 'table'}: {self.samples:,} samples)", *lines])


def drawn_signals(signals: Sequence[tuple[str, Values, Values]], abscissa: str) -> Figure:
    """Draw signals one above the other, without lines across gaps.

    Args:
      signals: label, time and values of each, shape (N,).
      abscissa: label of the time.
    """
    with plot_style():
        figure, panels = new_figure(len(signals), 1, height=1.0 + 1.3 * len(signals))
        for (label, time, values), panel in zip(signals, panels[:, 0], strict=True):
            known = np.column_stack([time, values])[~np.isnan(values)]
            steps = np.diff(known[:, 0], prepend=known[:1, 0])
            gaps = np.flatnonzero(steps > GAP * np.median(steps))
            panel.plot(*np.insert(known, gaps, np.nan, axis=0).T, linewidth=0.8)
            panel.set_title(label, fontsize=9, fontweight="normal")
        panels[-1, 0].set_xlabel(abscissa)
    return figure


def held_mean(time: Values, signals: Values, edges: Values) -> Values:
    """Average signals that hold each value until the next sample, and the last one further on.

    A plant that is slower than a sampling period responds to the mean of what was in force; the value at one instant
    would move each change by up to a period.

    Args:
      time: of the samples, shape (N,).
      signals: values from these times on, shape (N, m).
      edges: ends of K intervals, none before the first sample, shape (K + 1,).

    Returns:
      Means over the intervals, shape (K, m).
    """
    time = np.append(time, max(time[-1], edges[-1]))
    area = np.vstack([np.zeros(signals.shape[1]), np.cumsum(signals * np.diff(time)[:, None], axis=0)])
    return np.diff(by_lines(time, area, edges), axis=0) / np.diff(edges)[:, None]


def by_lines(time: Values, signals: Values, grid: Values) -> Values:
    """Return signals of shape (N, m) at K times by lines through their samples, shape (K, m)."""
    return np.column_stack([np.interp(grid, time, signal) for signal in signals.T])


def log_fault(path: str | Path, problem: str, remedy: str, code: str) -> InputError:
    """Return the error of a file, in one line whatever the file puts into the message; see `file_error`."""
    return file_error(path, one_line(problem), one_line(remedy), code)


def log_files(path: Path) -> list[Path]:
    """Return the files of a log: itself, or those of the bag in its folder; none where a folder is no bag's."""
    return sorted(file for file in path.iterdir() if file.suffix in BAGS.values()) if path.is_dir() else [path]


def open_log(path: Path) -> io.BufferedReader:
    """Open a log's file.

    Raises:
      InputError: if there is no such file, or it is too large or can't be read.
    """
    try:
        if not path.is_file():
            raise log_fault(path, "there is no such file", "pass a file that has a log", "no-such-file")
        if (size := path.stat().st_size) > MAX_BYTES:
            problem = f"has {size >> 20} MB, expected at most {MAX_BYTES >> 20} MB"
            raise log_fault(path, problem, "cut the log into shorter ones", "too-large")
        return path.open("rb")
    except OSError as error:
        raise log_fault(path, f"can't be read ({error.strerror})", "check its permissions", "unreadable") from error


def listed(names: Iterable[str]) -> str:
    """Return names in quotation marks, for a message; of a long list its beginning."""
    return (", ".join(f'"{name}"' for name in names if name) or "none")[:300]
