"""One function for logs of all formats: the content of a file shows what it is."""

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path

from archerfish2.errors import InputError, file_error
from archerfish2.logs.arrays import read_array_file
from archerfish2.logs.recording import Log, Recording
from archerfish2.logs.stamps import at_equal_intervals, uninterrupted, usable_rows
from archerfish2.logs.table import MAX_BYTES, LogTable
from archerfish2.logs.text import read_text

_COMPRESSED, _BAGS = (b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"\xfd7zXZ\0", b"BZh"), (b"#ROSBAG", b"SQLite f", b"\x89MCAP")
_UNREAD = {
    **dict.fromkeys(_COMPRESSED, ("is compressed", "unpack it first")),
    **dict.fromkeys(_BAGS, ("is a ROS bag", "export its topics as CSV")),
    **dict.fromkeys((b"\x89HDF", b"MATLAB 7.3"), ("is an HDF5 file (MATLAB 7.3)", "save it with -v7, or as CSV")),
    b"\x93NUMPY": ("is a single NumPy array", "store the signals by name with numpy.savez"),
}
"""How files begin that can't be read, what they are, and what to do."""


def read_log(
    path: str | Path,
    *,
    inputs: Sequence[str] = ("u",),
    outputs: Sequence[str] = ("y",),
    time: str | None = "time_s",
    sample_period_s: float | None = None,
) -> Log:
    """Read what went into an axis and what came out: CSV or another text table, .npz, or .mat.

    A signal is the name of a column, in a text table without names its number from "1" on, in an array file the name
    of an array, or "NAME[0]" for the first column of a matrix.

    Args:
      path: of the file.
      inputs: names of the input signals.
      outputs: names of the output signals.
      time: name of the stamps, in seconds, or in the unit that the name ends with ("time_ms").
      sample_period_s: sampling period of a log without stamps, or whose stamps are not to be used [s].

    Raises:
      InputError: naming the file and the line at fault, with a code, if the log can't be used.
    """
    path, stamps = Path(path), time if sample_period_s is None else None
    signals = _names(inputs), _names(outputs)
    if stamps is None and not 0 < (sample_period_s or 0) < math.inf:
        problem = f"sample_period_s is {sample_period_s}, expected a number above 0 s"
        raise InputError(f"read_log: {problem}; pass it, or the name of the stamps", "sample-period")
    content = file_content(path)
    table = _table(path, content, list(dict.fromkeys([*([stamps] if stamps else []), *signals[0], *signals[1]])))
    table.check()
    rows, repairs = usable_rows(table, signals, stamps, sample_period_s or 1.0)
    parts, gaps = uninterrupted(rows, str(path))
    even, period, jitter = at_equal_intervals(parts, str(path))
    period_s, name = float(f"{period:.12g}"), path.name
    recordings = tuple(
        Recording(u, y, period_s, float(time[0]), *signals, f"{name}[{time[0]:.3f} s…]" if len(even) > 1 else name)
        for time, u, y in even
    )
    samples = len(table.places) + sum(each.samples for each in table.findings)
    findings = (*table.findings, *repairs, *gaps, *jitter)
    return Log(recordings, findings, samples, str(path), hashlib.sha256(content).hexdigest())


def _names(names: str | Sequence[str]) -> tuple[str, ...]:
    if not names:
        raise InputError("read_log: no input or no output is named; name at least one of each", "no-column")
    return (names,) if isinstance(names, str) else tuple(names)


def file_content(path: Path) -> bytes:
    """Return the bytes of a file that may be a log.

    Raises:
      InputError: if there is no such file, or it is too large or can't be read.
    """
    try:
        if not path.is_file():
            problem, code = ("is no file", "unreadable") if path.exists() else ("there is no such file", "no-such-file")
            raise file_error(path, problem, "pass a file that has a log", code)
        if (size := path.stat().st_size) > MAX_BYTES:
            problem = f"has {size >> 20} MB, expected at most {MAX_BYTES >> 20} MB"
            raise file_error(path, problem, "cut the log into shorter ones", "too-large")
        return path.read_bytes()
    except OSError as error:
        raise file_error(path, f"can't be read ({error.strerror})", "check its permissions", "unreadable") from error


def _table(path: Path, content: bytes, wanted: list[str]) -> LogTable:
    for begin, (problem, remedy) in _UNREAD.items():
        if content.startswith(begin):
            raise file_error(path, problem, remedy, "unknown-format")
    archive, matlab = content.startswith(b"PK\x03\x04"), content.startswith(b"MATLAB") or path.suffix == ".mat"
    if archive or matlab or path.suffix == ".npz":
        return read_array_file(path, content, wanted, matlab=matlab and not archive)
    return read_text(path, content, wanted)
