"""What an evaluation found: hits by cell and engagement, and what they were measured with."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeVar

import msgspec
from msgspec import Meta, field

from archerfish.controllers.tuning import Tuning
from archerfish.errors import InputError, checked_arguments, file_error, one_line
from archerfish.evaluation.comparison import Comparison, compare
from archerfish.evaluation.draws import MOST_COUNTS
from archerfish.evaluation.hit_rate import hit_rate
from archerfish.records.record import Record, Share, Struct
from archerfish.reports.table import Estimate
from archerfish.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from archerfish.reports.report import Report

Kind = Literal["policy", "classical", "user", "perfect"]
Value = TypeVar("Value")
_Text = Annotated[str, Meta(min_length=1, max_length=1000)]
_Count = Annotated[int, Meta(ge=0, le=1_000_000_000)]
_Positive = Annotated[float, Meta(ge=0.0, le=1e9)]


class Cell(Struct, frozen=True, kw_only=True):
    """What a controller hit in engagements of one kind: counts, of which rate and interval are functions."""

    world: _Text
    """Name of the robot, whose simulator it is, of the virtual robot, or of another world."""
    task: str = ""
    """Name of the task whose conditions are not the usual ones, as another speed of the targets."""
    command_limit: _Text
    """`box`, `gate` or `los-2deg`."""
    length_s: _Positive
    """Of an engagement [s]."""
    motion: _Text
    """Of the targets, by name."""
    range_m: tuple[_Positive, _Positive]
    """Smallest and largest distance of the targets [m]."""
    stream: _Count
    """Of random numbers: in cells of unlike streams the engagements differ."""
    controller: _Text
    """Its name; contenders of one name differ in their seed."""
    seed: int | None
    """That a policy was trained with; None for what is not trained."""
    kind: Kind
    """What the controller is; "perfect" is perfect aim, which only dispersion makes miss."""
    table: Literal["II", "III", "IV", "V"] | None = None
    """The paper's table that it belongs to."""
    hits_by_engagement: Annotated[tuple[_Count, ...], Meta(min_length=2)]
    """Shots that hit, of each engagement."""
    decisions_each: Annotated[int, Meta(ge=1, le=1_000_000)]
    """Decisions of an engagement."""
    withheld: _Count
    """Decisions without fire in all engagements, which count as misses."""
    paper: Annotated[float, Meta(ge=0.0, le=100.0)] | None = None
    """The paper's figure for such a controller [%]."""
    bound: Share | None = None
    """Proven bound of the mean hit rate; None where none is published."""
    bound_error: Share | None = None
    """Its standard error."""
    yaw_rad_s2: _Positive | None = None
    """Largest acceleration of the yaw axis, of command or motion, mean over a decision period [rad/s²]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        most, has_bound = max(self.hits_by_engagement), self.bound is not None
        for holds, fault in (
            (self.range_m[0] <= self.range_m[1], f"range_m is {self.range_m}, expected the smaller distance first"),
            (most <= self.decisions_each, f"{most} hits of {self.decisions_each} decisions in an engagement"),
            (self.hits <= self.shots, f"{self.hits} of {self.shots} shots hit, expected at most all of them"),
            (has_bound == (self.bound_error is not None), "has one of bound and bound_error, expected both or neither"),
        ):
            if not holds:
                label = one_line(f"{self.controller[:50]}, {self.motion[:50]}, {self.range_m}")
                raise InputError(f"Cell of {label}: {fault}; correct it")

    @property
    def hits(self) -> int:
        """Shots that hit."""
        return sum(self.hits_by_engagement)

    @property
    def engagements(self) -> int:
        """Independent engagements that the decisions belong to."""
        return len(self.hits_by_engagement)

    @property
    def decisions(self) -> int:
        """What the rate is counted over: shots and withheld ones."""
        return self.engagements * self.decisions_each

    @property
    def shots(self) -> int:
        """Decisions with fire."""
        return self.decisions - self.withheld

    @property
    def rate(self) -> float:
        """Hits per decision, 0 to 1."""
        return self.hits / self.decisions

    @property
    def low(self) -> float:
        """Lower end of the rate's 95 % interval, clustered by engagement."""
        return hit_rate(self.hits_by_engagement, self.decisions_each).low

    @property
    def high(self) -> float:
        """Upper end."""
        return hit_rate(self.hits_by_engagement, self.decisions_each).high

    @property
    def estimate(self) -> Estimate:
        """The rate with its interval [%]."""
        return Estimate(100 * self.rate, 100 * self.low, 100 * self.high, "%")

    @property
    def place(self) -> tuple[str, str, float, str]:
        """World, command limit, length and task: what tables and panels are made for."""
        return self.world, self.command_limit, self.length_s, self.task

    @property
    def key(self) -> tuple[Any, ...]:
        """What no two cells of results have in common."""
        return *self.place, self.motion, self.range_m, self.controller, self.seed

    @property
    def shot_at(self) -> tuple[Any, ...]:
        """What cells of the same engagements have in common."""
        return *self.place, self.motion, self.range_m, self.stream, self.engagements, self.decisions_each


