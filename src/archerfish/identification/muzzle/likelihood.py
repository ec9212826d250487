"""Muzzle speed, its scatter and the disturbance angles of eq (6) by maximum likelihood from shots.

Elevation and speed come from landing distances, or from heights of hits on a target plane, and from measured speeds
where there are any (muzzle_model.py); azimuth comes from lateral distances alone, to which it is tied one to one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.muzzle.dependence import durbin_watson, widening
from archerfish.identification.muzzle.fit import MuzzleFit, fit_muzzle
from archerfish.identification.muzzle.intervals import Interval, sample_intervals, shaping_interval, spread_interval
from archerfish.identification.muzzle.lack_of_fit import LackOfFit, lack_of_fit
from archerfish.identification.muzzle.model import RANGES, Flight, MuzzleProblem, response
from archerfish.identification.muzzle.outliers import Sorted, robust_fit, sort_out
from archerfish.identification.muzzle.restricted_likelihood import variance_information
from archerfish.identification.muzzle.separability import check_information, check_settings
from archerfish.identification.muzzle.shot_checks import Remark, check_shots
from archerfish.records.errors import InputError
from archerfish.records.muzzle import MuzzleRecord
from archerfish.records.shots import Shots, departure_azimuth, setting_names, settings, vertical_measurement

Array = NDArray[np.float64]

_DEPENDENT = 0.01
"""Chance of a Durbin–Watson statistic below which shots count as dependent."""
_LARGEST_RADIANS = 0.7
"""Angles [°] that are all smaller might be radians: no barrel of a robot rises by more than 40°."""
_NAMES: dict[Flight, str] = {"flat-fire": "The flight model (flat fire)", "eq-5": "Eq (5) as printed"}


@dataclass(frozen=True)
class MuzzleIdentification:
    """An identified muzzle and how well it explains the shots."""

    muzzle: MuzzleRecord
    """The muzzle with its 95 % intervals."""
    estimated: tuple[str, ...]
    """Fields of the record that were estimated; the others were given."""
    expected: Array
    """Landing distance, or height of the hit, of each shot by the model [m], shape (N,)."""
    expected_sd: Array
    """Standard deviation of each by the model [m], shape (N,)."""
    kept: NDArray[np.bool_]
    """Which shots were used; the others are outliers, shape (N,)."""
    lack_of_fit: LackOfFit
    """Whether the flight model itself can explain the shots."""
    findings: tuple[Remark, ...]
    """What may spoil the estimate."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """The findings, each as a sentence or two."""
        return tuple(finding.text for finding in self.findings)


def identify_muzzle(
    shots: Shots, *, drag: float | None, height: float | None = None, length: float = 0.0, flight: Flight = "flat-fire"
) -> MuzzleIdentification:
    """Estimate a muzzle from landing points or hits on target planes.

    Args:
      shots: the shots, with measured speeds or without, in the order of fire.
      drag: k [1/m]; estimated if None.
      height: height of the muzzle above the ground with the barrel level [m]; estimated if None. Hits on a plane don't
        need it.
      length: from the gimbal's pivot to the muzzle [m]: so much ahead of the pivot the muzzle rises with the pitch.
      flight: how pellets fly.

    Raises:
      InputError: if a given value is out of range, the shots can't be what they are said to be, or they can't separate
        the parameters; the message names the measurement that is missing.
    """
    given = (("drag", drag), ("height", height), ("length", length))
    known = {name: value for name, value in given if value is not None}
    _check_known(known)
    if shots.on_plane:
        known.setdefault("height", 0.0)
    if shots.speed is not None:
        known["speed"] = float(np.median(shots.speed))
    problem = MuzzleProblem(shots, known, flight)
    findings = check_shots(shots)
    check_settings(problem)
    findings += _angle_unit(problem)
    sorted_out = sort_out(problem)
    check_settings(sorted_out.problem)
    check_information(sorted_out.problem, sorted_out.fit)
    fitness = _lack_of_fit(sorted_out.problem, sorted_out.fit)
    estimates = _estimates(sorted_out.problem, sorted_out.fit, fitness)
    findings += [*_outliers(problem, sorted_out), *_misfit(problem, sorted_out, fitness), *estimates.findings]
    answer, fit = response(problem, sorted_out.fit.values), sorted_out.fit
    fields: dict[str, Any] = {**estimates.values, "intervals": estimates.intervals}
    return MuzzleIdentification(
        muzzle=MuzzleRecord(**fields),
        estimated=tuple(estimates.intervals),
        expected=answer.mean + answer.shift(fit.variances),
        expected_sd=answer.sd(fit.variances),
        kept=sorted_out.kept,
        lack_of_fit=fitness,
        findings=tuple(findings),
    )


class _Estimates(NamedTuple):
    """Fields of the muzzle record."""

    values: dict[str, float]
    intervals: dict[str, Interval]
    findings: list[Remark]


def _estimates(problem: MuzzleProblem, fit: MuzzleFit, fitness: LackOfFit) -> _Estimates:
    """Estimate every parameter with its interval, which is widened where successive shots are alike."""
    misfit = fitness.variance_ratio if fitness.shown else 1.0
    values = {**fit.values, "yaw_offset": 0.0, "yaw_sd": 0.0}
    intervals, findings = {}, []
    for index, name in enumerate(problem.free):
        intervals[name] = shaping_interval(problem, fit, index, misfit)
    for index, name in enumerate(problem.spreads):
        intervals[name] = spread_interval(problem, fit, index)
    findings += _open_ends(intervals)
    ratios, dependent = _vertical_dependence(problem, fit)
    for names, sample in _samples(problem.shots):
        values |= dict(zip(names, (float(sample.mean()), float(sample.std(ddof=1))), strict=True))
        intervals |= dict(zip(names, sample_intervals(sample), strict=True))
        more, told = _sample_dependence(names, sample)
        ratios, dependent = ratios | more, dependent + told
    intervals = {name: _widened(name, values[name], ends, ratios.get(name, 1.0)) for name, ends in intervals.items()}
    if problem.shots.lateral is None:
        text = "No lateral distances were measured: the yaw offset and its scatter are unknown, recorded as 0."
        findings.append(Remark("no-lateral", text))
    return _Estimates(values, intervals, findings + dependent)


def _samples(shots: Shots) -> list[tuple[tuple[str, str], Array]]:
    """Return what is a plain sample of one parameter and its spread: measured speeds, and azimuths of departure."""
    pairs = ((("speed", "speed_sd"), shots.speed), (("yaw_offset", "yaw_sd"), departure_azimuth(shots)))
    return [(names, sample) for names, sample in pairs if sample is not None]


def _vertical_dependence(problem: MuzzleProblem, fit: MuzzleFit) -> tuple[dict[str, float], list[Remark]]:
    """Widen the intervals that rest on the vertical measurements, if successive ones are alike."""
    deviation = fit.residuals.residual / fit.expected_sd
    number = settings(problem.shots)
    sizes = np.bincount(number)
    # A model that does not fit is no dependence of one shot on another.
    means = np.where(sizes > 2, np.bincount(number, deviation) / sizes, 0.0)
    series = deviation - means[number]
    what = "heights of the hits" if problem.shots.on_plane else "landing distances"
    remarks = _dependence(series, what)
    if not remarks:
        return {}, []
    whitened = fit.design / fit.expected_sd[:, None]
    parts = 2 * fit.variances[:, None] * fit.residuals.scales / fit.expected_sd**2
    means_longer = widening(whitened * series[:, None], whitened.T @ whitened)
    spreads_longer = widening(
        0.5 * parts.T * (series[:, None] ** 2 - 1), variance_information(fit.residuals, fit.variances)
    )
    longer = np.concatenate([means_longer, spreads_longer])
    return dict(zip((*problem.free, *problem.spreads), longer.tolist(), strict=True)), remarks


def _sample_dependence(names: tuple[str, str], sample: Array) -> tuple[dict[str, float], list[Remark]]:
    deviation = (sample - sample.mean()) / sample.std()
    remarks = _dependence(deviation, "muzzle speeds" if names[0] == "speed" else "azimuths")
    if not remarks:
        return {}, []
    scores = np.stack([deviation, deviation**2 - 1], axis=1)
    return dict(zip(names, widening(scores, np.eye(2)).tolist(), strict=True)), remarks


def _dependence(series: Array, what: str) -> list[Remark]:
    found = durbin_watson(series)
    if found.p_value >= _DEPENDENT:
        return []
    text = (
        f"Successive {what} are alike (Durbin–Watson {found.statistic:.2f}, p = {found.p_value:.2g}), as when the "
        "speed drifts in rapid fire: intervals are widened for that (HAC). Pause between shots, or mix the settings."
    )
    return [Remark("dependent-shots", text)]


def _widened(name: str, value: float, ends: Interval, ratio: float) -> Interval:
    """Move the ends of an interval away from the estimate, a spread's by a factor so that it stays positive."""
    if name.endswith("_sd"):
        low, high = (value * (end / value) ** ratio if value > 0 else end for end in ends)
    else:
        low, high = (value + ratio * (end - value) for end in ends)
    return low, high


