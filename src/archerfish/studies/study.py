"""What a study stores: hit rates, and the curves and figures that are shown beside them."""

from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from msgspec import Meta, field

from archerfish.errors import checked_arguments
from archerfish.evaluation.results import Results
from archerfish.records.json_files import Number
from archerfish.records.record import Record, Struct
from archerfish.reports.report import Report
from archerfish.robot import Part, PartVerdict

OURS, SIX_NUMBERS = "policy", "six-numbers"
"""Names of the policy as `train` trains it, and of the one that sees the paper's six numbers."""
_Curve = Annotated[tuple[Number, ...], Meta(min_length=1, max_length=100_000)]
Axis = Literal["pitch", "yaw"]
Origin = Literal["paper", "robot"]
"""Whose it is: the paper's printed gimbal, or the virtual robot."""


class StepResponse(Struct, frozen=True, kw_only=True):
    """A step of an axis, and of its identified model from rest."""

    source: Origin
    """Of the paper's gimbal the true response without noise, of the robot the recorded one."""
    axis: Axis
    """Which axis."""
    size_deg: Number
    """Of the step [°]."""
    time_s: _Curve
    """Since the step [s]."""
    measured_deg: _Curve
    """Angle [°]."""
    model_deg: _Curve
    """Angle of the identified model [°]."""
    fit_percent: Number
    """100 (1 − NRMSE) of the model from the step on."""


class LandingPoint(Struct, frozen=True, kw_only=True):
    """A row of Table I: where pellets land."""

    pitch_deg: Number
    """Angle α, muzzle up positive [°]."""
    yaw_deg: Number
    """Angle β, to the right, as printed [°]."""
    printed_model_m: Number
    """The paper's simulated distance d₁ [m]."""
    measured_m: Number
    """The paper's measured distance d₂ [m]."""
    model_m: Number
    """Distance by the muzzle that is fitted to d₂ [m]."""


class LearningCurve(Struct, frozen=True, kw_only=True):
    """Reward in one training of Fig. 5 or 6."""

    targets: Literal["static", "dynamic"]
    """Fig. 5 or Fig. 6."""
    seed: Annotated[int, Meta(ge=0)]
    """Of the training."""
    decisions: _Curve
    """So far."""
    mean_reward: _Curve
    """Of eq (8) per decision [m]."""


class Study(Record, frozen=True, kw_only=True):
    """All that a study found; printed as its report."""

    schema: ClassVar[str] = "archerfish.study/1"
    remedy: ClassVar[str] = "run the study again"
    quick: bool = False
    """Whether trainings were short and engagements few, so that no figure is to be quoted."""
    results: Results
    """Hit rates in all worlds."""
    robot: str = ""
    """World of the identified robot's simulator; "" without a robot."""
    virtual: str = ""
    """World of the virtual robot."""
    parts: dict[Part, PartVerdict] = field(default_factory=dict)
    """What the identification says of each part of the robot."""
    steps: tuple[StepResponse, ...] = ()
    """Fig. 4 of the paper's gimbal, and steps of the robot that no fit has used."""
    landings: tuple[LandingPoint, ...] = ()
    """Table I."""
    muzzle: dict[str, Number] = field(default_factory=dict)
    """What was fitted to Table I: speed_m_s, height_m, pitch_offset_deg, drag_per_m."""
    curves: tuple[LearningCurve, ...] = ()
    """Figs 5 and 6."""
    durations: dict[str, Number] = field(default_factory=dict)
    """Stage → seconds."""

    @classmethod
    @checked_arguments
    def load(cls, path: str | Path) -> Self:
        """Read a study.

        Args:
          path: results.json, or its folder.

        Raises:
          InputError: if it can't be read, or a field is missing, unknown, of another type or out of range.
        """
        path = Path(path)
        return super().load(path if path.suffix == ".json" else path / "results.json")

    @property
    def report(self) -> Report:
        """The report, which prints, and writes a page."""
        from archerfish.studies.report import study_report

        return study_report(self)

    def __repr__(self) -> str:
        return str(self.report)

    def _repr_html_(self) -> str:
        return self.report._repr_html_()
