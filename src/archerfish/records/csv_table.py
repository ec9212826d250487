"""Numbers from the columns of a text table, with the line in every complaint."""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError, file_error
from archerfish.records.findings import Finding
from archerfish.records.log_table import LogTable
from archerfish.records.text_rows import (
    COMMA_NUMBER,
    MISSING,
    Row,
    TextTable,
    check_comments,
    read_table_lines,
    whole_rows,
)
from archerfish.records.torn_line import torn_end

Values = NDArray[np.float64]

_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_SHOWN = 40
"""Characters of a bad field that a message shows."""


class CsvTable(NamedTuple):
    """The wanted columns of a CSV file."""

    columns: dict[str, Values]
    """Name → values, each of shape (N,), all finite."""
    lines: NDArray[np.int64]
    """Line of the file that each row came from, counted from 1; shape (N,)."""


class _Content(NamedTuple):
    columns: dict[str, Values]  # NaN where a value is missing
    lines: NDArray[np.int64]
    separators_only: NDArray[np.bool_]  # rows that hold no field at all
    commas: bool  # decimal commas were read as points


class Header(NamedTuple):
    """What names the columns of a text table."""

    names: list[str]
    """Names of the columns, or their numbers where the first line holds numbers only."""
    line: int
    """Line of the file that holds them, counted from 1."""


def read_header(path: Path) -> Header:
    """Return what names the columns of a text table.

    Raises:
      InputError: if the file can't be read as text.
    """
    table = read_table_lines(path)
    return Header(table.names, max(table.first, 1))


def read_csv_columns(path: Path, wanted: Sequence[str], optional: Sequence[str] = ()) -> CsvTable:
    """Read columns of finite numbers; nothing is missing and nothing is repaired.

    Args:
      path: the file; see `read_text_table`.
      wanted: names of columns that must be there.
      optional: names of columns that are read if they are there.

    Raises:
      InputError: as `read_text_table`, and if a field is missing, has a decimal comma, or the last line breaks off or
        has zero bytes after it.
    """
    table = read_table_lines(path)
    positions = _positions(path, table, wanted, optional)
    if (torn := torn_end(table, list(positions.values()))) is not None:
        remedy = "complete it and end it with a line break, or remove it"
        raise file_error(path, f"line {len(table.lines)}: the last line breaks off {torn}", remedy, "truncated")
    if table.zero_bytes:
        remedy = "remove them if no line is missing, else complete the file"
        raise file_error(
            path,
            f"line {len(table.lines)}: {_zeros(table)} after the last line: samples can have stood there",
            remedy,
            "zero-bytes",
        )
    content = _content(path, table, positions)
    if content.commas:
        raise file_error(path, "holds decimal commas", "write decimal points", "decimal-comma")
    # Spreadsheets set groups apart by rows of separators alone; there is no record in them.
    held = ~content.separators_only
    columns, lines = {name: values[held] for name, values in content.columns.items()}, content.lines[held]
    for name, values in columns.items():
        for index in np.flatnonzero(np.isnan(values))[:1]:
            problem = f'line {lines[index]}: column "{name}" is empty or nan, expected a number'
            raise file_error(path, problem, "fill in the value or remove the line", "missing-values")
    return CsvTable(columns, lines)


def read_text_table(path: Path, wanted: Sequence[str], optional: Sequence[str] = ()) -> LogTable:
    """Read columns of numbers from a text table; missing values become NaN.

    The first line names the columns; where it holds numbers only, columns are called by their number: "1", "2", ….
    Fields are separated by commas, semicolons, tabs or blanks, whichever the first line has. Blank lines are passed
    over; a line of separators alone is a row without values. Decimal commas are read where they can be nothing else,
    and a last line that breaks off and zero bytes after the last line are left out; findings say so. Every other line
    is read whole.

    Args:
      path: the file.
      wanted: names of columns that must be there.
      optional: names of columns that are read if they are there.

    Raises:
      InputError: if the file can't be read, a column is missing or named twice, a line has other fields than the first
        one, or a field is no finite number.
    """
    table, findings = read_table_lines(path), []
    positions = _positions(path, table, wanted, optional)
    place, torn = f"{path}: line {len(table.lines)}", torn_end(table, list(positions.values()))
    if torn is not None:
        zeros = f", with {_zeros(table)} after it" if table.zero_bytes else ""
        message = f"the last line breaks off {torn}{zeros}; it was left out"
        remedy = "stop the recorder before copying its log, or end a last line that is whole with a line break"
        findings.append(Finding("truncated", "repaired", place, message, remedy, 1))
        table = table._replace(lines=table.lines[:-1], finished=True)
    elif table.zero_bytes:
        message = f"{_zeros(table)} after the last line were left out: samples that were to stand there are lost"
        remedy = "stop the recorder before its power is cut"
        findings.append(Finding("zero-bytes", "repaired", place, message, remedy))
    content = _content(path, table, positions)
    if content.commas:
        message = "decimal commas were read as decimal points"
        findings.append(Finding("decimal-comma", "repaired", str(path), message, "write decimal points"))
    return LogTable(content.columns, None, "", content.lines, "line", str(path), tuple(findings))


