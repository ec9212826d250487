"""Table I and Figs. 4–6, recomputed, as results.json holds them."""

from dataclasses import dataclass, field

from archerfish.records.errors import InputError


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
