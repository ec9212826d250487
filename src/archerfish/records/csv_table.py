"""Numbers from the named columns of a CSV file, with the line in every complaint."""

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError, file_error


class CsvTable(NamedTuple):
    """The wanted columns of a CSV file."""

    columns: dict[str, NDArray[np.float64]]
    """Name → values, each of shape (N,), all finite."""
    lines: NDArray[np.int64]
    """Line of the file that each row came from, counted from 1; shape (N,)."""


def read_csv_columns(path: Path, wanted: Sequence[str], optional: Sequence[str] = ()) -> CsvTable:
    """Read columns of finite numbers.

    The first line names the columns; fields are separated by commas, semicolons or tabs (the first line tells).
    Blank lines are passed over.

    Args:
      path: the file.
      wanted: names of columns that must be there.
      optional: names of columns that are read if they are there.

    Raises:
      InputError: if the file is missing, unreadable or empty, a column is missing or named twice, or a field is
        missing or not a finite number.
    """
    header, rows = _split(path)
    found = [*wanted, *(name for name in optional if name in header)]
    positions = {name: _position(path, header, name) for name in found}
    lines: list[int] = []
    values: dict[str, list[float]] = {name: [] for name in found}
    for line, fields in rows:
        lines.append(line)
        for name, position in positions.items():
            values[name].append(_number(path, line, name, fields, position))
    if not lines:
        raise file_error(path, "has a first line but no data", "pass a log that holds samples")
    return CsvTable({name: np.array(column) for name, column in values.items()}, np.array(lines))


def _split(path: Path) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    try:
        # Spreadsheets begin a file with a byte order mark; utf-8-sig drops it.
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError as error:
        raise file_error(path, "no such file", "check the path") from error
    except (OSError, UnicodeDecodeError) as error:
        raise file_error(path, f"can't be read ({error})", "pass a readable CSV file in UTF-8") from error
    if not any(line.strip() for line in lines):
        raise file_error(path, "is empty", "pass a CSV file whose first line names the columns")
    delimiter = max(",;\t", key=lines[0].count)
    header = [name.strip() for name in next(csv.reader(lines[:1], delimiter=delimiter))]
    fields = csv.reader(lines[1:], delimiter=delimiter)
    return header, ((fields.line_num + 1, row) for row in fields if any(field.strip() for field in row))


def _position(path: Path, header: list[str], name: str) -> int:
    if name not in header:
        there = ", ".join(f'"{each}"' for each in header if each)
        raise file_error(path, f'line 1: no column "{name}"', f"the columns are {there}; name one of them")
    if header.count(name) > 1:
        raise file_error(path, f'line 1: {header.count(name)} columns are named "{name}"', "rename all but one")
    return header.index(name)


def _number(path: Path, line: int, name: str, fields: list[str], position: int) -> float:
    if position >= len(fields) or not fields[position].strip():
        problem = f'line {line}: column "{name}" is empty, expected a number'
        raise file_error(path, problem, "fill in the value or remove the line")
    try:
        value = float(fields[position])
    except ValueError as error:
        problem = f'line {line}: column "{name}" is "{fields[position].strip()}", expected a number'
        raise InputError(f"{path}: {problem}; mend the value or remove the line") from error
    if not math.isfinite(value):
        problem = f'line {line}: column "{name}" is {value}, expected a finite number'
        raise file_error(path, problem, "cut the log before the fault, or at it into two logs")
    return value