class Results(Record, frozen=True, kw_only=True):
    """All that an evaluation found; printed as tables."""

    schema: ClassVar[str] = "archerfish.results/4"  # of the file
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
    """World → the robot's name, digest of its records, and what was assumed of it."""
    motions: dict[str, str] = field(default_factory=dict)
    """A user's motion → digest of its code, as it was run; "" where it refers to what has no content."""
    tuning: dict[str, Tuning]
    """"world/limit/task/controller" → settings."""
    cells: tuple[Cell, ...]
    """Hit rates, in the order of the controllers."""
    durations: dict[str, _Positive]
    """Stage → seconds."""
    remarks: tuple[str, ...] = ()
    """What was unlike the training of a policy."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len({cell.key for cell in self.cells}) < len(self.cells):
            raise InputError("Results: two cells have one label; give unlike ones to `join`")
        for task in self.tasks:
            of_name = [other.conditions() for other in self.tasks if other.name == task.name]
            _joined(f"task {task.name}", of_name)

    @classmethod
    @checked_arguments
    def load(cls, path: str | Path) -> Self:
        """Read results.json.

        Args:
          path: the file or its folder.

        Raises:
          InputError: if it can't be read, or a field is missing, unknown, of another type or out of range.
        """
        return super().load(_file(path))

    @checked_arguments
    def save(self, path: str | Path) -> None:
        """Write results.json; `path` is the file or its folder.

        Raises:
          InputError: if it can't be written, or would be larger than what is read.
        """
        if (counts := sum(cell.engagements for cell in self.cells)) > MOST_COUNTS:
            problem = f"{counts} engagements of all cells, expected at most {MOST_COUNTS}, to be read again"
            raise file_error(path, problem, "save the results in parts, before they are joined")
        super().save(_file(path))

    def join(self, *others: "Results | Iterable[Results]") -> "Results":
        """Put the results of several worlds, tasks, command limits or policies together; equal parts count once.

        Args:
          others: results, or lists of them.

        Raises:
          InputError: if evaluation seed, commit or versions differ, or what is there of one cell, robot or tuning; if
            tasks of one name differ in what labels of cells don't say, such as the speed of the targets; if several
            have a motion of one name, and its code has no digest.
        """
        parts = [self]
        for other in others:
            parts += other if isinstance(other, Iterable) else [other]
        for part in parts:
            if not isinstance(part, Results):
                raise InputError(f"join: expected Results, got a {type(part).__name__}; give what `evaluate` returns")
        code = [{"seed": part.seed, "commit": part.commit, **part.versions} for part in parts]
        _joined("results", code, "evaluate all with the same")
        unknown = [name for part in parts for name, digest in part.motions.items() if not digest]
        if repeated := [name for name in unknown if unknown.count(name) > 1]:
            problem = f"{repeated[0]} refers to what has no content, so that two of them may differ"
            raise InputError(f"motions: {problem}; write its code into a file, and name that")
        stages = dict.fromkeys(stage for part in parts for stage in part.durations)
        return self.replace(
            tasks=_unique(task for part in parts for task in part.tasks),
            robots=_joined("robots", [part.robots for part in parts]),
            motions=_joined("motions", [part.motions for part in parts]),
            tuning=_joined("tuning", [part.tuning for part in parts]),
            cells=_unique(cell for part in parts for cell in part.cells),
            remarks=_unique(remark for part in parts for remark in part.remarks),
            durations={stage: sum(part.durations.get(stage, 0.0) for part in parts) for stage in stages},
        )

    def compare(self, a: str, b: str) -> Comparison:
        """Return the paired differences of controller `a` to controller `b`, cell by cell.

        Args:
          a: name of a controller; of several trainings each is compared.
          b: that of another.

        Raises:
          InputError: if one is not there, or they have no engagements in common.
        """
        return compare(self.cells, a, b)

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return a row per cell for a data frame: its label, counts, rate and interval."""
        rows = []
        for cell in self.cells:
            row = msgspec.structs.asdict(cell)
            row["range_low_m"], row["range_high_m"] = cell.range_m
            for name in ("range_m", "hits_by_engagement", "decisions_each", "stream"):
                del row[name]
            counted = hit_rate(cell.hits_by_engagement, cell.decisions_each)
            rows.append({**row, **counted._asdict(), "shots": cell.shots, "rate": counted.rate})
        return rows

    def plot(self) -> "Figure":
        """Draw hit rate against range, a panel for each motion, world, command limit and length."""
        from archerfish.evaluation.plots import hit_rates

        return hit_rates(self.cells)

    @property
    def report(self) -> "Report":
        """The report, which prints, and writes a page."""
        from archerfish.evaluation.report import evaluation_report

        return evaluation_report(self)

    def __repr__(self) -> str:
        return str(self.report)

    def _repr_html_(self) -> str:
        return self.report._repr_html_()


def _file(path: str | Path) -> Path:
    path = Path(path)
    return path if path.suffix == ".json" else path / "results.json"


def _unique(found: Iterable[Value]) -> tuple[Value, ...]:
    """Drop what was there before, by content."""
    return tuple({msgspec.json.encode(each): each for each in found}.values())


def _joined(
    name: str, parts: Iterable[Mapping[str, Value]], remedy: str = "give what differs different names"
) -> dict[str, Value]:
    joined: dict[str, Value] = {}
    for part in parts:
        for key, value in part.items():
            if joined.setdefault(key, value) != value:
                raise InputError(f"{name}: {key} differs: {joined[key]} and {value}; {remedy}")
    return joined
