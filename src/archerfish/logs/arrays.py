"""Logs as arrays by name: in memory, in NumPy's .npz and MATLAB's .mat; nothing in files is ever executed."""

import io
import re
import subprocess
import sys
import warnings
from collections.abc import Mapping, Sized
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.logs.recording import MAX_BYTES, LogTable, Signals, Values, listed, log_fault

ARCHIVE = b"PK\x03\x04"
"""How .npz files begin; others are read as MATLAB's."""
_COLUMN = re.compile(r"(.+)\[(\d{1,9})\]")
_CONVERT = """import sys, warnings, numpy, scipy.io
warnings.simplefilter("error")  # of a name that is there twice
arrays = scipy.io.loadmat(sys.argv[1], appendmat=False)
numpy.savez(sys.stdout.buffer, **{name: each for name, each in arrays.items() if not name.startswith("__")})"""
"""Program that turns a MATLAB file into an .npz file."""


def read_array_file(path: Path, signals: Signals) -> LogTable:
    """Read signals from .npz or MATLAB files of version 4 to 7: vectors by name, columns of matrices as NAME[0].

    Args:
      path: of the file.
      signals: their names.

    Raises:
      InputError: if an array is missing, there twice, too large, not of real numbers, or of another length than the
        others.
      Exception: whatever a damaged byte leads the libraries to.
    """
    archive, wanted = arrays_in(path), signals.columns()
    for member in archive.zip.infolist():
        name = member.filename.removesuffix(".npy")
        if not any(signal == name or signal.startswith(f"{name}[") for signal in wanted):
            continue
        if archive.files.count(name) > 1:
            raise log_fault(path, f'has 2 arrays "{name}", expected one', "keep one of them", "column-twice")
        if member.file_size > MAX_BYTES:
            problem = f'array "{name}" unpacks to {member.file_size >> 20} MB, expected at most {MAX_BYTES >> 20} MB'
            raise log_fault(path, problem, "cut the log into shorter ones", "too-large")
    with warnings.catch_warnings(action="ignore"):  # of headers that Python 2 wrote
        return table_of(archive, signals, str(path))


def table_of(arrays: Mapping[str, Any], signals: Signals, source: str) -> LogTable:
    """Take signals from arrays by name, N samples each: vectors, or columns of matrices as NAME[0].

    Raises:
      InputError: if an array is missing, not of real numbers, or of another length than the others.
    """
    columns = {name: _column(arrays, name, signals, source) for name in signals.columns()}
    return LogTable(columns, range(1, same_length(columns, source) + 1), "row", source)


def same_length(columns: Mapping[str, Sized], source: str) -> int:
    """Return the number of samples of all signals of a log.

    Raises:
      InputError: if it is not one.
    """
    if len(lengths := {len(values) for values in columns.values()}) > 1:
        problem = f"signals have {' and '.join(map(str, sorted(lengths)))} samples, expected one number"
        raise log_fault(source, problem, "store the signals of one log with one length", "length")
    return max(lengths)


def arrays_in(path: Path) -> Any:
    """Open such a file: a mapping of names to arrays, with the names in `files` and the archive in `zip`."""
    content = path.read_bytes()
    if not content.startswith(ARCHIVE):
        # In a process of its own: a damaged byte can crash SciPy's reader (scipy/scipy#25349).
        done = subprocess.run([sys.executable, "-c", _CONVERT, path], capture_output=True, check=False)
        if done.returncode:
            raise ValueError(done.stderr.decode(errors="replace").strip().rpartition("\n")[2] or "the reader crashed")
        content = done.stdout
    return np.load(io.BytesIO(content), allow_pickle=False)


def _column(arrays: Mapping[str, Any], signal: str, signals: Signals, source: str) -> Values:
    """Return a vector, or a column of a matrix."""
    match = None if signal in arrays else _COLUMN.fullmatch(signal)
    name, column = (match[1], int(match[2])) if match else (signal, None)
    if name not in arrays:
        remedy = f"the arrays are {listed(arrays)}; {signals.remedy(list(arrays))}"
        raise log_fault(source, f'has no array "{name}"', remedy, "no-column")
    values = np.asarray(arrays[name])
    if values.dtype.kind not in "fiub":
        raise log_fault(source, f'array "{name}" is of type {values.dtype}', "store real numbers", "not-a-number")
    if column is None and values.size == max(values.shape, default=0):  # MATLAB's vectors are matrices
        return np.asarray(values.reshape(-1), np.float64)
    matrix = values.T if values.ndim == 2 and values.shape[0] < values.shape[1] else values  # more samples than signals
    if column is None or matrix.ndim != 2 or column >= matrix.shape[1]:
        problem = f'array "{name}" has shape {values.shape}, expected ' + ("one column" if column is None else "more")
        raise log_fault(source, problem, f'name one of its columns, the first as "{name}[0]"', "no-column")
    return np.asarray(matrix[:, column], np.float64)
