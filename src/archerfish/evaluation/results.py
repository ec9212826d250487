"""The file results.json: everything a run found, and all that its report is made from (docs/results.md)."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from archerfish.evaluation.robot_results import RobotIdentification
from archerfish.evaluation.typed_json import from_json
from archerfish.paper.conditions import Calibration, Conditions, assumed_conditions, calibration
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error
from archerfish.records.provenance import code_commit, library_versions

SCHEMA = "archerfish.results/1"

HIT_RATE_TABLES = ("II", "III", "IV", "V")
"""The paper's tables of hit rates: simulation static and dynamic, real robot static and dynamic."""

BOUND_KINDS = ("reach", "hindsight", "combined")
"""Kinds of bounds on hit rates, from the cheapest to the tightest (docs/bounds.md)."""

TARGETS = ("static", "dynamic")
"""Kinds of target in the paper's tables."""


@dataclass(frozen=True, kw_only=True)
class Label:
    """Which controller met which targets under which conditions."""

    table: str
    """The paper's table that the figure stands beside: "II", "III", "IV" or "V"."""
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
    """Name of a user's own motion that moving targets had in the place of eq (7); None for the paper's."""

    def __post_init__(self) -> None:
        for name, known in (("table", HIT_RATE_TABLES), ("target", TARGETS)):
            if getattr(self, name) not in known:
                raise InputError(f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}")
        if not 0 <= self.range_m[0] < self.range_m[1]:
            raise InputError(f"range_m must be two distances, the smaller one first, got {list(self.range_m)}")


@dataclass(frozen=True, kw_only=True)
class Cell(Label):
    """One hit rate: k hits of n shots."""

    hits: int
    """Shots that hit."""
    shots: int
    """Shots fired."""
    engagements: int
    """Independent engagements that the shots fall into."""
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
    bound: float | None = None
    """Proven bound on the hit rate, 0 to 1; None of perfect aim, and on a robot, whose axes are not linear."""
    bound_error: float | None = None
    """Standard error of the bound for the engagements of this cell, 0 to 1; 0 where chance has no part in it."""
    bound_kind: str | None = None
    """`reach`, `hindsight` or `combined`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.hits <= self.shots or self.shots == 0:
            raise InputError(f"hits must lie between 0 and shots > 0, got {self.hits} of {self.shots}")
        if not 0 <= self.low <= self.rate <= self.high <= 1:
            raise InputError(f"the interval {self.low} to {self.high} must hold hits/shots = {self.rate}")
        if self.misses_slewing + self.misses_settled != self.shots - self.hits:
            split = f"{self.misses_slewing} and {self.misses_settled}"
            raise InputError(f"misses_slewing and misses_settled must add up to shots − hits, got {split}")
        given = [each is not None for each in (self.bound, self.bound_error, self.bound_kind)]
        if any(given) != all(given):
            raise InputError("bound, bound_error and bound_kind must be given together, or none of them")
        if self.bound_kind not in (None, *BOUND_KINDS):
            raise InputError(f"bound_kind must be one of {', '.join(BOUND_KINDS)}, got {self.bound_kind!r}")

    @property
    def rate(self) -> float:
        """Hits per shot, 0 to 1."""
        return self.hits / self.shots


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


@dataclass(frozen=True)
class Table1Row:
    """One line of Table I with our fitted model beside it."""

    alpha_deg: float
    """Pitch angle α as printed [degrees]."""
    beta_deg: float
    """Yaw angle β as printed [degrees]."""
    d1_m: float
    """The paper's simulated distance [m]."""
    d2_m: float
    """The paper's measured distance [m]."""
    model_m: float
    """Distance by our fitted model [m]."""
    error_percent: float
    """(model − d2) / d2 [%]."""


@dataclass(frozen=True)
class LackOfFit:
    """How badly the best model misses Table I."""

    rms_percent: float
    """Root mean square of the nine errors [%]."""
    worst_percent: float
    """Largest of them in size [%]."""
    statement: str
    """What that means, in a sentence."""


@dataclass(frozen=True)
class Table1:
    """Table I: where pellets fall."""

    rows: tuple[Table1Row, ...]
    """Nine pairs of angles."""
    parameters: dict[str, float]
    """The fitted values; each name carries its unit."""
    lack_of_fit: LackOfFit
    """How far the model is from the measurements."""


@dataclass(frozen=True)
class StepResponse:
    """One axis of Fig. 4: the identified plant against the true one."""

    time_s: tuple[float, ...]
    """Time since the step [s], shape (N,)."""
    true_deg: tuple[float, ...]
    """Angle of the true plant [degrees], shape (N,)."""
    identified_deg: tuple[float, ...]
    """Angle of the identified plant [degrees], shape (N,)."""
    fit_percent: float
    """NRMSE fit of the two [%]."""

    def __post_init__(self) -> None:
        if not len(self.time_s) == len(self.true_deg) == len(self.identified_deg) > 0:
            lengths = f"{len(self.time_s)}, {len(self.true_deg)} and {len(self.identified_deg)}"
            raise InputError(f"time_s, true_deg and identified_deg must be of one length, got {lengths}")


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
class TrainingRun:
    """The return of one policy while it learned."""

    policy_seed: int
    """Seed of the training."""
    mean_return: tuple[float | None, ...]
    """Mean return of the engagements that ended since the last entry; None where none ended."""


@dataclass(frozen=True)
class LearningCurves:
    """Fig. 5 or 6: return against steps for several seeds."""

    steps: tuple[int, ...]
    """Environment steps so far, shape (N,)."""
    runs: tuple[TrainingRun, ...]
    """One curve per seed, each of length N."""

    def __post_init__(self) -> None:
        for run in self.runs:
            if len(run.mean_return) != len(self.steps):
                found = f"{len(run.mean_return)} for {len(self.steps)} steps"
                raise InputError(f"mean_return of seed {run.policy_seed} must have one entry per step, got {found}")


@dataclass(frozen=True)
class PaperFigures:
    """What the paper's figures show, recomputed."""

    fig4: dict[str, StepResponse] = field(default_factory=dict)
    """Step responses of "pitch" and "yaw"."""
    fig5: LearningCurves | None = None
    """Training against static targets."""
    fig6: LearningCurves | None = None
    """Training against dynamic targets."""


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
    figures: PaperFigures = PaperFigures()
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
    facts = storage.read_facts(path, SCHEMA)
    try:
        return from_json(Results, facts)
    except InputError as error:
        raise file_error(
            path, str(error), "write it anew with `archerfish reproduce` or `archerfish evaluate`"
        ) from error
