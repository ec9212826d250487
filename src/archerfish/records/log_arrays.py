"""Logs in array files: NumPy's .npz and MATLAB's .mat; nothing in them is ever executed."""

import math
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError, file_error
from archerfish.records.log_table import MAX_BYTES, LogTable
from archerfish.records.text_file import check_readable

Shape = tuple[int, ...]

_ELEMENT = re.compile(r"(.+)\[(\d+)\]")
_NUMERIC = "fiub"
_MATLAB_NUMERIC = {
    "double",
    "single",
    "logical",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}


def read_npz(path: Path, wanted: Sequence[str]) -> LogTable:
    """Read signals from an .npz file: one-dimensional arrays by their key, columns of two-dimensional ones as KEY[0].

    An array is read only if its header agrees with the size of its member: a file of a few kilobytes can't claim the
    memory. Arrays of objects, which would have to be unpickled, are refused.

    Raises:
      InputError: if the file is damaged, an array is missing, too large, of objects, or of another length.
    """
    check_readable(path)
    try:
        with zipfile.ZipFile(path) as archive:
            there = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
            arrays = {name: _npz_array(path, archive, f"{name}.npy", name) for name in _variables(path, wanted, there)}
    except (zipfile.BadZipFile, OSError, EOFError, ValueError, NotImplementedError, RuntimeError) as error:
        if isinstance(error, InputError):
            raise
        raise file_error(path, f"is damaged ({error})", "write the file again", "damaged") from error
    return _table(path, arrays, wanted)


def _npz_array(path: Path, archive: zipfile.ZipFile, member: str, name: str) -> NDArray[Any]:
    size = archive.getinfo(member).file_size
    if size > MAX_BYTES:
        raise _too_large(path, name, size)
    with archive.open(member) as stream:
        shape, fortran, dtype = _npy_header(stream)
        if dtype.kind not in _NUMERIC:
            raise _not_numeric(path, name, str(dtype))
        if math.prod(shape) * dtype.itemsize != size - stream.tell():
            raise file_error(path, f'array "{name}" is not as long as it says', "write the file again", "damaged")
        flat = np.frombuffer(stream.read(), dtype)
    return flat.reshape(shape, order="F" if fortran else "C")


def _npy_header(stream: Any) -> tuple[Shape, bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)
    read: BinaryIO = stream
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    return header(read)


def read_mat(path: Path, wanted: Sequence[str]) -> LogTable:
    """Read signals from a MATLAB file of version 4 to 7: vectors by their name, columns of matrices as NAME[0].

    Raises:
      InputError: if the file is damaged or of version 7.3, or a variable is missing, too large, not numeric, or of
        another length.
    """
    from scipy.io import loadmat, whosmat  # takes long to import, and few logs need it

    check_readable(path)
    try:
        listed = whosmat(path)
        there = {name: (shape, kind) for name, shape, kind in listed}
        names = _variables(path, wanted, [name for name, _, _ in listed])
        for name in names:
            shape, kind = there[name]
            if kind not in _MATLAB_NUMERIC:
                raise _not_numeric(path, name, kind)
            if 8 * math.prod(shape) > MAX_BYTES:
                raise _too_large(path, name, 8 * math.prod(shape))
        loaded = loadmat(path, variable_names=names)
    except InputError:
        raise
    except NotImplementedError as error:
        raise file_error(path, "is a MATLAB file of version 7.3", "save it with -v7", "unknown-format") from error
    except Exception as error:  # SciPy's reader raises whatever a damaged byte leads it to
        raise file_error(path, f"is damaged ({error})", "write the file again", "damaged") from error
    return _table(path, {name: np.asarray(loaded[name]) for name in names}, wanted)


def _variables(path: Path, wanted: Sequence[str], there: Sequence[str]) -> list[str]:
    """Return the variables that hold the wanted signals, each of which must be there once."""
    names = []
    for signal in wanted:
        element = _ELEMENT.fullmatch(signal)
        name = element[1] if signal not in there and element else signal
        if name not in there:
            listed = ", ".join(f'"{each}"' for each in sorted(set(there))) or "none"
            raise file_error(
                path, f'holds no array "{name}"', f"the arrays are {listed}; name one of them", "no-column"
            )
        if (count := there.count(name)) > 1:
            problem = f'holds {count} arrays "{name}", of which the last would hide the others'
            raise file_error(path, problem, "write each log into a file of its own", "column-twice")
        names.append(name)
    return list(dict.fromkeys(names))


def _table(path: Path, arrays: dict[str, NDArray[Any]], wanted: Sequence[str]) -> LogTable:
    columns = {signal: _column(path, arrays, signal) for signal in wanted}
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f'"{name}" {length}' for name, length in lengths.items())
        problem = f"the signals differ in length ({told} samples)"
        raise file_error(path, problem, "store signals of one log with one length", "length")
    count = max(lengths.values(), default=0)
    if not count:
        raise file_error(path, "holds no samples", "pass a log that does", "no-data")
    return LogTable(columns, None, "", np.arange(1, count + 1), "row", str(path))


def _column(path: Path, arrays: dict[str, NDArray[Any]], signal: str) -> NDArray[np.float64]:
    element = _ELEMENT.fullmatch(signal)
    if signal in arrays:
        values = arrays[signal]
        if values.ndim == 2 and 1 in values.shape:  # MATLAB's vectors
            values = values.reshape(-1)
        if values.ndim != 1:
            problem = f'array "{signal}" has shape {values.shape}, expected one column'
            raise file_error(path, problem, f'name one of its columns, for instance "{signal}[0]"', "no-column")
        return _finite(path, signal, values)
    assert element is not None
    matrix, index = arrays[element[1]], int(element[2])
    if matrix.ndim == 2 and matrix.shape[0] < matrix.shape[1]:
        matrix = matrix.T  # signals as rows: there are always more samples than signals
    if matrix.ndim != 2 or index >= matrix.shape[1]:
        problem = f'array "{element[1]}" has shape {matrix.shape}: no column {index}'
        raise file_error(path, problem, "columns are counted from 0", "no-column")
    return _finite(path, signal, matrix[:, index])


def _finite(path: Path, signal: str, values: NDArray[Any]) -> NDArray[np.float64]:
    if values.dtype.kind not in _NUMERIC:  # MATLAB's doubles may be complex
        raise _not_numeric(path, signal, str(values.dtype))
    numbers = values.astype(np.float64)
    for index in np.flatnonzero(np.isinf(numbers))[:1]:
        problem = f'row {index + 1}: "{signal}" is {numbers[index]}, expected a finite number'
        raise file_error(path, problem, "cut the log before the fault, or at it into two logs", "infinite")
    return numbers


def _not_numeric(path: Path, name: str, kind: str) -> InputError:
    return file_error(path, f'array "{name}" is of type {kind}', "store signals as numbers", "not-a-number")


def _too_large(path: Path, name: str, size: int) -> InputError:
    problem = f'array "{name}" unpacks to {size / 2**20:.0f} MB, where at most {MAX_BYTES / 2**20:.0f} MB are read'
    return file_error(path, problem, "cut the log into shorter ones", "too-large")
