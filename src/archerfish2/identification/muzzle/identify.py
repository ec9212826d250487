"""`identify_muzzle`: from shots to a muzzle record, with its report."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification.muzzle import checks
from archerfish2.identification.muzzle.estimate import Known, expected, mean_error, sample_intervals, vertical_estimates
from archerfish2.identification.muzzle.flight import RANGES, azimuth, vertical
from archerfish2.identification.statistics import Array
from archerfish2.logs.recording import Finding
from archerfish2.logs.shots import Shots, read_shots
from archerfish2.paper.conditions import assumed_conditions
from archerfish2.provenance import provenance
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.reports.report import Report
from archerfish2.reports.table import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SPEED, _YAW = ("speed", "speed_sd"), ("yaw_offset", "yaw_sd")
PELLET_DRAG = assumed_conditions().drag
"""Of a 17 mm pellet [1/m]."""


@dataclass(frozen=True, eq=False)
class MuzzleResult:
    """An identified muzzle, and how well it explains N shots."""

    muzzle: MuzzleRecord
    estimates: dict[str, Estimate]  # by field of the record, in SI units; the other fields were given
    shots: Shots
    kept: checks.Flags  # which shots were used, (N,)
    expected: Array  # landing distance, or height of the hit, of each shot by the model [m], (N,)
    expected_sd: Array  # standard deviation of each by the model [m], (N,)
    lack_of_fit: checks.LackOfFit  # of the flight model
    findings: tuple[Finding, ...]  # what was repaired, and what may spoil the estimate

    @property
    def report(self) -> Report:
        """Verdict, figures and next steps."""
        from archerfish2.identification.muzzle.report import muzzle_report

        return muzzle_report(self)

    def plot(self) -> "Figure":
        """Draw the shots of each setting with the fitted dispersion."""
        from archerfish2.identification.muzzle.report import shots_by_setting

        number, names = self.shots.settings()
        return shots_by_setting(number, vertical(self.shots) - self.expected, self.expected_sd, self.kept, names=names)

    def save(self, folder: str | Path) -> None:
        """Write muzzle.json and muzzle.html.

        Raises:
          InputError: if they can't be written.
        """
        self.muzzle.save(Path(folder) / "muzzle.json")
        self.report.write_page(Path(folder) / "muzzle.html")


def identify_muzzle(
    shots: Shots | str | Path | Sequence[str | Path],
    *,
    height_m: float | None = None,
    length_m: float = 0.0,
    drag: float | Literal["estimate"] = PELLET_DRAG,
    seed: int = 0,
) -> MuzzleResult:
    """Estimate a muzzle from landing points or hits on target planes.

    Args:
      shots: the shots in the order of fire, with measured speeds or without; or their files.
      height_m: of the muzzle above the ground with the barrel level [m]; estimated if None. Hits don't need it.
      length_m: from the gimbal's pivot to the muzzle [m]: so much ahead of the pivot the muzzle rises with the pitch.
      drag: k [1/m], or "estimate".
      seed: of the bootstrap.

    Raises:
      InputError: if a given value is out of range, the shots can't be what they are said to be, or they can't separate
        the parameters; the message names the measurement that is missing.
    """
    if not isinstance(shots, Shots):
        shots = read_shots(*[shots] if isinstance(shots, str | Path) else shots)
    given = {"length": length_m, "height": height_m, "drag": None if drag == "estimate" else drag}
    known = {name: value for name, value in given.items() if value is not None}
    for name, value in known.items():
        if not RANGES[name][0] <= value <= RANGES[name][1]:
            problem = f"identify_muzzle: {name} is {value:g}, expected {RANGES[name][0]:g} to {RANGES[name][1]:g}"
            raise InputError(f"{problem}; give it in SI units", "out-of-range")
    known = ({} if shots.hit_height is None else {"height": 0.0}) | known
    known |= {} if shots.speed is None else {"speed": float(np.median(shots.speed))}
    checks.check_shots(shots, known)
    kept, fit, too_many = checks.without_outliers(shots, known)
    used, rounded = shots.select(kept), 0.0 if shots.speed is None else mean_error(shots.speed[kept])
    misfit, deviation = checks.lack_of_fit(used, fit, is_test=not rounded), fit.residual / fit.sd
    statistic, rho = checks.memory(deviation - checks.setting_means(used, deviation))
    alike = [f"vertical {statistic:.2f}"] * bool(rho)
    ratio = max(misfit.variance_ratio, 1.0) if misfit.p_value < 0.05 else 1.0
    estimates = vertical_estimates(known, fit, ratio, rounded, rho, seed)
    for names, unit, sample in ((_SPEED, "m/s", used.speed), (_YAW, "rad", azimuth(used))):
        if sample is not None:
            statistic, rho = checks.memory(sample)
            alike += [f"{names[0]} {statistic:.2f}"] * bool(rho)
            estimates |= dict(zip(names, sample_intervals(sample, rho, unit), strict=True))
    intervals = {name: (each.low, each.high) for name, each in estimates.items()}
    fields = {**fit.values, "yaw_sd": 0.0, **{name: each.value for name, each in estimates.items()}}
    muzzle = MuzzleRecord(**fields, intervals=intervals, provenance=provenance(seed, shots.files))
    result = MuzzleResult(muzzle, estimates, shots, kept, *expected(shots, fit), misfit, shots.findings)
    return replace(result, findings=(*shots.findings, *_warnings(result, known, too_many, rounded, alike)))


def _warnings(result: MuzzleResult, known: Known, too_many: int, rounded: float, alike: list[str]) -> Iterator[Finding]:
    """Yield what may spoil an estimate."""
    shots, pitch = result.shots, result.shots.pitch
    copies, lost = (
        ", ".join(shots.place(index) for index in np.flatnonzero(each).tolist())
        for each in (checks.repeated(shots)[0], ~result.kept)
    )
    limits = ((name, ends, RANGES.get(name, (-np.inf, np.inf))) for name, ends in result.muzzle.intervals.items())
    opened = ", ".join(name for name, (low, high), (least, most) in limits if low <= least or high >= most)
    small = float(np.ptp(pitch)) > 0 and float(np.abs(pitch).max()) < np.radians(0.7)
    scales = [checks.robust_fit(replace(shots, pitch=each), known)[2] for each in (pitch, np.degrees(pitch)) if small]
    for is_there, code, message, remedy in (
        (lost, "outliers", f"ricochets or flyers were left out: {lost}", "check these lines"),
        (too_many, "too-many-outliers", f"{too_many} shots disagree with the rest: all used", "check whole settings"),
        (copies, "repeated-shots", f"exactly as shots before: {copies}", "remove what was written twice"),
        (small and scales[1] < scales[0] / 2, "radians-as-degrees", "pitch seems to be in radians", "give degrees"),
        (rounded, "rounded-speeds", f"speeds in steps of {2 * rounded:g} m/s hide their scatter", "record more digits"),
        (alike, "dependent-shots", f"successive shots are alike (Durbin–Watson: {', '.join(alike)})", "pause between"),
        (opened, "open-interval", f"not bounded on both sides: {opened}", "shoot at more settings"),
        (shots.lateral is None, "no-lateral", "the yaw is not known, and recorded as 0", "record lateral_m"),
    ):
        if is_there:
            yield Finding(code, "warning", shots.source, message, remedy)
