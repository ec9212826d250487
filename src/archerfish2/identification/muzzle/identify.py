"""`identify_muzzle`: from shots to a muzzle record, with its report."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification.muzzle import checks, estimate
from archerfish2.identification.muzzle.flight import RANGES, SHAPING, azimuth, linearised
from archerfish2.identification.muzzle.result import MuzzleResult
from archerfish2.logs.recording import Finding
from archerfish2.logs.shots import Shots, read_shots
from archerfish2.paper.conditions import assumed_conditions
from archerfish2.provenance import provenance
from archerfish2.records.muzzle import MuzzleRecord

PELLET_DRAG = assumed_conditions().drag
"""Of a 17 mm pellet [1/m]."""
Doubt = tuple[object, str, str, str]
"""Whether it is there, its code, what it is, and what to do."""


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
    # Hits are measured from the muzzle's height; the model's speed is added to measured ones.
    zeros = (("height", shots.hit_height), ("speed", shots.speed))
    known = {name: 0.0 for name, measured in zeros if measured is not None} | known
    free = [name for name in SHAPING if name not in known]
    checks.check_shots(shots, free)
    kept, fit, too_many = checks.without_outliers(shots, free, known)
    used = shots.select(kept)
    rounded = estimate.mean_error(used.speed)
    misfit = checks.lack_of_fit(used, fit, is_test=not rounded)
    vertical = checks.within_settings(used, fit.residual / fit.sd)
    series = {"vertical": vertical, "speed": used.speed, "yaw_offset": azimuth(used)}
    longer = {name: estimate.dependence(each) for name, each in series.items() if each is not None}
    ratio = misfit.variance_ratio if misfit.p_value < 0.05 else 1.0
    estimates = estimate.vertical_estimates(fit, ratio, rounded, longer["vertical"], seed)
    for mean, scatter, unit in (("speed", "speed_sd", "m/s"), ("yaw_offset", "yaw_sd", "rad")):
        if (sample := series[mean]) is not None:
            estimates[mean], estimates[scatter] = estimate.sample_intervals(sample, longer[mean], unit)
    found = {**fit.values, "yaw_sd": 0.0} | {name: each.value for name, each in estimates.items()}
    intervals = {name: (each.low, each.high) for name, each in estimates.items()}
    muzzle = MuzzleRecord(**found, intervals=intervals, provenance=provenance(seed, shots.files))
    lost = ", ".join(map(shots.place, np.flatnonzero(~kept).tolist()))
    alike = ", ".join(name for name, each in longer.items() if each[0] > 1)
    opened = ", ".join(name for name, each in estimates.items() if np.isin(each[1:3], RANGES[name]).any())
    doubts = _doubts(shots, lost, alike, opened, too_many, rounded)
    findings = [Finding(code, "warning", shots.source, text, remedy) for there, code, text, remedy in doubts if there]
    there = linearised(shots, fit.values)
    expected, sd = there.mean + 0.5 * there.curvatures @ fit.variances, np.sqrt(there.scales @ fit.variances)
    return MuzzleResult(muzzle, estimates, shots, kept, expected, sd, misfit, (*shots.findings, *findings))


def _doubts(shots: Shots, lost: str, alike: str, opened: str, too_many: int, rounded: float) -> tuple[Doubt, ...]:
    """Return what may spoil an estimate."""
    columns = [each for each in vars(shots).values() if isinstance(each, np.ndarray)]
    copies = len(shots) - np.unique(columns, axis=1).shape[1]
    copies *= shots.speed is not None or shots.lateral is not None  # equal values of one measurement are no copies
    return (
        (lost, "outliers", f"ricochets or flyers were left out: {lost}", "check these lines"),
        (too_many, "too-many-outliers", f"{too_many} shots disagree; all were used", "check whole settings"),
        (copies, "repeated-shots", f"{copies} shots repeat an earlier one exactly", "remove what was written twice"),
        (rounded, "rounded-speeds", f"speeds in steps of {2 * rounded:g} m/s hide their scatter", "record more digits"),
        (alike, "dependent-shots", f"successive shots are correlated: {alike}", "pause between shots"),
        (opened, "open-interval", f"not bounded on both sides: {opened}", "shoot at more settings"),
        (shots.lateral is None, "no-lateral", "yaw offset and scatter are unknown: taken as 0", "record lateral_m"),
    )