def _open_ends(intervals: Mapping[str, Interval]) -> list[Remark]:
    remarks = []
    for name, (low, high) in intervals.items():
        bottom, top = RANGES[name]
        # That an offset or a spread may be zero is no fault of the shots.
        if (low <= bottom and bottom != 0) or high >= top * (1 - 1e-9):
            text = (
                f"The shots don't bound {name.replace('_sd', ' scatter').replace('_', ' ')} on both sides: "
                f"its interval ends where the search ends ({bottom:g}–{top:g})."
            )
            remarks.append(Remark("open-interval", text))
        elif low <= bottom:
            text = f"The shots don't tell {name.replace('_sd', ' scatter').replace('_', ' ')} from none."
            remarks.append(Remark("open-interval", text))
    return remarks


def _lack_of_fit(problem: MuzzleProblem, fit: MuzzleFit) -> LackOfFit:
    shots, number = problem.shots, settings(problem.shots)
    return lack_of_fit(
        number,
        fit.residuals.residual,
        fit.expected_sd,
        shots.distance,
        len(problem.free),
        setting_names(shots),
        _NAMES[problem.flight],
    )


def _misfit(problem: MuzzleProblem, sorted_out: Sorted, fitness: LackOfFit) -> list[Remark]:
    """Remark on a flight that does not fit, and say whether eq (5) as printed does better."""
    if not fitness.shown:
        return []
    text = "The intervals are widened by the misfit, and hold only as far as the flight does."
    if problem.flight == "flat-fire":
        other = replace(sorted_out.problem, flight="eq-5")
        text = f"{_lack_of_fit(other, fit_muzzle(other, robust_fit(other).values)).statement} {text}"
    return [Remark("lack-of-fit", text)]


