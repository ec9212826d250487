"""What an evaluation found: hit rates by cell, paired differences, and what they were measured with."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import msgspec

from archerfish2 import storage
from archerfish2.controllers.registry import Tuning
from archerfish2.errors import InputError
from archerfish2.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from archerfish2.reports.report import Report

SCHEMA = "archerfish.results/3"

Kind = Literal["policy", "classical", "user", "perfect"]

Value = TypeVar("Value")


class Label(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, eq=False):
    """Which controller in which engagements."""

    world: str
    """Name of the robot whose simulator it is, or of the virtual robot or other world."""
    motion: str
    """Of the targets, by name."""
    range_m: tuple[float, float]
    """Smallest and largest distance of the targets [m]."""
    length_s: float
    """Of an engagement [s]."""
    command_limit: str
    """`box`, `gate` or `los-2deg`."""
    controller: str
    """Its name; contenders of one name differ in their seed."""
    seed: int | None
    """That the policy was trained with, None for what is not trained."""

    def __post_init__(self) -> None:
        low, high = self.range_m
        _require(0 <= low <= high < math.inf, "range_m", self.range_m, "two distances, the smaller one first")
        _require(0 < self.length_s < math.inf, "length_s", self.length_s, "a time > 0")

    @property
    def place(self) -> tuple[str, str, float]:
        """World, command limit and length: what tables and panels are made for."""
        return self.world, self.command_limit, self.length_s

    @property
    def key(self) -> tuple[Any, ...]:
        """All of the label."""
        return *self.place, self.motion, self.range_m, self.controller, self.seed


class Cell(Label, kw_only=True):
    """One hit rate: hits of all decisions, shots and withheld ones."""

    table: Literal["II", "III", "IV", "V"] | None = None
    """The paper's table that it belongs to."""
    kind: Kind
    hits: int
    shots: int
    """Decisions with fire."""
    withheld: int
    """Decisions without fire, which count as misses."""
    engagements: int
    low: float
    """Lower end of the rate's 95 % interval, 0 to 1."""
    high: float
    """Upper end, 0 to 1."""
    paper: float | None = None
    """The paper's figure for such a controller [%]."""
    bound: float | None = None
    """Proven bound of the mean hit rate, 0 to 1; None where none is published."""
    bound_error: float | None = None
    """Its standard error, 0 to 1."""
    yaw_rad_s2: float | None = None
    """Largest acceleration of the yaw axis, of command or motion, mean over a decision period [rad/s²]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        counts = f"{self.hits} of {self.shots} shots, {self.withheld} withheld, {self.engagements} engagements"
        whole = 0 <= self.hits <= self.shots and self.withheld >= 0 and 0 < self.engagements <= self.decisions
        _require(whole, "hits", counts, "0 ≤ hits ≤ shots, 0 ≤ withheld, 0 < engagements ≤ decisions")
        interval = f"{self.low} to {self.high}"
        _require(0 <= self.low <= self.rate <= self.high <= 1, "interval", interval, f"one around {self.rate} in 0 to 1")
        _require(self.paper is None or 0 <= self.paper <= 100, "paper", self.paper, "0 to 100")
        both = (self.bound is None) == (self.bound_error is None)
        _require(both and 0 <= (self.bound or 0) <= 1, "bound", self.bound, "0 to 1, with its error")
        _require(0 <= (self.bound_error or 0) <= 1, "bound_error", self.bound_error, "0 to 1")
        _require(0 <= (self.yaw_rad_s2 or 0) < math.inf, "yaw_rad_s2", self.yaw_rad_s2, "a number ≥ 0")

    @property
    def decisions(self) -> int:
        """What the rate is counted over: shots and withheld ones."""
        return self.shots + self.withheld

    @property
    def rate(self) -> float:
        """Hits per decision, 0 to 1."""
        return self.hits / self.decisions


class Comparison(Label, kw_only=True):
    """How far a hit rate is above another in the same engagements with the same draws, paired by engagement."""

    against: str
    """Name of the other controller; WORLD/NAME where it is in another world."""
    difference: float
    """Rate less the other's, −1 to 1."""
    low: float
    """Lower end of its 95 % interval."""
    high: float
    """Upper end."""

    def __post_init__(self) -> None:
        super().__post_init__()
        interval, expected = f"{self.low} to {self.high}", f"one around {self.difference} in −1 to 1"
        _require(-1 <= self.low <= self.difference <= self.high <= 1, "interval", interval, expected)


class Comparisons(tuple[Comparison, ...]):
    """The comparisons of two controllers, cell by cell; printed as tables with the means."""

    __slots__ = ()

    def __repr__(self) -> str:
        from archerfish2.evaluation.tables import comparisons_text

        return comparisons_text(self)


