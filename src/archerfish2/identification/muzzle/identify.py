"""`identify_muzzle`: from shots to a muzzle record, with its report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from archerfish2.errors import InputError
from archerfish2.identification.muzzle import checks
from archerfish2.identification.muzzle.estimate import MuzzleFit, rounding_step, vertical_estimates
from archerfish2.identification.muzzle.flight import RANGES, azimuth, response, vertical
from archerfish2.identification.muzzle.plots import shots_by_setting
from archerfish2.identification.statistics import Array, sample_estimates
from archerfish2.logs.recording import Finding
from archerfish2.logs.shots import Shots, read_shots
from archerfish2.paper.conditions import assumed_conditions
from archerfish2.provenance import provenance
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.reports.table import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from archerfish2.reports.report import Report

PELLET_DRAG = assumed_conditions().drag
"""Of a 17 mm pellet [1/m]."""


@dataclass(frozen=True, eq=False)
class MuzzleResult:
    """An identified muzzle, and how well it explains N shots."""

    muzzle: MuzzleRecord
    estimates: dict[str, Estimate]  # by field of the record, in SI units; the other fields were given
    shots: Shots
    kept: NDArray[np.bool_]  # which shots were used, (N,)
    expected: Array  # landing distance, or height of the hit, of each shot by the model [m], (N,)
    expected_sd: Array  # standard deviation of each by the model [m], (N,)
    lack_of_fit: checks.LackOfFit
    findings: tuple[Finding, ...]  # what was repaired, and what may spoil the estimate

    @property
    def report(self) -> "Report":
        """Verdict, figures and next steps."""
        from archerfish2.identification.muzzle.report import muzzle_report

        return muzzle_report(self)

    def plot(self) -> "Figure":
        """Draw the shots of each setting with the fitted dispersion."""
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
    known = {"length": length_m} | ({} if drag == "estimate" else {"drag": drag})
    known |= {} if height_m is None else {"height": height_m}
    for name, value in known.items():
        low, high = RANGES[name]
        if not low <= value <= high:
            problem = f"{name} is {value:g}, expected {low:g} to {high:g} {'1/m' if name == 'drag' else 'm'}"
            raise InputError(f"identify_muzzle: {problem}; give it in SI units", "out-of-range")
    known = ({} if shots.hit_height is None else {"height": 0.0}) | known
    known |= {} if shots.speed is None else {"speed": float(np.median(shots.speed))}
    checks.check_shots(shots, known)
    kept, fit, too_many = checks.without_outliers(shots, known)
    used = shots.select(kept)
    speed_error = 0.0 if used.speed is None else _mean_error(used.speed)
    misfit = checks.lack_of_fit(used, fit, tested=not speed_error)
    estimates = vertical_estimates(
        known, fit, max(misfit.variance_ratio, 1.0) if misfit.shown else 1.0, speed_error, seed
    )
    found = checks.findings(shots, known, kept, too_many)
    series = [("vertical measurements", _within(used, fit), [*estimates])]
    for name, unit, sample in (("speed", "m/s", used.speed), ("yaw_offset", "rad", azimuth(used))):
        if sample is not None:
            names = [name, f"{name.removesuffix('_offset')}_sd"]
            estimates |= dict(zip(names, _sample(sample, unit), strict=True))
            series += [(name.replace("_offset", "s").replace("speed", "speeds"), sample, names)]
    for what, values, names in series:
        statistic, rho = checks.memory(values)
        estimates |= {name: _widened(name, estimates[name], rho) for name in names}
        if rho:
            message = f"successive {what} are alike (Durbin–Watson {statistic:.2f}); intervals are widened"
            found += [("dependent-shots", message, "pause between shots, or mix the settings")]
    if speed_error:
        message = (
            f"speeds are multiples of {2 * speed_error:g} m/s, which is above their scatter; intervals are widened"
        )
        found += [("rounded-speeds", message, "record speeds with more digits")]
    for name, (_, low, high, _) in estimates.items():
        least, most = RANGES.get(name, (-np.inf, np.inf))
        if low <= least or high >= most:
            found += [("open-interval", f"the shots do not bound {name} on both sides", "shoot at more settings")]
    there = response(shots, fit.values)
    muzzle = MuzzleRecord(
        **{**fit.values, "yaw_sd": 0.0, **{name: each.value for name, each in estimates.items()}},
        intervals={name: (each.low, each.high) for name, each in estimates.items()},
        provenance=provenance(seed, shots.files),
    )
    expected, sd = there.mean + 0.5 * there.curvatures @ fit.variances, np.sqrt(there.scales @ fit.variances)
    warnings = (Finding(code, "warning", shots.source, message, remedy) for code, message, remedy in found)
    return MuzzleResult(muzzle, estimates, shots, kept, expected, sd, misfit, (*shots.findings, *warnings))


def _within(shots: Shots, fit: MuzzleFit) -> Array:
    """Return residuals in standard deviations less the means of settings: a lack of fit is no dependence, (N,)."""
    number, deviation = shots.settings()[0], fit.residual / fit.sd
    sizes = np.bincount(number)
    return np.asarray(deviation - np.where(sizes > 2, np.bincount(number, deviation) / sizes, 0.0)[number])


def _sample(sample: Array, unit: str) -> tuple[Estimate, Estimate]:
    """Return mean and standard deviation of a sample of shape (N,) without what its rounding adds.

    Where the step is above the scatter it does not average out: the mean may be off by half a step.
    """
    (mean, low, high, _), sd = sample_estimates(sample, unit)
    error, rounding = _mean_error(sample), rounding_step(sample) ** 2 / 12
    value, least, most = (float(np.sqrt(max(end**2 - rounding, 0.0))) for end in sd[:3])
    if error:
        least, most = 0.0, float(np.sqrt(sd.high**2 + rounding))
    return Estimate(mean, low - error, high + error, unit), Estimate(value, least, most, unit)


def _mean_error(sample: Array) -> float:
    """Return what the mean of rounded values, shape (N,), may be off by: half a step above their scatter, else 0."""
    step = rounding_step(sample)
    return step / 2 if step > sample.std() else 0.0


def _widened(name: str, estimate: Estimate, rho: float) -> Estimate:
    """Widen an interval for a series that is an autoregression of first order, a spread's by factors."""
    value, low, high, unit = estimate
    if name.endswith("_sd"):
        ratio = np.sqrt((1 + rho**2) / (1 - rho**2))
        low, high = (value * (end / value) ** ratio if value else end for end in (low, high))
    else:
        ratio = np.sqrt((1 + rho) / (1 - rho))
        low, high = (value + ratio * (end - value) for end in (low, high))
    return Estimate(value, float(low), float(high), unit)
