"""Tables: rows of texts, numbers and estimates, which terminal, page and JSON show from the same values."""

import io
import math
import shutil
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

from archerfish.errors import one_line

MISSING = "–"
"""Shown where there is no figure."""

WIDTH = 110
"""Widest text [columns]."""


class Estimate(NamedTuple):
    """An estimate with its 95 % interval; without one, the ends are NaN."""

    value: float  # in the unit
    low: float  # lower end
    high: float  # upper end
    unit: str = ""  # "%", "points" (signed) or any other


Entry: TypeAlias = str | float | int | Estimate | None


class Table(NamedTuple):
    """A table; the first entry of a row names it."""

    title: str  # above it
    columns: tuple[str, ...]  # headings
    rows: tuple[tuple[Entry, ...], ...]  # an entry per column
    note: str = ""  # below it

    def text_columns(self) -> list[bool]:
        """Return of each column whether it has texts alone, as the first one: these are aligned to the left."""
        return [all(isinstance(row[place], str) for row in self.rows) for place in range(len(self.columns))]


def entry_texts(entry: Entry) -> tuple[str, str]:
    """Return an entry and its interval as text; the interval is empty where there is none.

    Estimates in "%" have one decimal, in "points" a sign, too; their units are not repeated. Others have the decimals
    that their interval gives reason for.
    """
    if isinstance(entry, str):
        return one_line(entry), ""
    if not isinstance(entry, Estimate):
        return number(entry), ""
    value, low, high, unit = entry
    if not math.isfinite(value):
        return MISSING, ""
    show, joint = _formatter(entry)
    interval = f"{show(low)}{joint}{show(high)}" if math.isfinite(low) and math.isfinite(high) else ""
    return show(value) + (f" {unit}" if unit not in ("", "%", "points") else ""), interval


def _formatter(estimate: Estimate) -> tuple[Callable[[float], str], str]:
    """Return how the value and the ends of an estimate are written, and what joins the ends."""
    half_width = (estimate.high - estimate.low) / 2
    if estimate.unit in ("%", "points"):
        digits = 1
    elif math.isfinite(half_width) and half_width > 0:
        digits = min(12, max(0, 1 - math.floor(math.log10(half_width))))
    else:
        return number, " to "
    signed = estimate.unit == "points"

    def show(value: float) -> str:
        text = f"{round(value, digits) + 0.0:{'+' if signed else ''}.{digits}f}".replace("-", "−")
        return text.replace("100.0", "100") if estimate.unit == "%" else text

    return show, {"%": "–", "points": "…"}.get(estimate.unit, " to ")


def number(value: float | None, digits: int = 4) -> str:
    """Write a number to so many significant digits, without an exponent unless it is very small; counts as they are."""
    if value is None or not math.isfinite(value):
        return MISSING
    if value == 0 or isinstance(value, int):
        return f"{value:{',' if abs(value) >= 10_000 else ''}.0f}".replace(",", "\u2009").replace("-", "−")
    exponent = math.floor(math.log10(abs(value)))
    text = f"{value:.{digits}g}" if exponent < -4 else f"{value:.{max(0, digits - 1 - exponent)}f}"
    return text.replace("-", "−")


def tables_text(tables: Sequence[Table], width: int | None = None) -> str:
    """Return tables as text; an interval is below its figure where beside it there is no room.

    Columns that even so have no room follow below, each time after the first one.

    Args:
      tables: in their order.
      width: columns; that of the terminal, at most `WIDTH`, if not given.
    """
    width = width or min(WIDTH, max(60, shutil.get_terminal_size((WIDTH, 24)).columns))
    return "\n\n".join(_table_text(table, width) for table in tables)


def _table_text(table: Table, width: int) -> str:
    from rich.console import Console
    from rich.table import Table as RichTable

    headings, is_text = [one_line(name) for name in table.columns], table.text_columns()
    rows = [[entry_texts(entry) for entry in row] for row in table.rows]
    for form, gap in (("{} ({})", 2), ("{} ({})", 1), ("{}\n{}", 2), ("{}\n{}", 1)):
        texts = [[form.format(*pair) if pair[1] else pair[0] for pair in row] for row in rows]
        columns = zip(headings, *texts, strict=True)
        widest = [max(len(line) for text in column for line in text.split("\n")) for column in columns]
        if sum(widest) + gap * (len(widest) - 1) <= width:
            break
    stream = io.StringIO()
    # In a notebook rich would display what it prints, instead of writing it to the stream.
    plain: Any = {"markup": False, "emoji": False, "highlight": False, "color_system": None, "force_jupyter": False}
    console = Console(file=stream, width=width, **plain)
    console.print(one_line(table.title)) if table.title else None
    for number, places in enumerate(_parts([column + gap for column in widest], width + gap)):
        drawn = RichTable(box=None, pad_edge=False, padding=(0, gap, 0, 0))
        for place in places:
            drawn.add_column(headings[place], justify="left" if is_text[place] else "right", overflow="fold")
        for row in texts:
            drawn.add_row(*(row[place] for place in places))
        console.print("\n" if number else "", drawn, sep="", end="")
    console.print(one_line(table.note)) if table.note else None
    return "\n".join(line.rstrip() for line in stream.getvalue().rstrip().split("\n"))


def _parts(widths: Sequence[int], room: int) -> list[list[int]]:
    """Divide columns among parts of a table that have room: the first one in all, which may fold to half of it."""
    first = min(widths[0], max(room // 2, room - sum(widths[1:])))
    parts, used = [[0]], first
    for place, column in enumerate(widths[1:], 1):
        if used + column > room and len(parts[-1]) > 1:
            parts.append([0])
            used = first
        parts[-1].append(place)
        used += column
    return parts


def table_dict(table: Table) -> dict[str, Any]:
    """Return a table for JSON: estimates as objects, numbers that are not finite as null."""
    return {**table._asdict(), "rows": [[_plain(entry) for entry in row] for row in table.rows]}


def _plain(entry: Entry) -> Any:
    if isinstance(entry, Estimate):
        return {name: _plain(value) for name, value in entry._asdict().items()}
    return None if isinstance(entry, float) and not math.isfinite(entry) else entry
