"""`identify_muzzle`: from shots to a muzzle record, with its report."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from archerfish2.errors import InputError
from archerfish2.identification.muzzle import checks
from archerfish2.identification.muzzle.estimate import bounded, rounding_step, vertical_estimates
from archerfish2.identification.muzzle.flight import RANGES, MuzzleProblem, azimuth, response, vertical
from archerfish2.identification.statistics import Array, sample_estimates
from archerfish2.logs.recording import Finding
from archerfish2.logs.shots import Shots, read_shots
from archerfish2.paper.conditions import assumed_conditions
from archerfish2.provenance import provenance
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.reports.report import Report
from archerfish2.reports.table import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    paths = (
        []
        if isinstance(shots, Shots)
        else [Path(each) for each in ([shots] if isinstance(shots, str | Path) else shots)]
    )
    shots = shots if isinstance(shots, Shots) else read_shots(*paths)
    known = _known(shots, {"height": height_m, "length": length_m, "drag": None if drag == "estimate" else drag})
    problem, findings = MuzzleProblem(shots, known), [*shots.findings, *checks.check_shots(shots)]
    checks.check_separable(problem)
    kept, fit, too_many = checks.without_outliers(problem)
    used = replace(problem, shots=shots.select(kept))
    checks.check_separable(used, fit)
    misfit = checks.lack_of_fit(used.shots, fit.residual, fit.sd, len(used.free))
    estimates = vertical_estimates(used, fit, max(misfit.variance_ratio, 1.0) if misfit.shown else 1.0, seed)

    for names, sample in ((("speed", "speed_sd"), used.shots.speed), (("yaw_offset", "yaw_sd"), azimuth(used.shots))):
        if sample is not None:
            estimates |= dict(zip(names, sample_estimates(sample), strict=True))
    there = response(problem, fit.values)
    fields = {**fit.values, "yaw_offset": 0.0, "yaw_sd": 0.0} | {name: each.value for name, each in estimates.items()}
    muzzle = MuzzleRecord(
        **fields,
        intervals={name: (each.low, each.high) for name, each in estimates.items()},
        provenance=provenance(seed, paths),
    )
    expected = there.mean + 0.5 * there.curvatures @ fit.variances
    return MuzzleResult(
        muzzle, estimates, shots, kept, expected, np.sqrt(there.scales @ fit.variances), misfit, tuple(findings)
    )


def _known(shots: Shots, given: dict[str, float | None]) -> dict[str, float]:
    known = {name: float(value) for name, value in given.items() if value is not None}
    for name, value in known.items():
        low, high = RANGES[name]
        if not low <= value <= high:
            unit = "1/m" if name == "drag" else "m"
            problem = f"{name} is {value:g} {unit}, expected {low:g} to {high:g} {unit}"
            raise InputError(f"identify_muzzle: {problem}; give it in SI units", "out-of-range")
    if shots.hit_height is not None:
        known.setdefault("height", 0.0)
    return known | ({} if shots.speed is None else {"speed": float(np.median(shots.speed))})
