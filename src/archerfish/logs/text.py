"""Logs as text: columns separated by commas, semicolons, tabs or blanks, named in the first line or numbered.

Every line is read whole or named in an error, but the last where no line break ends it: it may break off inside a
number, so it is left out and counted.
"""

import csv
import json
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import date
from pathlib import Path

import numpy as np

from archerfish.errors import InputError, meant
from archerfish.logs.recording import Finding, LogTable, Values, listed, log_fault, open_log
from archerfish.logs.stamps import SECONDS, time_unit

_MISSING = {"", "nan", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind", "na", "n/a", "<na>", "#n/a", "#num!"}
_MISSING |= {"null", "none", "nil", "undefined", "-", "--", "#div/0!"}
"""How loggers write a value that is missing, in lower case."""
_BLANK = " \t\f\v,;"
"""What a line consists of that has no value: spreadsheets leave such lines at the end."""
_SEPARATOR_LINE = re.compile(r' *"?sep=(.)"? *', re.IGNORECASE)
"""First line of a spreadsheet's CSV file, which states the separator."""
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.IGNORECASE)
_CLOCK = re.compile(
    r"(?:(?:(\d{4})[-/.](\d\d?)[-/.](\d\d?)|[\w/.,-]+(?: [\w/.,-]+)*)[T ] *)?(?:(\d\d?):)?(\d\d?):(\d\d)(?:[.,:](\d+))?"
    r" *(?:([AP])M)? *(?:Z|[A-Z]{3,4})? *(?:([+-]\d\d?)(?::?(\d\d))?)?",
    re.IGNORECASE,
)
"""Time of day, also after a date and before a zone; without hours in what spreadsheets write."""
_COMPACT = re.compile(r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)", re.IGNORECASE)
"""Date and time of ISO 8601 without marks between them."""
_MARKS = re.compile(r"[\s\"#%,;]+")
"""What is beside names, and between them."""
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_HEAD = 2**16  # bytes that have the names and the first sample of a usual table
_UNPACKED = (".gz", ".bz2", ".xz")  # endings by which NumPy takes a file for a compressed one
Choice = Callable[[list[str]], list[str]]
Advice = Callable[[Sequence[str]], str]
_EPOCH = date(1970, 1, 1).toordinal()
_SHOWN = 40  # characters of a bad field


def read_text(
    path: Path, choose: Choice, *, advice: Advice | None = None, whole: bool = False, numbers: bool = False
) -> LogTable:
    """Read columns of numbers from a text table; a missing value becomes NaN, in a line of separators alone all.

    Args:
      path: of the file, in UTF-8, or in UTF-16 with its byte order mark.
      choose: which of the columns are read, by name; where the first line has numbers they are "1", "2", ….
      advice: what to do where a column is not there, from the names of those that are.
      whole: whether a last line is read although no line break ends it.
      numbers: whether columns with something else than numbers are left out.

    Raises:
      InputError: if it is no text, a column is missing or there twice, or a line has other fields than the first one,
        begins with a mark of comments, or has a field that is no number.
    """
    if (table := _read_at_once(path, choose)) is not None:
        return table
    lines, findings = _lines(path, whole)
    names, separator, first = _header(path, lines)
    header = f"{path}: line {max(first, 1)}"
    positions = {name: _position(header, names, name, advice) for name in choose(names)}
    body = {number: line for number, line in enumerate(lines[first:], first + 1) if line.strip()}
    body = {number: line for number, line in body.items() if not line.startswith(("sep=", '"sep='))}
    again, found = _names_again(path, names, body) if not names[0].isdecimal() else ([], ())
    findings += found
    rows = {number: _row(path, number, line, separator, len(names)) for number, line in body.items()}
    texts = {name: [row[at].strip() for row in rows.values()] for name, at in positions.items()}
    if _have_decimal_commas(texts):
        texts = {name: [text.replace(",", ".") for text in column] for name, column in texts.items()}
        message = "decimal commas were read as decimal points"
        findings += (Finding("decimal-comma", "repaired", str(path), message, "write decimal points"),)
    columns, places = dict[str, Values](), list(rows)
    for name, column in texts.items():
        with suppress(*[InputError] * numbers):
            columns[name] = numbers_of(path, "line", places, name, column)
    starts = tuple(np.searchsorted(places, again).tolist())
    return LogTable(columns, places, "line", str(path), findings, starts)


def column_names(path: Path) -> tuple[str, ...]:
    """Return the names of a table's columns: "1", "2", … where its first line has numbers.

    Raises:
      InputError: if it is no text, or empty.
    """
    return tuple(_header(path, _lines(path, whole=True)[0])[0])


