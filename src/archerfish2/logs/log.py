"""One function for logs of all formats: the content of a file shows what it is."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from archerfish2.errors import InputError, file_error
from archerfish2.logs.arrays import read_array_file
from archerfish2.logs.bags import BAGS, RECOVER, bag_files, read_bag
from archerfish2.logs.recording import Log, LogTable, Recording, log_fault, opened
from archerfish2.logs.signals import examined, fresh_rows, undo_wraps
from archerfish2.logs.stamps import at_equal_intervals, uninterrupted, usable_rows
from archerfish2.logs.text import read_text

_UNREAD = (
    ((b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"\xfd7zXZ\0", b"BZh"), "is compressed", "unpack it first"),
    ((b"\x89HDF", b"MATLAB 7.3"), "is an HDF5 file (MATLAB 7.3)", "save it with -v7, or as CSV"),
    ((b"\x93NUMPY",), "is a single NumPy array", "store the signals by name with numpy.savez"),
)
"""How files begin that can't be read, what they are, and what to do."""


def read_log(
    path: str | Path,
    *,
    inputs: Sequence[str] = ("u",),
    outputs: Sequence[str] = ("y",),
    time: str | None = "time_s",
    sample_period_s: float | None = None,
) -> Log:
    """Read what went into an axis and what came out: CSV or another text table, .npz, .mat, or a ROS bag.

    A signal is the name of a column, in a text table without names its number from "1" on, in an array file the name
    of an array, or "NAME[0]" for the first column of a matrix, in a bag TOPIC/FIELD or TOPIC/JOINT/FIELD.

    Args:
      path: of the file, or the folder of a bag.
      inputs: names of the input signals.
      outputs: names of the output signals.
      time: name of the stamps, in seconds, or in the unit that the name ends with ("time_ms"); a bag has its own.
      sample_period_s: sampling period of a log without stamps, or whose stamps are not to be used [s].

    Raises:
      InputError: naming the file and the line at fault, with a code, if the log can't be used.
    """
    path, stamps = Path(path), time if sample_period_s is None else None
    inputs, outputs = ((each,) if isinstance(each, str) else tuple(each) for each in (inputs, outputs))
    if not (inputs and outputs):
        raise InputError("read_log: no input or no output is named; name at least one of each", "no-column")
    signals = inputs, outputs
    if stamps is None and not 0 < (sample_period_s or 0) < float("inf"):
        problem = f"sample_period_s is {sample_period_s}, expected a number above 0 s"
        raise InputError(f"read_log: {problem}; pass it, or the name of the stamps", "sample-period")
    if not (files := bag_files(path)):
        raise file_error(path, "is a folder, and no bag's", "pass a log, or the folder of a bag", "unknown-format")
    begin, digest, source = b"", hashlib.sha256(), str(path)
    for each in files:
        with opened(each) as file:
            begin = begin or file.peek()
            hashlib.file_digest(file, lambda: digest)
    bag, wanted = path.is_dir() or begin.startswith(tuple(BAGS)) or path.suffix in BAGS.values(), (*inputs, *outputs)
    table = _table(path, begin, list(dict.fromkeys((stamps, *wanted) if stamps and not bag else wanted)), bag)
    rows, repairs = usable_rows(table, signals, "time_s" if bag else stamps, sample_period_s or 1.0)
    turns = list(undo_wraps([rows._replace(outputs=rows.outputs[:, :0])], (inputs, ()), source))
    fresh, repeats = fresh_rows(rows, source)
    parts, gaps = uninterrupted(fresh, source)
    wraps = list(undo_wraps(parts, signals, source))
    even, period, jitter = at_equal_intervals(parts, source)
    period_s = sample_period_s or float(f"{period:.12g}")
    piece = "[{:.3f} s…]" * (len(even) > 1)
    every = [Recording(u, y, period_s, float(at[0]), *signals, path.name + piece.format(at[0])) for at, u, y in even]
    recordings, warnings = examined(every, source)
    samples = len(rows.time) + sum(each.samples for each in (*table.findings, *repairs))
    findings = (*table.findings, *repairs, *turns, *repeats, *gaps, *wraps, *jitter, *warnings)
    return Log(recordings, findings, samples, source, digest.hexdigest())


def _table(path: Path, begin: bytes, wanted: list[str], bag: bool) -> LogTable:
    archive, matlab = begin.startswith(b"PK\x03\x04"), begin.startswith(b"MATLAB") or path.suffix == ".mat"
    try:
        if bag:
            return read_bag(path, wanted)
        for unread, problem, remedy in _UNREAD:
            if begin.startswith(unread):
                raise file_error(path, problem, remedy, "unknown-format")
        if archive or matlab or path.suffix == ".npz":
            return read_array_file(path, wanted, matlab=matlab and not archive)
    except InputError:
        raise
    except ImportError as error:
        raise log_fault(path, "is a bag: needs rosbags", "pip install archerfish[bags]", "no-library") from error
    except Exception as error:
        problem = f"is damaged, or {'no bag' if bag else 'has objects'} ({type(error).__name__}: {str(error)[:200]})"
        remedy = RECOVER if bag else "write the file again, its signals as arrays of numbers"
        raise log_fault(path, problem, remedy, "not-a-number" if "Object array" in str(error) else "damaged") from error
    return read_text(path, lambda _: wanted)