def _zeros(table: TextTable) -> str:
    return f"{table.zero_bytes} zero byte{'s' if table.zero_bytes > 1 else ''}"


def _positions(path: Path, table: TextTable, wanted: Sequence[str], optional: Sequence[str]) -> dict[str, int]:
    found = dict.fromkeys([*wanted, *(name for name in optional if name in table.names)])
    return {name: _position(path, table, name) for name in found}


def _position(path: Path, table: TextTable, name: str) -> int:
    if name not in table.names:
        there = ", ".join(f'"{each}"' for each in table.names if each)
        line = f"line {max(table.first, 1)}"
        raise file_error(path, f'{line}: no column "{name}"', f"the columns are {there}; name one of them", "no-column")
    if (count := table.names.count(name)) > 1:
        problem = f'line {table.first}: {count} columns are named "{name}"'
        raise file_error(path, problem, "rename all but one", "column-twice")
    return table.names.index(name)


def _content(path: Path, table: TextTable, positions: dict[str, int]) -> _Content:
    lines = np.arange(table.first + 1, len(table.lines) + 1)
    if not lines.size:
        raise file_error(path, "has a first line but no data", "pass a log that holds samples", "no-data")
    check_comments(path, table)
    values, commas = _all_numbers(table, list(positions.values())), False
    empty = np.zeros(lines.size, dtype=np.bool_)
    if values is None:
        rows = list(whole_rows(path, table))
        lines = np.array([row.line for row in rows], dtype=np.int64)
        empty = np.array([not row.fields for row in rows], dtype=np.bool_)
        values, commas = _numbers(path, rows, positions)
    columns = dict(zip(positions, values.T, strict=True))
    for name, column in columns.items():
        for index in np.flatnonzero(np.isinf(column))[:1]:
            problem = f'line {lines[index]}: column "{name}" is {column[index]}, expected a finite number'
            raise file_error(path, problem, "cut the log before the fault, or at it into two logs", "infinite")
    return _Content(columns, lines, empty, commas)


def _all_numbers(table: TextTable, positions: list[int]) -> Values | None:
    """Read in one go a table in which every line is whole and every field a number; else return None."""
    body, delimiter = table.lines[table.first :], table.delimiter
    columns: list[int] | None = positions
    if delimiter is None:
        columns = None  # a missing value shifts those after it: only all columns show that
    elif not _even(body, delimiter, table.fewest, len(table.names)):
        return None
    try:
        values = np.loadtxt(body, delimiter=delimiter, usecols=columns, comments=None, ndmin=2)
    except ValueError:
        return None
    if len(values) != len(body) or np.isnan(values).any():
        return None
    if delimiter is None:
        return values[:, positions] if values.shape[1] == len(table.names) else None
    return values


def _even(body: list[str], delimiter: str, fewest: int, most: int) -> bool:
    """Return whether no line has quotation marks, and all have one number of fields that suits the names."""
    counts = {line.count(delimiter) + 1 for line in body}
    if len(counts) != 1 or any('"' in line for line in body):
        return False
    count = counts.pop()
    return fewest <= count <= most or (count == most + 1 and all(line.endswith(delimiter) for line in body))


def _numbers(path: Path, rows: list[Row], positions: dict[str, int]) -> tuple[Values, bool]:
    """Return the values, shape (rows, columns), and whether they had decimal commas."""
    texts = {name: [row.fields[at].strip() if row.fields else "" for row in rows] for name, at in positions.items()}
    commas = _decimal_commas(texts)
    if commas:
        texts = {name: [text.replace(",", ".") for text in column] for name, column in texts.items()}
    columns = [
        [_number(path, row.line, name, text) for row, text in zip(rows, column, strict=True)]
        for name, column in texts.items()
    ]
    return np.array(columns, dtype=np.float64).reshape(len(texts), len(rows)).T, commas


def _decimal_commas(texts: dict[str, list[str]]) -> bool:
    """Tell whether commas can only be decimal ones: no points, and one at least that separates no thousands."""
    filled = [text for column in texts.values() for text in column if "," in text or "." in text]
    commas = [text for text in filled if COMMA_NUMBER.fullmatch(text)]
    return bool(filled) and len(commas) == len(filled) and not all(_THOUSANDS.fullmatch(text) for text in commas)


def _number(path: Path, line: int, name: str, text: str) -> float:
    if text.lower() in MISSING:
        return math.nan
    try:
        if "_" not in text:  # Python's digit separator is no number in a log
            return float(text)
    except ValueError:
        pass
    shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
    problem = f'line {line}: column "{name}" is "{shown}", expected a number'
    raise InputError(f"{path}: {problem}; mend the value or remove the line", "not-a-number")