def _read_at_once(path: Path, choose: Choice) -> LogTable | None:
    """Read a table that has numbers alone below its names; return None of any other: its lines are read one by one."""
    with suppress(ValueError, IndexError, OSError), open_log(path) as file:
        head = file.read(_HEAD)
        lines = head[: head.rfind(b"\n") + 1].decode("utf-8-sig").split("\n")
        names, separator, first = _header(path, lines)
        chosen = choose(names)
        if lines[first].strip() and path.suffix not in _UNPACKED and all(names.count(name) == 1 for name in chosen):
            # NumPy takes a third longer to read an open file.
            values = np.loadtxt(path, float, None, separator, skiprows=first, ndmin=2, encoding="utf-8")
            end = head.count(b"\n") + file.read().count(b"\n")
            if values.shape == (end - first, len(names)):  # no line is blank, or without its end
                columns = dict(zip(chosen, values.T[[*map(names.index, chosen)]], strict=True))
                return LogTable(columns, range(first + 1, end + 1), "line", str(path))
    return None


def _lines(path: Path, whole: bool) -> tuple[list[str], tuple[Finding, ...]]:
    """Return the lines up to the last whole one that has a value, and whether something was cut off after it.

    A line ends with a line feed, a carriage return or both; a form feed or a Unicode separator may stand in a field.
    """
    with open_log(path) as file:
        content = file.read()
    encoding = json.detect_encoding(content)
    decoded = content.decode(encoding, "replace").removeprefix("\ufeff")
    text = decoded.rstrip("\0\x1a")  # what a loss of power leaves, and the end mark of DOS
    zeros = "\0" in decoded[len(text) :]
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if damaged := re.search("[\0\ufffd]", text):
        line, remedy = text.count("\n", 0, damaged.start()) + 1, "save the log as UTF-8, or remove the damaged lines"
        raise log_fault(path, f"line {line}: is no {encoding.removesuffix('-sig').upper()} text", remedy, "encoding")
    text += "\n" if whole and not zeros else ""
    *lines, last = text.split("\n")
    torn, place = last.strip(_BLANK) != "", f"{path}: line {len(lines) + 1}"
    while lines and not lines[-1].strip(_BLANK):
        lines.pop()
    if not lines:
        raise log_fault(path, "is empty, or ends within its first line", "pass a log that names its columns", "empty")
    if not (torn or zeros):
        return lines, ()
    message = "no line break ends the last line, which was left out" if torn else "zero bytes follow the last line"
    remedy = "stop the recorder before its log is copied; end a last line that is whole"
    return lines, (Finding("truncated", "repaired", place, f"{message}: values are lost", remedy, int(torn)),)


def _names_again(path: Path, names: Sequence[str], body: dict[int, str]) -> tuple[list[int], tuple[Finding, ...]]:
    """Take out the lines that repeat the names, as a logger writes them at each start, also behind a torn line.

    Args:
      path: of the file.
      names: of the columns.
      body: lines by their number, from which they are taken out.

    Returns:
      Their numbers, and a finding that counts them.

    Raises:
      InputError: if a line has other names, after which columns may be other ones.
    """
    first, heading = next(filter(None, names), "\n").lower(), _MARKS.sub("", "".join(names)).lower()
    again, torn = list[int](), 0
    for number in [number for number, line in body.items() if first in line.lower()]:
        line = _MARKS.sub("", body[number]).lower()
        if line.endswith(heading):
            again.append(number)
            torn += line != heading
            del body[number]
        elif _MARKS.split(body[number].lower().lstrip('"#% '))[0] == first:
            problem = f'line {number}: has "{body[number][:_SHOWN]}", expected the names of the first line, or numbers'
            raise log_fault(path, problem, "cut the log there into two", "not-a-number")
    if not again:
        return [], ()
    message = f"lines that repeat the names left out: {len(again)}, {torn} of them behind a sample that breaks off"
    place, remedy = f"{path}: line {again[0]}", "write each recording into a file of its own"
    return again, (Finding("names-again", "repaired", place, message, remedy, torn),)


def _in_seconds(text: str, unit: float) -> str:
    """Return a time of day, after a date or not, as a number in a unit [s]; other texts as they are.

    A date that does not begin with its year is ignored: it changes at midnight alone.
    """
    if not (found := _CLOCK.fullmatch(_COMPACT.sub(r"\1-\2-\3T\4:\5:\6", text.strip("[]")))):
        return text
    year, month, day, hours, minutes, seconds, fraction, half, zone, more = found.groups()
    hour = int(hours or 0) % (12 if half else 24) + (12 if half in ("P", "p") else 0)
    zone_min = 60 * int(zone) + int(zone[0] + (more or "0")) if zone else 0
    with suppress(ValueError):  # of a date that there is not
        days = date(int(year), int(month), int(day)).toordinal() - _EPOCH if year else 0
        whole = 60 * (60 * (24 * days + hour) + int(minutes) - zone_min) + int(seconds)
        return repr((whole + float(f"0.{fraction or 0}")) / unit)
    return text


