"""Logs as arrays by name: in memory, in NumPy's .npz and MATLAB's .mat; nothing in files is ever executed."""

import io
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.logs.recording import MAX_BYTES, LogTable, Signals, Values, listed, log_fault
from archerfish.logs.text import numbers_of

ARCHIVE = b"PK\x03\x04"
"""How .npz files begin; others are read as MATLAB's."""
_COLUMN = re.compile(r"(.+)\[(\d{1,9})\]")
_CONVERT = """import sys, warnings, numpy, scipy.io
def fields(name, each):
    for field in each.dtype.names or ():
        parts = [numpy.asarray(part[field]) for part in each.flat]
        if len(parts) > 1 and all(part.size == 1 for part in parts):
            parts = [numpy.concatenate([part.reshape(1) for part in parts])]
        for index, part in enumerate(parts):
            yield from fields(f"{name}[{index}].{field}" if len(parts) > 1 else f"{name}.{field}", part)
    if not each.dtype.names:
        yield name, each
warnings.simplefilter("error")  # of a name that is there twice
arrays = scipy.io.loadmat(sys.argv[1], appendmat=False)
found = (field for name, each in arrays.items() if not name.startswith("__") for field in fields(name, each))
numpy.savez(sys.stdout.buffer, **dict(found))"""
"""Program that turns a MATLAB file into an .npz file, structs into their fields."""
_SECOND = np.timedelta64(1, "s")


def read_array_file(path: Path, signals: Signals) -> LogTable:
    """Read signals from .npz or MATLAB files of version 4 to 7 by the names of `table_of`.

    Args:
      path: of the file.
      signals: their names.

    Raises:
      InputError: if an array is missing, there twice, too large, not of real numbers, or of another length than the
        others.
      Exception: whatever a damaged byte leads the libraries to.
    """
    archive, wanted = arrays_in(path), signals.columns()
    sizes = {member.filename.removesuffix(".npy"): member.file_size for member in archive.zip.infolist()}
    holding = {each: [name for name in sizes if f"{each}.".startswith((f"{name}[", f"{name}."))] for each in wanted}
    if not all(holding.values()):
        return table_of(array_fields(archive), signals, str(path))  # which lists what there is
    for name in chain.from_iterable(holding.values()):
        if archive.files.count(name) > 1:
            raise log_fault(path, f'has 2 arrays "{name}", expected one', "keep one of them", "column-twice")
        if sizes[name] > MAX_BYTES:
            problem = f'array "{name}" unpacks to {sizes[name] >> 20} MB, expected at most {MAX_BYTES >> 20} MB'
            raise log_fault(path, problem, "cut the log into shorter ones", "too-large")
    with warnings.catch_warnings(action="ignore"):  # of headers that Python 2 wrote
        arrays = {name: archive[name] for name in chain.from_iterable(holding.values())}
    return table_of(dict(fields_of(arrays)), signals, str(path))


def array_fields(archive: Any) -> dict[str, Any]:
    """Return what an archive of `arrays_in` has, by the names of `fields_of`, without objects and too large arrays.

    Raises:
      Exception: whatever a damaged byte leads the libraries to.
    """
    arrays = dict[str, Any]()
    for member in archive.zip.infolist():
        with suppress(ValueError):  # of objects
            name = member.filename.removesuffix(".npy")
            arrays |= {name: archive[name]} if member.file_size <= MAX_BYTES else {}
    return dict(fields_of(arrays))


def is_structured(begin: bytes) -> bool:
    """Return whether a file that begins so is an .npy file of an array with named fields."""
    return begin.startswith(b"\x93NUMPY") and b"'descr': [(" in begin


def fields_of(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield what has no fields in mappings, structured arrays and lists of lists or mappings, with the path to it.

    Fields are named "data.time", elements "position[0]"; of a list of N mappings each field is an array of N.
    """
    if isinstance(value, dict) and _are_numbered(value):
        value = [*value.values()]
    fields = value if isinstance(value, Mapping) else getattr(getattr(value, "dtype", None), "names", None)
    if fields is not None:
        for field in fields:
            yield from fields_of(value[field], f"{name}.{field}" if name else str(field))
    elif isinstance(value, list) and any(isinstance(row, dict) for row in value):
        objects = [row if isinstance(row, dict) else {} for row in value]
        for field in dict.fromkeys(chain.from_iterable(objects)):
            yield from fields_of([row.get(field) for row in objects], f"{name}.{field}" if name else field)
    elif isinstance(value, list) and any(isinstance(row, list) for row in value):
        columns = [row if isinstance(row, list) else [row] for row in value]
        if max(map(len, columns)) <= len(columns):  # more samples than signals: each list is a row
            columns = list(map(list, zip_longest(*columns)))
        for index, column in enumerate(columns):
            yield from fields_of(column, f"{name}[{index}]")
    else:
        yield name, value


def _are_numbered(fields: Mapping[Any, Any]) -> bool:
    """Return whether values have the numbers of their rows for names, as pandas writes them."""
    numbered = all(str(name).isdecimal() for name in fields)
    return bool(fields) and numbered and not any(np.ndim(value) for value in fields.values())


def table_of(arrays: Mapping[str, Any], signals: Signals, source: str) -> LogTable:
    """Take signals from arrays by name, N samples each: vectors, or columns of matrices as NAME[0].

    Raises:
      InputError: if an array is missing, not of real numbers, or of another length than the others.
    """
    columns = {name: _column(arrays, name, signals, source) for name in signals.columns()}
    if len(lengths := {len(values) for values in columns.values()}) > 1:
        problem = f"signals have {' and '.join(map(str, sorted(lengths)))} samples, expected one number"
        raise log_fault(source, problem, "store the signals of one log with one length", "length")
    return LogTable(columns, range(1, max(lengths) + 1), "row", source)


def arrays_in(path: Path) -> Any:
    """Open such a file: a mapping of names to arrays, with the names in `files` and the archive in `zip`."""
    content = path.read_bytes()
    if is_structured(content[:1000]):
        array = np.load(io.BytesIO(content), allow_pickle=False)
        np.savez(archive := io.BytesIO(), **{field: array[field] for field in array.dtype.names})
        content = archive.getvalue()
    elif not content.startswith(ARCHIVE):
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
    if values.dtype.kind in "Mm":
        values = (values - np.array(0, values.dtype)) / _SECOND
    if values.dtype.kind in "OU" and values.ndim == 1:
        texts = ["" if each is None else str(each) for each in values.tolist()]
        return numbers_of(source, "row", range(1, len(texts) + 1), name, texts)
    if values.dtype.kind not in "fiub":
        raise log_fault(source, f'array "{name}" is of type {values.dtype}', "store real numbers", "not-a-number")
    if column is None and values.size == max(values.shape, default=0):  # MATLAB's vectors are matrices
        return np.asarray(values.reshape(-1), np.float64)
    values = values[:, None] if values.ndim == 1 else values
    matrix = values.T if values.ndim == 2 and values.shape[0] < values.shape[1] else values  # more samples than signals
    if column is None or matrix.ndim != 2 or column >= matrix.shape[1]:
        problem = f'array "{name}" has shape {values.shape}, expected ' + ("one column" if column is None else "more")
        raise log_fault(source, problem, f'name one of its columns, the first as "{name}[0]"', "no-column")
    return np.asarray(matrix[:, column], np.float64)
