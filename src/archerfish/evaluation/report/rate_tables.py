"""Tables of hit rates for the report: the paper's columns, ours, and differences, a row per range."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from archerfish.evaluation.comparison import CellKey
from archerfish.evaluation.report.wording import controller_words
from archerfish.evaluation.results import HIT_RATE_TABLES, Cell
from archerfish.paper.tables import hit_rate_table


class Column(NamedTuple):
    """One column of a table of hit rates."""

    title: str
    """Heading."""
    kind: str
    """"rate" (Cell), "bound" (Cell), "difference" (Comparison), "share" (0 to 1) or "printed" (percent)."""
    values: Mapping[CellKey, Any]
    """Table and range → value; where there is none, the table shows a dash."""
    ours: bool = False
    """Whether it is the column that the table is about."""

    @property
    def printed(self) -> bool:
        """Whether the paper printed these figures."""
        return self.kind == "printed"


class Row(NamedTuple):
    """One range."""

    range_m: tuple[float, float]
    """Smallest and largest distance [m]."""
    values: Sequence[tuple[Column, Any]]
    """One entry per column."""


class Group(NamedTuple):
    """Rows under one heading."""

    title: str
    """Heading."""
    rows: Sequence[Any]
    """Of `Row`, or of `ControllerRow` where every controller is listed."""


class RateTable(NamedTuple):
    """A table of hit rates."""

    caption: str
    """Above the table."""
    columns: Sequence[Column]
    """After the range."""
    rows: Sequence[Group]
    """One group per table of the paper."""


def rate_table(columns: Iterable[Column], caption: str) -> RateTable:
    """Lay columns side by side, a row per range; columns without any value are left out."""
    kept = [column for column in columns if any(value is not None for value in column.values.values())]
    keys = sorted({key for column in kept for key in column.values}, key=cell_order)
    groups = [
        Group(
            title_of(table, [each for column in kept for key, each in column.values.items() if key[0] == table]),
            [Row(key[1], [(each, each.values.get(key)) for each in kept]) for key in keys if key[0] == table],
        )
        for table in HIT_RATE_TABLES
        if any(key[0] == table for key in keys)
    ]
    return RateTable(caption, kept, groups)


def cell_order(key: CellKey) -> tuple[int, tuple[float, float]]:
    """Sort cells as the paper does."""
    return HIT_RATE_TABLES.index(key[0]), key[1]


def target_of(table: str) -> str:
    """Return the kind of target of one of the paper's tables."""
    return hit_rate_table(table).target


def title_of(table: str, found: Iterable[Any]) -> str:
    """Return the heading of what was found for one of the paper's tables.

    It names a user's own motion, and fired shots where these count.

    Args:
      table: "II" to "V".
      found: cells or differences of that table; what has no motion is passed over.
    """
    found = list(found)
    motion = next((each.motion for each in found if getattr(each, "motion", None)), None)
    targets = (
        f"{motion} targets, at the ranges of Table {table}" if motion else f"Table {table}, {target_of(table)} targets"
    )
    return targets + (": hits per fired shot" if fired_shots_count(found) else "")


def fired_shots_count(found: Iterable[Any]) -> bool:
    """Return whether fired shots alone count for any of some cells or differences."""
    return any(getattr(each, "counts", "") == "shots" for each in found)


def rate_column(cells: Mapping[CellKey, Cell], controller: str, *, ours: bool = False) -> Column:
    """Make the column of a controller's hit rates."""
    return Column(controller_words(controller).name, "rate", cells, ours)


def bound_columns(oracle: Mapping[CellKey, Cell], others: Mapping[CellKey, Cell]) -> list[Column]:
    """Make the columns of the bounds: that of the oracle where it differs from the others', and theirs.

    Args:
      oracle: cells of the controller that is given the path.
      others: cells of any controller that is not.
    """
    known, unknown = ({key: cell for key, cell in each.items() if cell.bound} for each in (oracle, others))
    apart = any(key not in unknown or cell.bound != unknown[key].bound for key, cell in known.items())
    columns = [Column("bound, path known", "bound", known)] if apart else []
    return [*columns, Column("bound", "bound", unknown)]


def printed_column(cells: Mapping[CellKey, Cell], title: str) -> Column:
    """Make the column of the paper's figures that stand beside a controller's."""
    return Column(title, "printed", {key: cell.paper for key, cell in cells.items()})
