"""The file results.json: everything a run found, and all that its report is made from (docs/results.md)."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from archerfish.evaluation.paper_results import PaperFigures, Table1
from archerfish.evaluation.robot_results import RobotIdentification
from archerfish.evaluation.typed_json import from_json
from archerfish.paper.conditions import Calibration, Conditions, assumed_conditions, calibration
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error
from archerfish.records.provenance import code_commit, library_versions

SCHEMA, _OLDER = "archerfish.results/2", "archerfish.results/1"
"""In version 1 every decision counted, and withheld shots were not recorded."""

HIT_RATE_TABLES = ("II", "III", "IV", "V")
"""The paper's tables of hit rates: simulation static and dynamic, real robot static and dynamic."""

MOTION_TABLES = {1.0: "motions, 1 s", 3.0: "motions, 3 s"}
"""Length of an engagement [s] → name of the table of other motions: as short as the paper's, and so long that habits
can be learned."""

BOUND_KINDS = ("reach", "hindsight", "combined")
"""Kinds of bounds on hit rates, from the cheapest to the tightest (docs/bounds.md)."""

TARGETS = ("static", "dynamic")
"""Kinds of target in the paper's tables."""

COUNTS = ("decisions", "shots")
"""What a hit rate is counted over: all decisions, of which one that withholds its shot is a miss, or fired shots."""


def check_counts(counts: str) -> None:
    """Raise InputError if this is not one of `COUNTS`."""
    if counts not in COUNTS:
        raise InputError(f"counts must be one of {', '.join(COUNTS)}, got {counts!r}")


@dataclass(frozen=True, kw_only=True)
class Label:
    """Which controller met which targets under which conditions."""

    table: str
    """The paper's table that the figure stands beside: "II", "III", "IV" or "V"; else one of `MOTION_TABLES`."""
    setting: str
    """`paper` (printed plants), `identified-<robot>` (a simulator made from a robot's logs) or `<robot>` itself."""
    target: str
    """`static` or `dynamic`."""
    range_m: tuple[float, float]
    """Smallest and largest distance to the armor (dynamic: to the parabola's vertex) [m]."""
    command_limit: str
    """What the world lets a controller ask of the gimbal: `box`, `gate` or `los-2deg`."""
    controller: str
    """Name of the controller."""
    policy_seed: int | None = None
    """Seed that the policy was trained with; None for what is not trained."""
    motion: str | None = None
    """How targets moved, by name, where it was not as eq (7) has it in the paper."""
    counts: str = "decisions"
    """What hit rates are counted over: `decisions`, as in the paper's tables, or `shots` that were fired."""

    def __post_init__(self) -> None:
        check_counts(self.counts)
        for name, known in (("table", (*HIT_RATE_TABLES, *MOTION_TABLES.values())), ("target", TARGETS)):
            if getattr(self, name) not in known:
                raise InputError(f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}")
        if not 0 <= self.range_m[0] < self.range_m[1]:
            raise InputError(f"range_m must be two distances, the smaller one first, got {list(self.range_m)}")


@dataclass(frozen=True, kw_only=True)
class Cell(Label):
    """One hit rate: k hits of the n shots or decisions that count, `counted`."""

    hits: int
    """Shots that hit."""
    shots: int
    """Shots fired; where decisions count, n is these and `withheld`."""
    engagements: int
    """Independent engagements that the decisions fall into."""
    low: float
    """Lower end of the 95 % interval of the hit rate, 0 to 1."""
    high: float
    """Upper end of the 95 % interval of the hit rate, 0 to 1."""
    misses_slewing: int
    """Misses while the gimbal was still turning towards the target."""
    misses_settled: int
    """Misses afterwards."""
    paper: float | None = None
    """The paper's figure [%]; None where it prints none."""
    withheld: int = 0
    """Decisions that fired no shot."""
    fallbacks: int = 0
    """Decisions at which a policy fell back on a Kalman filter, which had predicted the target better of late."""
    hits_per_s: float | None = None
    """Hits per second of engagement [1/s]; None in files that were written before it was counted."""
    bound: float | None = None
    """Proven bound on the hit rate, 0 to 1; None of perfect aim, and on a robot, whose axes are not linear."""
    bound_error: float | None = None
    """Standard error of the bound for the engagements of this cell, 0 to 1; 0 where chance has no part in it."""
    bound_kind: str | None = None
    """`reach`, `hindsight` or `combined`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.hits <= self.shots or self.withheld < 0 or self.shots + self.withheld == 0:
            found = f"{self.hits} of {self.shots}, {self.withheld} withheld"
            raise InputError(f"hits must lie between 0 and shots, shots + withheld must be > 0, got {found}")
        # Of no shots that count there is no rate, and nothing that the interval could miss.
        if not 0 <= self.low <= (self.rate if self.counted else self.low) <= self.high <= 1:
            raise InputError(f"the interval {self.low} to {self.high} must hold hits/counted = {self.rate}")
        if not 0 <= self.fallbacks <= self.shots + self.withheld:
            raise InputError(f"fallbacks must lie between 0 and shots + withheld, got {self.fallbacks}")
        if self.misses_slewing + self.misses_settled != self.counted - self.hits:
            split = f"{self.misses_slewing} and {self.misses_settled}"
            missed = f"the misses, {self.counted} {self.counts} − {self.hits} hits"
            raise InputError(f"misses_slewing and misses_settled must add up to {missed}, got {split}")
        given = [each is not None for each in (self.bound, self.bound_error, self.bound_kind)]
        if any(given) != all(given):
            raise InputError("bound, bound_error and bound_kind must be given together, or none of them")
        if self.bound_kind not in (None, *BOUND_KINDS):
            raise InputError(f"bound_kind must be one of {', '.join(BOUND_KINDS)}, got {self.bound_kind!r}")

    @property
    def counted(self) -> int:
        """What the rate is counted over: shots, and withheld ones too where decisions count."""
        return self.shots + self.withheld * (self.counts == "decisions")

    @property
    def rate(self) -> float:
        """Hits per shot or decision that counts, 0 to 1; NaN of none."""
        return self.hits / self.counted if self.counted else math.nan


@dataclass(frozen=True, kw_only=True)
class Comparison(Label):
    """How far a controller's hit rate lies above another's in the same engagements with the same draws."""

    against: str
    """Name of the other controller."""
    difference: float
    """The controller's rate less the other's, −1 to 1."""
    low: float
    """Lower end of its 95 % interval, paired by engagement."""
    high: float
    """Upper end of its 95 % interval, paired by engagement."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not -1 <= self.low <= self.difference <= self.high <= 1:
            raise InputError(f"the interval {self.low} to {self.high} must hold the difference {self.difference}")