def _header(path: Path, lines: list[str]) -> tuple[list[str], str | None, int]:
    """Return the columns' names ("1", "2", … above numbers), their separator (None: blanks), index of the first row."""
    full = (index for index, line in enumerate(lines) if line.strip())
    first = next(full, 0)
    stated = _SEPARATOR_LINE.fullmatch(lines[first])
    if stated:
        first = next(full, first)
    line = lines[first].lstrip("#% ")
    most = max(",;\t", key=line.count)
    separator = stated[1] if stated else most if most in line else None
    line = line.rstrip(f" \r{separator or ''}")  # of separators after the last name
    names = [field.strip().strip('"') for field in _fields(path, first + 1, line, separator)]
    values = [name for name in names if name.lower() not in _MISSING]
    if values and all(map(_NUMBER.fullmatch, values)):
        return [str(index + 1) for index in range(len(names))], separator, first
    return names, separator, first + 1


def _fields(path: Path, number: int, line: str, separator: str | None) -> list[str]:
    """Cut a line; a quoted field that went on in the next one would hide each sample up to the next quotation mark."""
    if separator is None or '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, strict=True))
    except csv.Error as error:
        problem = f"line {number}: can't be cut into fields ({error})"
        remedy = "close or remove the quotation mark, and keep line breaks out of fields"
        raise log_fault(path, problem, remedy, "row-length") from error


def _position(place: str, names: list[str], name: str, advice: Advice | None) -> int:
    if (count := names.count(name)) == 1:
        return names.index(name)
    if count:
        raise log_fault(place, f'{count} columns are named "{name}"', "rename all but one", "column-twice")
    following = advice(names) if advice else meant(name, names, "name one of them")
    remedy = f"the columns are {listed(names)}; {following}"
    raise log_fault(place, f'there is no column "{name}"', remedy, "no-column")


def _row(path: Path, number: int, line: str, separator: str | None, count: int) -> list[str]:
    fields = _fields(path, number, line, separator)
    if line.lstrip().startswith(("#", "%")):
        problem, remedy = "begins as a comment, or a sample that was taken out", "remove the line, or the mark"
        raise log_fault(path, f"line {number}: {problem}", remedy, "comment")
    if not line.strip(_BLANK):
        return [""] * count
    if len(fields) < count or any(field.strip() for field in fields[count:]):
        problem = f"line {number}: {len(fields)} fields, expected the {count} of the first line"
        remedy = "correct or remove it (a missing value leaves its separators; decimal commas need semicolons)"
        raise log_fault(path, problem, remedy, "row-length")
    return fields


def _have_decimal_commas(texts: dict[str, list[str]]) -> bool:
    """Return whether commas can be nothing else: there are no points, and not all separate thousands."""
    parted = [text for column in texts.values() for text in column if ("," in text or "." in text) and ":" not in text]
    numbers = all("." not in text and _NUMBER.fullmatch(text) for text in parted)
    return numbers and not all(map(_THOUSANDS.fullmatch, parted))


def numbers_of(path: str | Path, kind: str, places: Sequence[int], name: str, texts: Sequence[str]) -> Values:
    """Return a column of N texts as numbers, NaN where a value is missing.

    Args:
      path: of the file.
      kind: of places, "line" or "row".
      places: of the texts in the file, shape (N,).
      name: of the column.
      texts: N of them.

    Raises:
      InputError: if one is no number.
    """
    with suppress(ValueError):  # of those that are no plain numbers, which are read one by one
        return np.array([float(text.replace("_", "x")) for text in texts])
    values, scale = np.full(len(texts), np.nan), SECONDS[time_unit(name)]
    for index, text in enumerate(texts):
        try:
            if text.lower() not in _MISSING:
                number = _in_seconds(text, scale)
                values[index] = float(number.replace("_", "x"))  # Python's separator of digits is no number
        except ValueError as error:
            problem = f'{kind} {places[index]}: column "{name}" is "{text[:_SHOWN]}", expected a number'
            remedy = "write 2026-03-14T10:15:30.123Z, or seconds" if ":" in text else "correct it or remove the line"
            raise log_fault(path, problem, remedy, "not-a-number") from error
    return values