def _outliers(problem: MuzzleProblem, sorted_out: Sorted) -> list[Remark]:
    """List the shots that were left out, each with how far it is from where the rest put it."""
    if sorted_out.too_many:
        text = (
            f"{sorted_out.too_many} of {len(problem.shots)} shots seem not to belong to the rest, too many to leave "
            "out: all were used. Check the angles and distances of whole settings."
        )
        return [Remark("too-many-outliers", text)]
    gone = np.flatnonzero(~sorted_out.kept)
    if not gone.size:
        return []
    answer = response(problem, sorted_out.fit.values)
    away = vertical_measurement(problem.shots) - answer.mean - answer.shift(sorted_out.fit.variances)
    deviation = away / answer.sd(sorted_out.fit.variances)
    listed = "; ".join(f"{problem.shots.place(int(i))} ({away[i]:+.2f} m, {deviation[i]:+.1f} sd)" for i in gone)
    text = (
        f"{gone.size} of {len(problem.shots)} shots don't belong to the rest (ricochets or flyers; a clean set loses "
        f"one in 1 % of cases) and were left out: {listed}."
    )
    return [Remark("outliers", text)]


def _angle_unit(problem: MuzzleProblem) -> list[Remark]:
    """Remark on angles that explain the shots far better if they are radians."""
    shots = problem.shots
    degrees = np.degrees(shots.pitch)
    if np.ptp(degrees) == 0 or np.abs(degrees).max() > _LARGEST_RADIANS:
        return []
    other = replace(problem, shots=replace(shots, pitch=degrees))
    if robust_fit(other).scale > 0.5 * robust_fit(problem).scale:
        return []
    text = (
        f"Pitch angles within ±{np.abs(degrees).max():.2g}° explain the shots badly and would explain them well as "
        "radians: the column holds degrees."
    )
    return [Remark("radians-as-degrees", text)]


def _check_known(known: Mapping[str, float]) -> None:
    for name, value in known.items():
        low, high = RANGES[name]
        if not low <= value <= high:
            unit = "1/m" if name == "drag" else "m"
            raise InputError(
                f"{name} must be from {low:g} to {high:g} {unit}, got {value:g}; give it in SI units", "out-of-range"
            )