@dataclass(frozen=True)
class Acceleration:
    """What a controller asked of the yaw axis at most."""

    setting: str
    """As in a cell."""
    command_limit: str
    """As in a cell."""
    controller: str
    """As in a cell."""
    policy_seed: int | None
    """As in a cell."""
    yaw_rad_s2: float
    """Largest acceleration of command and motion, mean over a decision period [rad/s²]."""


@dataclass(frozen=True, kw_only=True)
class Drop(Label):
    """How far a controller's hit rate falls from the identified simulator to the robot, in the same engagements."""

    settled: bool
    """Whether the settled shots alone count."""
    difference: float
    """Rate in the simulator less that on the robot, −1 to 1."""
    low: float
    """Lower end of its 95 % interval, paired by engagement."""
    high: float
    """Upper end of its 95 % interval, paired by engagement."""


@dataclass(frozen=True)
class Results:
    """All of results.json; what a run did not compute is empty or None."""

    seed: int
    """Seed that everything else follows from."""
    commit: str
    """Commit of the code, with "-dirty" if it was changed."""
    versions: dict[str, str]
    """Versions of Python and the libraries."""
    durations: dict[str, float] = field(default_factory=dict)
    """Stage → seconds."""
    quick: bool = False
    """Whether the run was cut short to try things out; its figures are not to be quoted."""
    conditions: dict[str, Any] = field(default_factory=dict)
    """What the engagements were like, as `archerfish.paper.conditions.Conditions`: SI units and radians."""
    calibration: Calibration | None = None
    """How well these conditions bring our Kalman baseline to the paper's."""
    table1: Table1 | None = None
    """Table I."""
    identification: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Axis → facts about its identification."""
    figures: PaperFigures = field(default_factory=PaperFigures)
    """Figs. 4–6."""
    cells: tuple[Cell, ...] = ()
    """Every hit rate of Tables II–V."""
    comparisons: tuple[Comparison, ...] = ()
    """Paired differences of hit rates."""
    robot: RobotIdentification | None = None
    """The robot that the second half of the paper is rehearsed with."""
    drops: tuple[Drop, ...] = ()
    """From the identified simulator to each robot."""
    accelerations: tuple[Acceleration, ...] = ()
    """What the controllers asked of the yaw axis."""

    def __post_init__(self) -> None:
        counted: dict[tuple[str, str, str, tuple[float, float]], str] = {}
        for cell in self.cells:
            place = (cell.setting, cell.command_limit, cell.table, cell.range_m)
            if counted.setdefault(place, cell.counts) != cell.counts:
                raise InputError(
                    f"cells of table {cell.table} at {cell.range_m[0]:g}–{cell.range_m[1]:g} m in {cell.setting}, "
                    f"{cell.command_limit}, count decisions and shots, expected one of them; write two files"
                )


def new_results(
    *,
    seed: int,
    conditions: Conditions,
    cells: Iterable[Cell] = (),
    comparisons: Iterable[Comparison] = (),
    **parts: Any,
) -> Results:
    """Gather what a run found, with the commit and the versions of the running code.

    Args:
      seed: seed that everything else follows from.
      conditions: what the engagements were like; under the paper's, the calibration of these goes along.
      cells: hit rates.
      comparisons: paired differences.
      parts: any other field of `Results`.
    """
    return Results(
        seed=seed,
        commit=code_commit(),
        versions=library_versions(),
        conditions=asdict(conditions),
        calibration=calibration() if conditions == assumed_conditions() else None,
        cells=tuple(cells),
        comparisons=tuple(comparisons),
        **parts,
    )


def results_json(results: Results) -> dict[str, Any]:
    """Return what results.json holds.

    Raises:
      InputError: if a value is not finite or of another type than its field.
    """
    facts = asdict(results)
    from_json(Results, facts)
    return {"schema": SCHEMA, **facts}


def write_results(path: Path, results: Results) -> None:
    """Write results.json whole.

    Raises:
      InputError: if a value is not finite or of another type than its field, or the folder can't be written.
    """
    try:
        facts = results_json(results)
    except InputError as error:
        raise InputError(f"{path}: not written, {error}") from error
    storage.write_json(path, facts)


def read_results(path: Path) -> Results:
    """Read results.json.

    Raises:
      InputError: if the file is no results record, or a field is missing, unknown, of another type or out of range.
    """
    facts = storage.read_facts(path, SCHEMA, _OLDER)
    try:
        return from_json(Results, facts)
    except InputError as error:
        raise file_error(
            path, str(error), "write it anew with `archerfish reproduce` or `archerfish evaluate`"
        ) from error