class Results(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, eq=False, tag_field="schema", tag=SCHEMA
):
    """All that an evaluation found; printed as tables."""

    seed: int
    """Of engagements and dispersion."""
    commit: str
    versions: dict[str, str]
    tasks: tuple[Task, ...]
    robots: dict[str, dict[str, str]]
    """World → facts of its robot, such as the digest of its records."""
    tuning: dict[str, dict[str, Tuning]]
    """"world/limit" → controller → its settings."""
    cells: tuple[Cell, ...]
    comparisons: tuple[Comparison, ...]
    """The pairs of `pairs_to_compare`."""
    durations: dict[str, float]
    """Stage → seconds."""

    def __post_init__(self) -> None:
        keys = {each.key for each in self.cells}
        pairs = {(*each.key, each.against) for each in self.comparisons}
        for name, found, unique in (("cells", self.cells, keys), ("comparisons", self.comparisons, pairs)):
            _require(len(found) == len(unique), name, f"{len(found)} for {len(unique)} labels", "each label once")
        alone = [each.controller for each in self.comparisons if each.key not in keys]
        _require(not alone, "comparisons", f"with {alone[:1]} that has no such cell", "controllers of cells")

    @classmethod
    def load(cls, path: str | Path) -> "Results":
        """Read results.json.

        Args:
          path: the file or its folder.

        Raises:
          InputError: if it can't be read, or a field is missing, unknown, of another type or out of range.
        """
        return storage.read_struct(_file(path), cls, SCHEMA, "evaluate again to write a new one")

    def save(self, path: str | Path) -> None:
        """Write results.json; `path` is the file or its folder.

        Raises:
          InputError: if it can't be written.
        """
        storage.write_json(_file(path), self)

    def join(self, *others: "Results") -> "Results":
        """Put the results of several worlds, command limits or policies together; equal parts count once.

        Raises:
          InputError: if evaluation seed, commit or versions differ, or two of them differ in what they say of one cell,
            comparison, robot or tuning.
        """
        parts = (self, *others)
        for name in ("seed", "commit", "versions"):
            values = _unique(getattr(each, name) for each in parts)
            if len(values) > 1:
                raise InputError(f"{name} of the results is {values}, expected one; evaluate all with the same {name}")
        return Results(
            seed=self.seed,
            commit=self.commit,
            versions=self.versions,
            tasks=_unique(task for each in parts for task in each.tasks),
            robots=_joined("robots", [each.robots for each in parts]),
            tuning=_joined("tuning", [each.tuning for each in parts]),
            cells=_unique(cell for each in parts for cell in each.cells),
            comparisons=_unique(pair for each in parts for pair in each.comparisons),
            durations={
                stage: sum(each.durations.get(stage, 0.0) for each in parts)
                for stage in dict.fromkeys(stage for each in parts for stage in each.durations)
            },
        )

    def compare(self, a: str, b: str) -> Comparisons:
        """Return the paired differences of controller `a` to controller `b`, cell by cell.

        Paired intervals need the hits of each engagement, which results don't keep: the pairs of `pairs_to_compare` are
        there, in both directions.

        Raises:
          InputError: if the pair is not there.
        """
        found = [each for each in self.comparisons if (each.controller, each.against) == (a, b)]
        found = found or [_reversed(each) for each in self.comparisons if (each.controller, each.against) == (b, a)]
        if not found:
            there = ", ".join(dict.fromkeys(f"{each.controller} with {each.against}" for each in self.comparisons))
            raise InputError(f"no comparison of {a} with {b}; there are {there or 'none'}; evaluate with {b} as the first")
        return Comparisons(found)

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return a row per cell for a data frame: its fields, `range_m` in two, and its rate."""
        return [
            {**row, "range_low_m": row.pop("range_m")[0], "range_high_m": cell.range_m[1], "rate": cell.rate}
            for cell in self.cells
            for row in [msgspec.structs.asdict(cell)]
        ]

    def plot(self) -> "Figure":
        """Draw hit rate against range, a panel for each motion, world, command limit and length."""
        from archerfish2.evaluation.plots import hit_rates

        return hit_rates(self.cells)

    def report(self) -> "Report":
        """Return the report, which prints, and writes a page."""
        from archerfish2.evaluation.report import evaluation_report

        return evaluation_report(self)

    def __repr__(self) -> str:
        from archerfish2.evaluation.tables import results_text

        return results_text(self)


def pairs_to_compare(kinds: Sequence[Kind]) -> list[tuple[int, int]]:
    """Return which contenders an evaluation compares, by their places: (one, the other).

    Each policy and user's controller with each classical one, and each controller with the first one; never perfect aim.
    """
    places = [place for place, kind in enumerate(kinds) if kind != "perfect"]
    learned = [place for place in places if kinds[place] != "classical"]
    pairs = [(one, other) for one in learned for other in places if kinds[other] == "classical"]
    return pairs + [(one, places[0]) for one in places[1:] if not {(one, places[0]), (places[0], one)} & set(pairs)]


def _require(holds: bool, name: str, value: object, expected: str) -> None:
    if not holds:
        raise InputError(f"{name} is {value}, expected {expected}")


def _file(path: str | Path) -> Path:
    path = Path(path)
    return path if path.suffix == ".json" else path / "results.json"


def _unique(found: Iterable[Value]) -> tuple[Value, ...]:
    """Drop what was there before, by content."""
    return tuple({msgspec.json.encode(each): each for each in found}.values())


def _joined(name: str, parts: Sequence[Mapping[str, Mapping[str, Value]]]) -> dict[str, dict[str, Value]]:
    joined: dict[str, dict[str, Value]] = {}
    for part in parts:
        for key, facts in part.items():
            for fact, value in facts.items():
                if len(_unique([joined.setdefault(key, {}).setdefault(fact, value), value])) > 1:
                    raise InputError(f"{name}: {fact} of {key} is another in each; give worlds of unlike robots unlike names")
    return joined


def _reversed(pair: Comparison) -> Comparison:
    return msgspec.structs.replace(
        pair,
        controller=pair.against,
        against=pair.controller,
        difference=-pair.difference,
        low=-pair.high,
        high=-pair.low,
    )
