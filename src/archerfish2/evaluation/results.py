"""What an evaluation found: hit rates by cell, paired differences, and what they were measured with."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeVar

import msgspec
from msgspec import Meta

from archerfish2.controllers.tuning import Tuning
from archerfish2.errors import InputError, one_line
from archerfish2.records.record import Record, Struct
from archerfish2.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from archerfish2.reports.report import Report

Kind = Literal["policy", "classical", "user", "perfect"]
Value = TypeVar("Value")
_Text = Annotated[str, Meta(min_length=1, max_length=1000)]
_Count = Annotated[int, Meta(ge=0, le=1_000_000_000)]
_Positive = Annotated[float, Meta(ge=0.0, le=1e9)]
_Rate = Annotated[float, Meta(ge=0.0, le=1.0)]
_Difference = Annotated[float, Meta(ge=-1.0, le=1.0)]


class Label(Struct, frozen=True, kw_only=True):
    """Which controller in which engagements."""

    world: _Text
    """Name of the robot, whose simulator it is, of the virtual robot, or of another world."""
    motion: _Text
    """Of the targets, by name."""
    range_m: tuple[_Positive, _Positive]
    """Smallest and largest distance of the targets [m]."""
    length_s: _Positive
    """Of an engagement [s]."""
    command_limit: _Text
    """`box`, `gate` or `los-2deg`."""
    controller: _Text
    """Its name; contenders of one name differ in their seed."""
    seed: int | None
    """That a policy was trained with; None for what is not trained."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(self.range_m[0] <= self.range_m[1], "range_m", self.range_m, "the smaller distance first")

    def _require(self, holds: bool, name: str, value: object, expected: str) -> None:
        if not holds:
            label = f"{self.controller[:50]}, {self.motion[:50]}, {self.range_m[0]:g}–{self.range_m[1]:g} m"
            fault = f"{name} is {value}, expected {expected}; correct it"
            raise InputError(f"{type(self).__name__} of {one_line(label)}: {fault}")

    @property
    def place(self) -> tuple[str, str, float]:
        """World, command limit and length: what tables and panels are made for."""
        return self.world, self.command_limit, self.length_s

    @property
    def key(self) -> tuple[Any, ...]:
        """All of the label."""
        return *self.place, self.motion, self.range_m, self.controller, self.seed


class Cell(Label, frozen=True, kw_only=True):
    """One hit rate: hits of all decisions, which are shots and withheld ones."""

    table: Literal["II", "III", "IV", "V"] | None = None
    """The paper's table that it belongs to."""
    kind: Kind
    """What the controller is; "perfect" is perfect aim, which only dispersion makes miss."""
    hits: _Count
    """Shots that hit."""
    shots: _Count
    """Decisions with fire."""
    withheld: _Count
    """Decisions without fire, which count as misses."""
    engagements: _Count
    """Independent engagements that the decisions belong to."""
    low: _Rate
    """Lower end of the rate's 95 % interval, clustered by engagement."""
    high: _Rate
    """Upper end."""
    paper: Annotated[float, Meta(ge=0.0, le=100.0)] | None = None
    """The paper's figure for such a controller [%]."""
    bound: _Rate | None = None
    """Proven bound of the mean hit rate; None where none is published."""
    bound_error: _Rate | None = None
    """Its standard error."""
    yaw_rad_s2: _Positive | None = None
    """Largest acceleration of the yaw axis, of command or motion, mean over a decision period [rad/s²]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        counts = f"{self.hits} of {self.shots} shots, {self.withheld} withheld, in {self.engagements} engagements"
        whole = self.hits <= self.shots and 0 < self.engagements <= self.decisions
        self._require(whole, "count", counts, "hits ≤ shots and 0 < engagements ≤ decisions")
        interval, expected = f"{self.low} to {self.high}", f"one around the rate, {self.rate}"
        self._require(self.low <= self.rate <= self.high, "interval", interval, expected)
        both = (self.bound is None) == (self.bound_error is None)
        self._require(both, "bound", f"{self.bound} ± {self.bound_error}", "both or neither")

    @property
    def decisions(self) -> int:
        """What the rate is counted over: shots and withheld ones."""
        return self.shots + self.withheld

    @property
    def rate(self) -> float:
        """Hits per decision, 0 to 1."""
        return self.hits / self.decisions


class Comparison(Label, frozen=True, kw_only=True):
    """How far a hit rate is above another in the same engagements with the same dispersion draws."""

    against: _Text
    """Name of the other controller; WORLD/NAME where it is in another world."""
    difference: _Difference
    """Rate less the other's, −1 to 1."""
    low: _Difference
    """Lower end of its 95 % interval, paired by engagement."""
    high: _Difference
    """Upper end."""

    def __post_init__(self) -> None:
        super().__post_init__()
        interval, expected = f"{self.low} to {self.high}", f"one around the difference, {self.difference}"
        self._require(self.low <= self.difference <= self.high, "interval", interval, expected)


class Comparisons(tuple[Comparison, ...]):
    """The comparisons of two controllers, cell by cell; printed as tables with the means."""

    __slots__ = ()

    def __repr__(self) -> str:
        from archerfish2.evaluation.tables import comparisons_text

        return comparisons_text(self)


