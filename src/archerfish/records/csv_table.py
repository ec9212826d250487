"""Numbers from the columns of a text table, with the line in every complaint."""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError, file_error
from archerfish.records.findings import Finding, refusal
from archerfish.records.log_table import LogTable
from archerfish.records.text_file import read_lines

Row = tuple[int, list[str]]

_MISSING = {"", "nan", "na", "n/a", "null", "none"}
"""How loggers write a value that they did not have."""

_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


class CsvTable(NamedTuple):
    """The wanted columns of a CSV file."""

    columns: dict[str, NDArray[np.float64]]
    """Name → values, each of shape (N,), all finite."""
    lines: NDArray[np.int64]
    """Line of the file that each row came from, counted from 1; shape (N,)."""


class _Layout(NamedTuple):
    names: list[str]
    delimiter: str | None  # None: blanks
    first: int  # index of the first line of data


def read_csv_columns(path: Path, wanted: Sequence[str], optional: Sequence[str] = ()) -> CsvTable:
    """Read columns of finite numbers; nothing is missing and nothing is repaired.

    Args:
      path: the file; see `read_text_table`.
      wanted: names of columns that must be there.
      optional: names of columns that are read if they are there.

    Raises:
      InputError: as `read_text_table`, and if a field is missing or a line is cut off.
    """
    table = read_text_table(path, wanted, optional)
    for finding in table.findings:
        raise refusal(finding)
    for name, values in table.columns.items():
        for index in np.flatnonzero(np.isnan(values))[:1]:
            problem = f'line {table.places[index]}: column "{name}" is empty or nan, expected a number'
            raise file_error(path, problem, "fill in the value or remove the line", "missing-values")
    return CsvTable(table.columns, table.places)


def read_text_table(path: Path, wanted: Sequence[str], optional: Sequence[str] = ()) -> LogTable:
    """Read columns of numbers from a text table; missing values become NaN.

    The first line names the columns; where it holds numbers only, columns are called by their number: "1", "2", ….
    Fields are separated by commas, semicolons, tabs or blanks (the first line tells). Blank lines are passed over. A
    last line that was cut off is left out, and decimal commas are read where they can be nothing else; both are said.

    Args:
      path: the file.
      wanted: names of columns that must be there.
      optional: names of columns that are read if they are there.

    Raises:
      InputError: if the file can't be read, a column is missing or named twice, or a field is no finite number.
    """
    lines, finished = read_lines(path)
    layout = _layout(lines)
    found = list(dict.fromkeys([*wanted, *(name for name in optional if name in layout.names)]))
    positions = [_position(path, layout, name) for name in found]
    findings: list[Finding] = []
    values = _all_numbers(lines, layout, positions)
    places = np.arange(layout.first + 1, len(lines) + 1)
    if values is None:
        rows = _whole_rows(path, lines, layout, finished, findings)
        places = np.array([line for line, _ in rows], dtype=np.int64)
        values = _numbers(path, rows, dict(zip(found, positions, strict=True)), findings)
    if not places.size:
        raise file_error(path, "has a first line but no data", "pass a log that holds samples", "no-data")
    columns = dict(zip(found, values.T, strict=True))
    for name, column in columns.items():
        for index in np.flatnonzero(np.isinf(column))[:1]:
            problem = f'line {places[index]}: column "{name}" is {column[index]}, expected a finite number'
            raise file_error(path, problem, "cut the log before the fault, or at it into two logs", "infinite")
    return LogTable(columns, None, "", places, "line", str(path), tuple(findings))


def _layout(lines: list[str]) -> _Layout:
    while not lines[-1].strip():
        lines.pop()
    first = next(index for index, line in enumerate(lines) if line.strip())
    line = lines[first].lstrip("#% ") if lines[first].lstrip().startswith(("#", "%")) else lines[first]
    most = max(",;\t", key=line.count)
    delimiter = most if most in line else None
    fields = [field.strip() for field in _split(line, delimiter)]
    filled = fields[: max((i + 1 for i, field in enumerate(fields) if field), default=0)]
    if all(_is_number(field, delimiter) for field in filled):
        return _Layout([str(index + 1) for index in range(len(filled))], delimiter, first)
    return _Layout(fields, delimiter, first + 1)


def _split(line: str, delimiter: str | None) -> list[str]:
    return line.split() if delimiter is None else next(csv.reader([line], delimiter=delimiter))


def _is_number(text: str, delimiter: str | None) -> bool:
    if delimiter != "," and _COMMA_NUMBER.fullmatch(text):
        return True
    try:
        float(text)
    except ValueError:
        return False
    return True


