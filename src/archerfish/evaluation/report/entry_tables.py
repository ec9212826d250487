"""Tables of the report whose entries are texts: a figure, and something smaller below it."""

from collections.abc import Sequence
from typing import NamedTuple

from archerfish.evaluation.pooling import Estimate
from archerfish.evaluation.results import Cell
from archerfish.figures.page import MISSING, count, number, percent, points


class Entry(NamedTuple):
    """What stands in one place of a table."""

    text: str
    """The figure."""
    small: str = ""
    """Below it, smaller: its interval."""
    style: str = ""
    """`ours`, `paper`, `text` or nothing."""


class Heading(NamedTuple):
    """Of a column."""

    text: str
    """Its words."""
    style: str = ""
    """As in an entry."""


class EntryRow(NamedTuple):
    """One row."""

    title: str
    """At its left."""
    entries: Sequence[Entry]
    """One per column."""


class EntryGroup(NamedTuple):
    """Rows under one heading."""

    title: str
    """Heading; nothing for rows without one."""
    rows: Sequence[EntryRow]
    """At least one."""


class EntryTable(NamedTuple):
    """A table of texts."""

    caption: str
    """Above it."""
    corner: str
    """Above the titles of the rows."""
    columns: Sequence[Heading]
    """Headings of the columns."""
    groups: Sequence[EntryGroup]
    """The rows."""
    spans: Sequence[tuple[str, int]] = ()
    """Headings above several columns each, from the left; nothing for none."""


NOTHING = Entry(MISSING)
"""Where there is no figure."""


def rate_entry(found: Cell | Estimate | None, style: str = "") -> Entry:
    """Write a hit rate in percent with its interval."""
    if found is None:
        return NOTHING._replace(style=style)
    value = found.value if isinstance(found, Estimate) else found.rate
    return Entry(percent(value), f"{percent(found.low)}–{percent(found.high)}", style)


def difference_entry(found: Estimate | None, style: str = "") -> Entry:
    """Write a difference of rates in points with its interval."""
    if found is None:
        return NOTHING._replace(style=style)
    return Entry(points(found.value), f"{points(found.low)} to {points(found.high)}", style)


def fired_entry(cells: Sequence[Cell]) -> Entry:
    """Write hits, fired and withheld shots of several cells, and the hits per second of their engagements."""
    if not cells:
        return NOTHING
    hits, shots, withheld = (sum(getattr(cell, name) for cell in cells) for name in ("hits", "shots", "withheld"))
    engagements = sum(cell.engagements for cell in cells)
    pace = sum((cell.hits_per_s or 0.0) * cell.engagements for cell in cells) / engagements
    return Entry(f"{count(hits)} of {count(shots)}", f"{count(withheld)} withheld, {number(pace)} hits/s")
