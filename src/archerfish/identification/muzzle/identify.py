"""`identify_muzzle`: from shots to a muzzle record, with its report."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from msgspec.structs import asdict

from archerfish.errors import InputError, checked_arguments
from archerfish.identification.muzzle import checks, estimate
from archerfish.identification.muzzle.checks import Flags, LackOfFit
from archerfish.identification.muzzle.estimate import (
    RANGES,
    SHAPING,
    azimuth,
    expected_vertical,
    linearised,
    measured_vertical,
)
from archerfish.identification.statistics import Array, converted
from archerfish.logs.recording import Finding
from archerfish.logs.shots import Shots, read_shots
from archerfish.paper.conditions import assumed_conditions
from archerfish.provenance import provenance
from archerfish.records.json_files import plain
from archerfish.records.muzzle import MuzzleRecord
from archerfish.reports.report import Report, Result
from archerfish.reports.style import MUTED, Figure, new_figure, plot_style
from archerfish.reports.table import Entry, Estimate, Table, entry_texts

_LARGE_OFFSET = np.radians(2.0)  # beyond what a mounted barrel has
_WITHIN_95 = np.sqrt(-2 * np.log(0.05))  # standard deviations of two dimensions
_PATTERN = "Shots about the aim of a barrel without offsets, seen from the muzzle, with the ellipse of 95 % of them."
_NOTE = "Offset: mean angle off the barrel, up or left positive; scatter: standard deviation; 1° is 17 mm per metre."


@dataclass(frozen=True, eq=False, repr=False)
class MuzzleResult(Result):
    """An identified muzzle, and how well it explains N shots."""

    record: MuzzleRecord
    estimates: dict[str, Estimate]  # by field of the record, in SI units; the other fields were given
    shots: Shots
    used: Flags  # which shots were used, (N,)
    expected: Array  # landing distance, or height of the hit, of each shot by the model [m], (N,)
    expected_sd: Array  # standard deviation of each by the model [m], (N,)
    lack_of_fit: LackOfFit  # of the flight model
    findings: tuple[Finding, ...]  # what was repaired, and what may spoil the estimate

    part = "muzzle"

    def plot(self) -> Figure:
        """Draw measured less expected distances or heights, a setting after the other, each in the order of fire."""
        number, names = self.shots.settings()
        order, place = np.argsort(number, kind="stable"), np.arange(len(self.shots))
        left = 100 * (measured_vertical(self.shots) - self.expected)[order]
        band = 196 * self.expected_sd[order]
        used = self.used[order]
        with plot_style():
            figure, [[axes]] = new_figure()
            axes.fill_between(place, -band, band, step="mid", color=MUTED, alpha=0.25, lw=0, label="95 % by the model")
            axes.plot(place[used], left[used], ".", label="measured")
            axes.plot(place[~used], left[~used], "x", label="left out")
            axes.set_xticks([place[number[order] == setting].mean() for setting in range(len(names))], names)
            kind = "setting: pitch [°]" if self.shots.hit_height is None else "setting: pitch [°], distance [m]"
            axes.set(xlabel=kind, ylabel="measured less model [cm]")
            figure.legend(loc="outside lower center", ncols=3)
        return figure

    def pattern(self) -> Figure:
        """Draw where the shots of each setting went about where a barrel without offsets aims, seen from the muzzle.

        Hits have the circle in which a plate is hit; the ellipses hold 95 % of normal shots, by their covariance.
        """
        shots, (number, names) = self.shots, self.shots.settings()
        hits = shots.hit_height is not None
        aimed = {**asdict(self.record), "pitch_offset": 0.0}
        above = measured_vertical(shots) - expected_vertical(replace(shots, speed=None), aimed)
        right = -np.asarray(shots.lateral) + (shots.distance * np.tan(shots.yaw) if hits else 0.0)
        places, turn = 100 * np.stack([right, above]), np.linspace(0, 2 * np.pi, 100)
        circle = np.stack([np.cos(turn), np.sin(turn)])
        across = math.isqrt(len(names) - 1) + 1
        down = -(-len(names) // across)
        with plot_style():
            figure, axes = new_figure(down, across, height=0.8 + 6.6 / across * down, sharex=True, sharey=True)
            for setting, panel in enumerate(axes.flat):
                own = places[:, (number == setting) & self.used]
                panel.set_visible(own.size > 0)
                panel.set(
                    aspect="equal", xlabel="to the right [cm]", ylabel=f"{'above' if hits else 'beyond'} the aim [cm]"
                )
                panel.label_outer()
                panel.plot(*own, ".", markersize=4.0, label="shot")
                if own.shape[1] > 2:
                    ellipse = np.linalg.cholesky(np.cov(own) + 1e-9 * np.eye(2)) @ circle
                    panel.plot(*(own.mean(1)[:, None] + _WITHIN_95 * ellipse), label="95 % ellipse")
                if hits:
                    panel.plot(*(100 * assumed_conditions().hit_radius * circle), color=MUTED, label="plate")
                panel.set_title(names[setting] if own.size else "")
            figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return figure

    @cached_property
    def report(self) -> Report:
        """Judge the muzzle: usable is one that neither a lack of fit nor the shots put in question."""
        fit, muzzle, shots, landed = self.lack_of_fit, self.record, self.shots, self.shots.hit_height is None
        shown = {name: _in_degrees(found) for name, found in self.estimates.items()}
        text = {name: entry_texts(entry) for name, entry in shown.items()}
        scatter = " and ".join(f"{text[name][0]} in {name[:-3]}" for name in ("pitch_sd", "yaw_sd") if name in text)
        used = f"{np.count_nonzero(self.used)} of {len(shots)} shots used"
        doubts = [finding.message for finding in self.findings if finding.code == "too-many-outliers"]
        doubts += [str(fit)] * fit.matters
        ends = (name for name in shown if name in SHAPING and self.estimates[name].value in RANGES[name])
        doubts += [f"The {name.replace('_', ' ')} ran to an end of its range: shoot at more settings." for name in ends]
        units = {"drag": "1/m", "length": "m"} | ({"height": "m"} if landed else {})
        given = {name: getattr(muzzle, name) for name in units if name not in shown}
        known = ", ".join(f"{name} {value:g} {units[name]}" for name, value in given.items())
        sizes = np.bincount(shots.settings()[0][self.used])
        more = sizes.size < 3 or sizes.min() < 10 or shots.speed is None
        doubtful = [name for name in ("pitch_offset", "yaw_offset") if abs(getattr(muzzle, name)) > _LARGE_OFFSET]
        length = "The length from the pivot to the muzzle is taken as 0: measure it"
        again = "Measure angles [°], distances and height again, or estimate the drag"
        settings = "Shoot twenty times at each of three to five settings, with measured speeds, and give all files"
        steps = (
            (fit.matters and "drag" not in shown, f"{again} (archerfish identify muzzle --drag estimate)."),
            (not muzzle.length, f"{length} (length_m in [muzzle] of logs.toml, or --length-m)."),
            (more, f"{settings} (shots in [muzzle] of logs.toml, or archerfish identify muzzle SHOTS MORE)."),
        )
        rows = list[tuple[Entry, ...]]()
        for name, entry in shown.items():
            rows.append((name.replace("_sd", " scatter").replace("_", " "), entry))
        return Report(
            f"Muzzle from {shots.source}",
            f"{' ('.join(text['speed'])}), scatter {scatter}; {used}; {str(fit).partition(':')[0].lower()}.",
            usable=not doubts,
            reasons=tuple(doubts),
            known=(str(fit), f"Taken as given: {known}."),
            doubts=(
                *([str(fit)] if fit.significant and not fit.matters else []),
                *(f"The {name.replace('_', ' ')} is large: check signs and the zero." for name in doubtful),
            ),
            next_steps=tuple(step for is_due, step in steps if is_due),
            tables=(Table("Parameters", ("parameter", "estimate, 95 %"), tuple(rows), _NOTE),),
            figures=(
                *([(_PATTERN, self.pattern)] if shots.lateral is not None else []),
                ("Measured less modelled, shot by shot", self.plot),
            ),
            findings=self.findings,
            provenance=plain(muzzle.provenance),
        )


def _in_degrees(found: Estimate) -> Estimate:
    return converted(found, np.degrees, "°") if found.unit == "rad" else found


PELLET_DRAG = assumed_conditions().drag
"""Of a 17 mm pellet [1/m]."""
Doubt = tuple[object, str, str, str]
"""Whether it is there, its code, what it is, and what to do."""


@checked_arguments
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
        files: list[Any] = [*shots] if isinstance(shots, Iterable) and not isinstance(shots, str) else [shots]
        if not files or not all(isinstance(file, str | Path) for file in files):
            problem = f"expected Shots, a file or several, got one of type {type(shots).__name__}"
            raise InputError(f"identify_muzzle: {problem}; give one of these")
        shots = read_shots(*files)
    given = {"length": length_m, "height": height_m, "drag": None if drag == "estimate" else drag}
    known = {name: value for name, value in given.items() if value is not None}
    for name, value in known.items():
        if not RANGES[name][0] <= value <= RANGES[name][1]:
            problem = f"identify_muzzle: {name} is {value:g}, expected {RANGES[name][0]:g} to {RANGES[name][1]:g}"
            raise InputError(f"{problem}; give it in SI units", "out-of-range")
    # Hits are measured from the muzzle's height; the model's speed is added to measured ones.
    zeros = (("height", shots.hit_height), ("speed", shots.speed))
    known = {name: 0.0 for name, measured in zeros if measured is not None} | known
    free = [name for name in SHAPING if name not in known]
    checks.check_shots(shots, free)
    is_used, fit, too_many = checks.without_outliers(shots, free, known)
    used = shots.select(is_used)
    rounded = estimate.mean_error(used.speed)
    misfit = checks.lack_of_fit(used, fit, is_test=not rounded)
    vertical = checks.within_settings(used, fit.residual / fit.sd)
    series = {"vertical": vertical, "speed": used.speed, "yaw_offset": azimuth(used)}
    widened = {name: estimate.dependence(sample) for name, sample in series.items() if sample is not None}
    ratio = misfit.variance_ratio if misfit.significant else 1.0
    estimates = estimate.vertical_estimates(fit, ratio, rounded, widened["vertical"], seed)
    for mean, scatter, unit in (("speed", "speed_sd", "m/s"), ("yaw_offset", "yaw_sd", "rad")):
        if (sample := series[mean]) is not None:
            estimates[mean], estimates[scatter] = estimate.sample_intervals(sample, widened[mean], unit)
    fields = {**fit.values, "yaw_sd": 0.0} | {name: found.value for name, found in estimates.items()}
    intervals = {name: (found.low, found.high) for name, found in estimates.items()}
    muzzle = MuzzleRecord(**fields, intervals=intervals, provenance=provenance(seed, shots.files))
    outliers = ", ".join(map(shots.place, np.flatnonzero(~is_used).tolist()))
    dependent = ", ".join(name for name, (mean, _) in widened.items() if mean > 1)
    at_an_end = [name for name, ends in intervals.items() if np.isin(ends, RANGES[name]).any()]
    doubts = _doubts(shots, outliers, dependent, ", ".join(at_an_end), too_many, rounded)
    findings = [Finding(code, "warning", shots.source, text, remedy) for there, code, text, remedy in doubts if there]
    there = linearised(shots, fit.values)
    expected, sd = there.mean + 0.5 * there.curvatures @ fit.variances, np.sqrt(there.scales @ fit.variances)
    return MuzzleResult(muzzle, estimates, shots, is_used, expected, sd, misfit, (*shots.findings, *findings))


def _doubts(
    shots: Shots, outliers: str, dependent: str, unbounded: str, too_many: int, rounded: float
) -> tuple[Doubt, ...]:
    """Return what may spoil an estimate."""
    columns = [column for column in vars(shots).values() if isinstance(column, np.ndarray)]
    copies = len(shots) - np.unique(columns, axis=1).shape[1]
    copies *= shots.speed is not None or shots.lateral is not None  # equal values of one measurement are no copies
    return (
        (outliers, "outliers", f"ricochets or flyers were left out: {outliers}", "check these lines"),
        (too_many, "too-many-outliers", f"{too_many} shots disagree; all were used", "check whole settings"),
        (copies, "repeated-shots", f"{copies} shots repeat an earlier one exactly", "remove what was written twice"),
        (rounded, "rounded-speeds", f"speeds in steps of {2 * rounded:g} m/s hide their scatter", "record more digits"),
        (dependent, "dependent-shots", f"successive shots are correlated: {dependent}", "pause between shots"),
        (unbounded, "open-interval", f"not bounded on both sides: {unbounded}", "shoot at more settings"),
        (shots.lateral is None, "no-lateral", "yaw offset and scatter are unknown: taken as 0", "record lateral_m"),
    )