def _position(path: Path, layout: _Layout, name: str) -> int:
    if name not in layout.names:
        there = ", ".join(f'"{each}"' for each in layout.names if each)
        line = f"line {max(layout.first, 1)}"
        raise file_error(path, f'{line}: no column "{name}"', f"the columns are {there}; name one of them", "no-column")
    if (count := layout.names.count(name)) > 1:
        problem = f'line {layout.first}: {count} columns are named "{name}"'
        raise file_error(path, problem, "rename all but one", "column-twice")
    return layout.names.index(name)


def _all_numbers(lines: list[str], layout: _Layout, positions: list[int]) -> NDArray[np.float64] | None:
    """Read in one go a table in which every line is whole and every field a number; else return None."""
    body = lines[layout.first :]
    if layout.delimiter is not None:
        counts = {line.count(layout.delimiter) for line in body}
        if len(counts) != 1 or counts.pop() > len(layout.names):
            return None
    try:
        values = np.loadtxt(body, delimiter=layout.delimiter, usecols=positions, comments=None, ndmin=2)
    except ValueError:
        return None
    return values if len(values) == len(body) and not np.isnan(values).any() else None


def _whole_rows(path: Path, lines: list[str], layout: _Layout, finished: bool, findings: list[Finding]) -> list[Row]:
    rows = list(_rows(lines, layout))
    width = len(layout.names)
    for line, fields in rows:
        if [field.strip() for field in fields] == layout.names:
            problem = f"line {line}: names the columns again: two logs in one file"
            raise file_error(path, problem, "cut it there into two files", "header-repeated")
        if any(field.strip() for field in fields[width:]):
            problem = f"line {line}: has {len(fields)} fields, where the first line has {width}"
            remedy = "mend the line (decimal commas need another separator, semicolons for instance)"
            raise file_error(path, problem, remedy, "row-length")
    if len(rows) > 1 and (_shorter(rows, width) or (not finished and _broken_off(rows[-1], layout))):
        line, _ = rows.pop()
        message = "the last line breaks off and was left out"
        findings.append(Finding("truncated", "repaired", f"{path}: line {line}", message, "nothing to do"))
    return rows


def _rows(lines: list[str], layout: _Layout) -> Iterator[Row]:
    if layout.delimiter is None:
        yield from ((i + 1, lines[i].split()) for i in range(layout.first, len(lines)) if lines[i].strip())
        return
    fields = csv.reader(lines[layout.first :], delimiter=layout.delimiter)
    yield from ((fields.line_num + layout.first, row) for row in fields if any(field.strip() for field in row))


def _shorter(rows: list[Row], width: int) -> bool:
    return len(rows[-1][1]) < min(width, len(rows[-2][1]))


def _broken_off(row: Row, layout: _Layout) -> bool:
    last = row[1][-1].strip()
    return last.lower() not in _MISSING and not _is_number(last, layout.delimiter)


def _numbers(path: Path, rows: list[Row], positions: dict[str, int], findings: list[Finding]) -> NDArray[np.float64]:
    texts = {
        name: [fields[at].strip() if at < len(fields) else "" for _, fields in rows] for name, at in positions.items()
    }
    if _decimal_commas(texts):
        message = "decimal commas were read as decimal points"
        findings.append(Finding("decimal-comma", "repaired", str(path), message, "write decimal points"))
        texts = {name: [text.replace(",", ".") for text in column] for name, column in texts.items()}
    columns = [
        [_number(path, line, name, text) for (line, _), text in zip(rows, column, strict=True)]
        for name, column in texts.items()
    ]
    return np.array(columns, dtype=np.float64).reshape(len(texts), len(rows)).T


def _decimal_commas(texts: dict[str, list[str]]) -> bool:
    """Tell whether commas can only be decimal ones: no points, and one at least that separates no thousands."""
    filled = [text for column in texts.values() for text in column if "," in text or "." in text]
    commas = [text for text in filled if _COMMA_NUMBER.fullmatch(text)]
    return bool(filled) and len(commas) == len(filled) and not all(_THOUSANDS.fullmatch(text) for text in commas)


def _number(path: Path, line: int, name: str, text: str) -> float:
    if text.lower() in _MISSING:
        return math.nan
    try:
        if "_" not in text:  # Python's digit separator is no number in a log
            return float(text)
    except ValueError:
        pass
    problem = f'line {line}: column "{name}" is "{text}", expected a number'
    raise InputError(f"{path}: {problem}; mend the value or remove the line", "not-a-number")