class Results(Record, frozen=True, kw_only=True):
    """All that an evaluation found; printed as tables."""

    schema: ClassVar[str] = "archerfish.results/3"  # of the file
    remedy: ClassVar[str] = "evaluate again"  # where it is damaged
    seed: int
    """Of engagements and dispersion."""
    commit: str
    """Of the code."""
    versions: dict[str, str]
    """Library → version."""
    tasks: tuple[Task, ...]
    """What was evaluated."""
    robots: dict[str, dict[str, str]]
    """World → what all of its cells have in common: digest of the robot's records, conditions of the task."""
    tuning: dict[str, dict[str, Tuning]]
    """"world/limit" → controller → its settings."""
    cells: tuple[Cell, ...]
    """Hit rates, in the order of the controllers."""
    comparisons: tuple[Comparison, ...]
    """The pairs of `pairs_to_compare`."""
    durations: dict[str, _Positive]
    """Stage → seconds."""
    remarks: tuple[str, ...] = ()
    """What was unlike the training of a policy."""

    def __post_init__(self) -> None:
        super().__post_init__()
        keys = {each.key for each in self.cells}
        pairs = {(*each.key, each.against) for each in self.comparisons}
        if len(keys) < len(self.cells) or len(pairs) < len(self.comparisons):
            raise InputError("Results: two cells or comparisons have one label; give unlike ones to `join`")
        alone = next((each.controller for each in self.comparisons if each.key not in keys), None)
        if alone is not None:
            raise InputError(f"Results: a comparison of {alone} has no cell of that label; correct it")

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read results.json.

        Args:
          path: the file or its folder.

        Raises:
          InputError: if it can't be read, or a field is missing, unknown, of another type or out of range.
        """
        return super().load(_file(path))

    def save(self, path: str | Path) -> None:
        """Write results.json; `path` is the file or its folder.

        Raises:
          InputError: if it can't be written.
        """
        super().save(_file(path))

    def join(self, *others: "Results") -> "Results":
        """Put the results of several worlds, command limits or policies together; equal parts count once.

        Raises:
          InputError: if evaluation seed, commit or versions differ, or what is there of one cell, comparison, robot or
            tuning; if tasks of one robot differ in what labels of cells don't say, such as the speed of the targets.
        """
        parts = (self, *others)
        for name in ("seed", "commit", "versions"):
            values = _unique(getattr(each, name) for each in parts)
            if len(values) > 1:
                raise InputError(f"{name} of the results is {values}, expected one; evaluate all with the same {name}")
        stages = dict.fromkeys(stage for each in parts for stage in each.durations)
        return self.replace(
            tasks=_unique(task for each in parts for task in each.tasks),
            robots=_joined("robots", [each.robots for each in parts]),
            tuning=_joined("tuning", [each.tuning for each in parts]),
            cells=_unique(cell for each in parts for cell in each.cells),
            comparisons=_unique(pair for each in parts for pair in each.comparisons),
            remarks=_unique(remark for each in parts for remark in each.remarks),
            durations={stage: sum(each.durations.get(stage, 0.0) for each in parts) for stage in stages},
        )

    def compare(self, a: str, b: str) -> Comparisons:
        """Return the paired differences of controller `a` to controller `b`, cell by cell.

        A paired interval needs the hits of each engagement, which results don't keep: the pairs of `pairs_to_compare`
        are there, in both directions.

        Raises:
          InputError: if the pair is not there.
        """
        both = [_reversed(each) for each in self.comparisons if (each.controller, each.against) == (b, a)]
        both += [each for each in self.comparisons if (each.controller, each.against) == (a, b)]
        found = {(*each.place, each.motion, each.range_m, each.seed): each for each in both}.values()
        if not found:
            there = ", ".join(dict.fromkeys(f"{each.controller} with {each.against}" for each in self.comparisons))
            raise InputError(f"no comparison of {a} with {b}; there are {there or 'none'}; evaluate with {b} first")
        return Comparisons(found)

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return a row per cell for a data frame: its fields, `range_m` in two, and its rate."""
        rows = []
        for cell in self.cells:
            row = msgspec.structs.asdict(cell)
            low, high = row.pop("range_m")
            rows.append({**row, "range_low_m": low, "range_high_m": high, "rate": cell.rate})
        return rows

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

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def pairs_to_compare(contenders: Sequence[tuple[str, Kind]]) -> list[tuple[int, int]]:
    """Return which contenders an evaluation compares, by their places: (one, the other).

    Each policy and user's controller with each classical one, and each controller with the first; never perfect aim,
    nor trainings of one name.

    Args:
      contenders: names and kinds.
    """
    places = [place for place, (_, kind) in enumerate(contenders) if kind != "perfect"]
    learned = [place for place in places if contenders[place][1] != "classical"]
    pairs = [(a, b) for a in learned for b in places if b not in learned]
    others = [place for place in places if contenders[place][0] != contenders[places[0]][0]]
    return pairs + [(a, places[0]) for a in others if not {(a, places[0]), (places[0], a)} & set(pairs)]


def _file(path: str | Path) -> Path:
    path = Path(path)
    return path if path.suffix == ".json" else path / "results.json"


def _unique(found: Iterable[Value]) -> tuple[Value, ...]:
    """Drop what was there before, by content."""
    return tuple({msgspec.json.encode(each): each for each in found}.values())


def _joined(name: str, parts: Sequence[Mapping[str, Mapping[str, Value]]]) -> dict[str, dict[str, Value]]:
    joined: dict[str, dict[str, Value]] = {}
    for key, facts in ((key, facts) for part in parts for key, facts in part.items()):
        for fact, value in facts.items():
            found = _unique([joined.setdefault(key, {}).setdefault(fact, value), value])
            if len(found) > 1:
                remedy = "give different robots different names, and evaluate one task with all that is to be joined"
                raise InputError(f"{name}: {fact} of {key} differs: {found[0]} and {found[1]}; {remedy}")
    return joined


def _reversed(pair: Comparison) -> Comparison:
    turned = {"difference": -pair.difference, "low": -pair.high, "high": -pair.low}
    return pair.replace(controller=pair.against, against=pair.controller, **turned)
