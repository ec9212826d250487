"""Paired differences between the controllers of results, cell by cell."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from archerfish.errors import InputError
from archerfish.evaluation.hit_rate import paired_difference
from archerfish.reports.report import Report, Reported
from archerfish.reports.table import Estimate

if TYPE_CHECKING:
    from archerfish.evaluation.results import Cell


class CellDifference(NamedTuple):
    """How far a hit rate is above another in the same engagements with the same dispersion draws."""

    world: str  # these four are the cells' place
    command_limit: str  # `box`, `gate` or `los-2deg`
    length_s: float  # of an engagement [s]
    task: str  # name, where its conditions are not the usual ones
    motion: str  # of the targets
    range_m: tuple[float, float]  # smallest and largest distance of the targets [m]
    controller: str  # the one
    seed: int | None  # of its training
    against: str  # the other
    against_seed: int | None  # of its training
    difference: float  # rate less the other's, −1 to 1
    low: float  # lower end of its 95 % interval, paired by engagement
    high: float  # upper end

    @property
    def estimate(self) -> Estimate:
        """The difference with its interval [points]."""
        return Estimate(100 * self.difference, 100 * self.low, 100 * self.high, "points")

    @property
    def place(self) -> tuple[str, str, float, str]:
        """World, command limit, length and task, as of a cell."""
        return self[:4]


class Comparison(Reported, tuple[CellDifference, ...]):
    """The differences of two controllers; printed with their mean and as tables."""

    @property
    def report(self) -> Report:
        """What is shown of it."""
        from archerfish.evaluation.tables import comparison_report

        return comparison_report(self)

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return a row per cell, and pair of trainings, for a data frame: its fields, `range_m` in two."""
        rows = [pair._asdict() for pair in self]
        for row in rows:
            row["range_low_m"], row["range_high_m"] = row.pop("range_m")
        return rows


def compare(cells: Sequence["Cell"], a: str, b: str) -> Comparison:
    """Return the differences of controller `a` to controller `b`; of several trainings each to each.

    Raises:
      InputError: if one is not there, or they have no engagements in common.
    """
    by_name = {name: [cell for cell in cells if cell.controller == name] for name in (a, b)}
    for name, own in by_name.items():
        if not own:
            there = ", ".join(dict.fromkeys(cell.controller for cell in cells)) or "none"
            raise InputError(f"compare: there is no controller {name!r}, but {there}; name two of these")
    if not (found := _differences(by_name[a], by_name[b])):
        raise InputError(f"compare: {a} and {b} have no engagements in common; evaluate both in one call")
    return Comparison(found)


def default_comparisons(cells: Sequence["Cell"]) -> list[CellDifference]:
    """Return the differences that are shown unasked.

    Each policy and user's controller is compared with each classical one, and each controller with the first, but not
    perfect aim.
    """
    kinds = {cell.controller: cell.kind for cell in cells if cell.kind != "perfect"}
    by_name = {name: [cell for cell in cells if cell.controller == name] for name in kinds}
    pairs = [(a, b) for a in kinds for b in kinds if kinds[a] != "classical" and kinds[b] == "classical"]
    pairs += [(a, b) for b in list(kinds)[:1] for a in kinds if a != b and not {(a, b), (b, a)} & {*pairs}]
    return [pair for a, b in pairs for pair in _differences(by_name[a], by_name[b])]


def _differences(cells: Iterable["Cell"], others: Iterable["Cell"]) -> list[CellDifference]:
    """Return the differences of cells to those of others that have the same engagements."""
    by_engagements: dict[Any, list[Cell]] = {}
    for other in others:
        by_engagements.setdefault(other.shot_at, []).append(other)
    found = []
    for cell in cells:
        for other in by_engagements.get(cell.shot_at, ()):
            names = cell.controller, cell.seed, other.controller, other.seed
            difference = paired_difference(cell.hits_by_engagement, other.hits_by_engagement, cell.decisions_each)
            found.append(CellDifference(*cell.place, cell.motion, cell.range_m, *names, *difference))
    return found
