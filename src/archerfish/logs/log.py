"""One function for logs of all formats: the content of a file shows what it is."""

import hashlib
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from archerfish.errors import InputError, checked_arguments, file_error
from archerfish.logs import signals, stamps
from archerfish.logs.arrays import ARCHIVE, array_fields, arrays_in, fields_of, is_structured, read_array_file, table_of
from archerfish.logs.bags import ENCODINGS, RECOVER, bag_signals, bag_tables, read_bag
from archerfish.logs.json_tables import is_json, json_fields
from archerfish.logs.recording import BAGS, Log, LogTable, Recording, Rows, Signals, log_fault, log_files, open_log
from archerfish.logs.text import column_names, read_text

_CONVERT = "save it with -v7 or as CSV, or: f = h5py.File(FILE); numpy.savez('log.npz', **{k: f[k][()] for k in f})"
"""What to do with a file of HDF5."""
_UNREAD = (
    ((b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"\xfd7zXZ\0", b"BZh"), "is compressed", "unpack it first"),
    ((b"\x89HDF", b"MATLAB 7.3"), "is an HDF5 file (MATLAB 7.3)", _CONVERT),
    ((b"\x93NUMPY",), "is a single NumPy array", "store the signals by name with numpy.savez"),
)
"""How files begin that can't be read, what they are, and what to do."""
Unit = Literal["rad", "deg"]
"""Of angles in a log."""
_LISTED = 8  # columns of a matrix, up to which they are listed
_Format = Literal["bag", "arrays", "json", "text"]


@checked_arguments
def read_log(
    source: Any,
    *,
    inputs: Sequence[str] = ("u",),
    outputs: Sequence[str] = ("y",),
    time: str | None = "time_s",
    sample_period_s: float | None = None,
    input_unit: Unit | None = None,
    output_unit: Unit | None = None,
) -> Log:
    """Read what went into an axis and what came out: CSV or another text table, .npz, .mat, a ROS bag, or arrays.

    A signal is the name of a column, in a text table without names its number from "1" on, in an array file the name
    of an array, or "NAME[0]" for the first column of a matrix, in a bag TOPIC/FIELD or TOPIC/JOINT/FIELD, in JSON or a
    struct the path to the field, "axis.yaw". After a minus, its sign is changed.

    Args:
      source: path of the file, or of the folder of a bag; or a mapping of names to arrays of shape (N,) or (N, m); or a
        data frame.
      inputs: names of the input signals.
      outputs: names of the output signals.
      time: name of the stamps, in seconds, or in the unit that the name ends with ("time_ms"); a bag has its own.
      sample_period_s: sampling period of a log without stamps, or whose stamps are not to be used [s].
      input_unit: "deg" of inputs that are to be turned from degrees into radians.
      output_unit: the same of outputs.

    Raises:
      InputError: naming the file and the line at fault, with a code, if the log can't be used.
    """
    inputs, outputs = ((names,) if isinstance(names, str) else tuple(names) for names in (inputs, outputs))
    if not (inputs and outputs):
        raise InputError("read_log: no input or no output is named; name at least one of each", "no-column")
    if (sample_period_s is not None or time is None) and not 0 < (sample_period_s or 0) < float("inf"):
        problem = f"sample_period_s is {sample_period_s}, expected a number above 0 s"
        raise InputError(f"read_log: {problem}; pass it, or the name of the stamps", "sample-period")
    scale_u, scale_y = _scales(inputs, input_unit), _scales(outputs, output_unit)
    inputs, outputs = (tuple(name.removeprefix("-") for name in group) for group in (inputs, outputs))
    names = Signals(inputs, outputs, time if sample_period_s is None else None)
    table, names, sha256 = _read(source, names)
    log, recordings = _log(table, names, sample_period_s, sha256), list[Recording]()
    for each in log.recordings:
        recordings.append(replace(each, inputs=each.inputs * scale_u, outputs=each.outputs * scale_y))
    return replace(log, recordings=tuple(recordings))


def _scales(signals: Sequence[str], unit: Unit | None) -> list[float]:
    """Return what signals are multiplied by: -1 after a minus, radians over degrees."""
    size = math.radians(1) if unit == "deg" else 1.0
    return [-size if name.startswith("-") else size for name in signals]


def _read(source: Any, names: Signals) -> tuple[LogTable, Signals, str]:
    """Return the signals of any source, with the names that they have there, and the SHA-256 of a file."""
    if not isinstance(source, str | Path):
        return _table_in_memory(source, names), names, ""
    digest = hashlib.sha256()
    kind = _format(path := Path(source))
    for part in log_files(path):
        with open_log(part) as file:
            hashlib.file_digest(file, lambda: digest)
    with _damage_named(path, kind):
        if kind == "bag":
            table, names = read_bag(path, names), names._replace(time="time_s")
        elif kind == "text":
            table = read_text(path, lambda _: names.columns(), advice=names.remedy)
        elif kind == "json":
            fields, found = json_fields(path)
            table = replace(table_of(fields, names, str(path)), findings=found)
        else:
            table = read_array_file(path, names)
    return table, names, digest.hexdigest()


