"""Lines of a text table as fields: names, separator, quotation marks, and how many fields a line must have."""

import csv
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from archerfish.records.errors import file_error
from archerfish.records.text_file import read_lines

MISSING = {"", "nan", "na", "n/a", "null", "none"}
"""How loggers write a value that they did not have, in lower case."""

_MARKS = ("#", "%")
"""What begins the line of names in some files, and a comment."""

COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
"""A number with a decimal comma."""


class TextTable(NamedTuple):
    """Lines of a text table, and how they are cut into fields."""

    names: list[str]
    """Names of the columns, "" for one without; "1", "2", … where the first line names none."""
    delimiter: str | None
    """What separates fields; None for blanks."""
    first: int
    """Index of the first line of data."""
    lines: list[str]
    """All lines of the file up to the last one that holds a value."""
    finished: bool
    """Whether a line break ends the last of them."""
    zero_bytes: int
    """Zero bytes after the last line."""

    @property
    def fewest(self) -> int:
        """Fields that a whole line has at least: those up to the last named column."""
        return max((index + 1 for index, name in enumerate(self.names) if name), default=0)


class Row(NamedTuple):
    """A line of data."""

    line: int
    """Line of the file, counted from 1."""
    fields: list[str]
    """Its fields; empty for a line of separators alone."""


def read_table_lines(path: Path) -> TextTable:
    """Read a text table as lines, and find names and separator in the first one.

    Raises:
      InputError: if the file can't be read as text, or the first line has an open quotation mark, or both numbers and
        empty fields and nothing else: they can be names or a sample that lacks a value.
    """
    lines, finished, zeros = read_lines(path)
    first = next(index for index, line in enumerate(lines) if line.strip())
    line = lines[first].lstrip("#% ") if lines[first].lstrip().startswith(_MARKS) else lines[first]
    most = max(",;\t", key=line.count)
    delimiter = most if most in line else None
    fields = [field.strip() for field in _fields(path, first + 1, line, delimiter)]
    while len(lines) > first + 1 and not lines[-1].replace(delimiter or " ", " ").strip():
        lines.pop()  # blank lines, and the rows of separators that spreadsheets leave at the end
        finished = True
    filled = fields[: max((i + 1 for i, field in enumerate(fields) if field), default=0)]
    numbers = [is_number(field, delimiter) for field in filled]
    if (
        any(numbers)
        and "" in filled
        and all(number or not field for number, field in zip(numbers, filled, strict=True))
    ):
        problem = f"line {first + 1}: numbers and empty fields can be names of columns, or a sample that lacks a value"
        raise file_error(path, problem, "put a line above that names the columns", "unclear-names")
    if any(numbers) and all(number or field.lower() in MISSING for number, field in zip(numbers, filled, strict=True)):
        return TextTable([str(index + 1) for index in range(len(filled))], delimiter, first, lines, finished, zeros)
    return TextTable(fields, delimiter, first + 1, lines, finished, zeros)


def is_number(text: str, delimiter: str | None) -> bool:
    """Return whether a field holds a number; a comma may be a decimal one unless it separates the fields."""
    if delimiter != "," and COMMA_NUMBER.fullmatch(text):
        return True
    try:
        float(text)
    except ValueError:
        return False
    return True


def cut_fields(text: str, delimiter: str | None) -> list[str]:
    """Cut a line into its fields; what quotation marks enclose is one, and must end on its line.

    A quoted field may hold line breaks in other CSV files. In a log it would hide every sample between a stray
    quotation mark and the next one.

    Args:
      text: the line.
      delimiter: what separates fields; None for blanks.

    Raises:
      csv.Error: if a quotation mark is not closed, or something follows a quoted field.
    """
    if delimiter is None or '"' not in text:
        return text.split(delimiter)
    return next(csv.reader([text], delimiter=delimiter, strict=True))


def _fields(path: Path, line: int, text: str, delimiter: str | None) -> list[str]:
    try:
        return cut_fields(text, delimiter)
    except csv.Error as error:
        if len(text) > csv.field_size_limit() and str(error).startswith("field larger"):
            problem = f"line {line}: a quotation mark encloses more than {csv.field_size_limit()} characters"
            raise file_error(
                path, problem, "shorten the field, or export the table without it", "open-quote"
            ) from error
        problem = f"line {line}: a quotation mark is not closed on its line, or not at the end of its field ({error})"
        remedy = "close or remove it, and keep line breaks out of fields"
        raise file_error(path, problem, remedy, "open-quote") from error


def check_comments(path: Path, table: TextTable) -> None:
    """Refuse lines of data that a mark takes out: a sample that somebody removed is none.

    Raises:
      InputError: if a line of data begins with # or %.
    """
    for line, text in enumerate(table.lines[table.first :], start=table.first + 1):
        if ("#" in text or "%" in text) and text.lstrip().startswith(_MARKS):
            problem = f'line {line}: begins with "{text.lstrip()[0]}", as a comment or a sample that was taken out'
            raise file_error(path, problem, "remove the line, or the mark if it is a sample", "comment")


def whole_rows(path: Path, table: TextTable) -> Iterator[Row]:
    """Yield the lines of data as fields; blank lines are passed over.

    Raises:
      InputError: if a quotation mark is open, a line has fewer or more fields than the first one names, or one names
        the columns again.
    """
    fewest, most = table.fewest, len(table.names)
    for line, text in enumerate(table.lines[table.first :], start=table.first + 1):
        if not text.strip():
            continue
        fields = _fields(path, line, text, table.delimiter)
        if not any(field.strip() for field in fields):
            yield Row(line, [])
            continue
        if [field.strip() for field in fields] == table.names:
            problem = f"line {line}: names the columns again: two logs in one file"
            raise file_error(path, problem, "cut it there into two files", "header-repeated")
        if not fewest <= len(fields) <= most:
            _check_count(path, line, fields, fewest, most)
        yield Row(line, fields)


def _check_count(path: Path, line: int, fields: list[str], fewest: int, most: int) -> None:
    more = any(field.strip() for field in fields[most:])
    if not more and len(fields) >= fewest:
        return  # separators without anything after them
    remedy = (
        "mend the line (decimal commas need another separator, semicolons for instance)"
        if more
        else "complete the line, with nothing between the separators of a missing value, or remove it"
    )
    count = f"{len(fields)} field{'s' if len(fields) != 1 else ''}"
    problem = f"line {line}: has {count}, where the first line has {most}"
    raise file_error(path, problem, remedy, "row-length")