def _table_in_memory(source: Any, names: Signals) -> LogTable:
    columns = source if isinstance(source, Mapping) else getattr(source, "columns", None)
    columns = getattr(getattr(source, "dtype", None), "names", None) if columns is None else columns
    if columns is None:
        problem = f"read_log: got a {type(source).__name__}, expected a file, arrays by name, or a data frame"
        raise InputError(f"{problem}; pass archerfish.Recording.from_arrays(u, y, period_s)", "unknown-format")
    return table_of(dict(fields_of({name: source[name] for name in columns})), names, "table")


def _log(table: LogTable, names: Signals, period_s: float | None, sha256: str) -> Log:
    """Bring a table to equal intervals, step by step; each step returns its findings."""
    rows, findings = Rows.of(table, names, period_s or 1.0), [*table.findings]
    before_averages = stamps.in_seconds, stamps.in_order, signals.undo_wraps
    to_samples = stamps.hold_inputs, stamps.without_repeats, stamps.at_outputs, signals.non_repeated_samples
    for step in (*before_averages, *to_samples):
        rows, found = step(rows)
        findings += found
    samples = len(rows) + sum(finding.samples for finding in findings)
    parts, gaps = stamps.uninterrupted(rows)
    even, jitter = stamps.at_equal_intervals(parts, period_s)
    recordings, warnings = signals.checked(even, table.source)
    findings += [*gaps, *jitter, *warnings, *(stamps.period_findings(recordings[0]) if period_s else ())]
    return Log(tuple(recordings), tuple(findings), samples, table.source, sha256)


@checked_arguments
def signals_in(path: str | Path) -> tuple[str, ...]:
    """Return the names of what a file holds: columns of a table, arrays, or fields of a bag's topics as TOPIC/FIELD.

    Raises:
      InputError: if there is no such file, or it can't be read.
    """
    kind = _format(path := Path(path))
    with _damage_named(path, kind):
        if kind == "bag":
            return bag_signals(path)
        if kind == "json":
            return tuple(json_fields(path)[0])
        return column_names(path) if kind == "text" else tuple(array_fields(arrays_in(path)))


def tables_in(path: Path) -> list[LogTable]:
    """Return all numbers of a file, in a table for each topic of a bag, and for each length of arrays.

    Raises:
      InputError: if there is no such file, or it can't be read.
    """
    kind, by_length = _format(path), defaultdict[int, dict[str, Any]](dict)
    with _damage_named(path, kind):
        if kind == "bag":
            return list(bag_tables(path))
        if kind == "text":
            return [read_text(path, lambda names: [each for each in names if names.count(each) == 1], numbers=True)]
        fields = json_fields(path)[0] if kind == "json" else array_fields(arrays_in(path))
    for name, array in fields.items():
        shape = np.shape(array)
        several = len(shape) == 2 and min(shape) > 1
        for signal in [f"{name}[{index}]" for index in range(min(shape))][:_LISTED] if several else [name]:
            with suppress(InputError):  # of what is no number
                (column,) = table_of({name: array}, Signals((signal,), (signal,), None), str(path)).columns.values()
                by_length[len(column)][signal] = column
    return [
        LogTable(arrays, range(1, length + 1), "row", str(path)) for length, arrays in by_length.items() if length > 1
    ]


def _format(path: Path) -> _Format:
    """Return what the content of a file shows it to be, or else its ending."""
    if not (files := log_files(path)):
        raise file_error(path, "is a folder, and no bag's", "pass a log, or the folder of a bag", "unknown-format")
    with open_log(files[0]) as file:
        begin = file.peek()
    if path.is_dir() or begin.startswith(tuple(BAGS)) or path.suffix in BAGS.values():
        return "bag"
    for unread, problem, remedy in _UNREAD:
        if begin.startswith(unread) and not is_structured(begin):
            raise file_error(path, problem, remedy, "unknown-format")
    if is_json(begin):
        return "json"
    is_arrays = begin.startswith((ARCHIVE, b"MATLAB", b"\x93NUMPY")) or path.suffix in (".npz", ".mat")
    return "arrays" if is_arrays else "text"


@contextmanager
def _damage_named(path: Path, kind: _Format) -> Iterator[None]:
    """Turn whatever a damaged byte leads the libraries to into an error that says so."""
    try:
        yield
    except InputError:
        raise
    except ImportError as error:
        raise log_fault(path, "is a bag: needs rosbags", "pip install archerfish[bags]", "no-library") from error
    except Exception as error:
        if kind == "text":
            raise
        if isinstance(error, KeyError) and error.args[0] in ENCODINGS:
            problem, remedy = f"has messages in {error.args[0]}, expected those of ROS 2", "export its signals as CSV"
            raise log_fault(path, problem, remedy, "unknown-format") from error
        problem = "is damaged, or no bag" if kind == "bag" else "is damaged"
        remedy = RECOVER if kind == "bag" else "write the file again, its signals as arrays of numbers"
        code = "damaged"
        if "Object array" in str(error):
            problem, code = "has objects", "not-a-number"
        raise log_fault(path, f"{problem} ({type(error).__name__}: {str(error)[:200]})", remedy, code) from error
