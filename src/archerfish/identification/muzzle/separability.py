"""Which muzzle parameters a set of shots can separate: by counting settings, and by the information that they hold."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.muzzle.fit import MuzzleFit
from archerfish.identification.muzzle.model import MuzzleProblem
from archerfish.records.errors import InputError
from archerfish.records.shots import settings

Array = NDArray[np.float64]

_REMEDIES = {
    "speed": "measure the muzzle speed of each shot (column speed_m_s)",
    "speed_sd": "measure the muzzle speed of each shot (column speed_m_s)",
    "height": "measure the muzzle's height above the ground (--height-m)",
    "drag": "give the drag coefficient (--drag-per-m)",
}
_SEPARABLE = 1e-3
"""Least singular value of the scaled derivatives: below, they are the same to a part in a thousand."""


def check_settings(problem: MuzzleProblem) -> None:
    """Refuse shots at too few settings for the parameters that shape their means.

    Each of them needs a setting of its own: at one setting a faster pellet and a higher barrel land alike. Hits on a
    plane need a distance of its own for each, as a change of pitch moves all of them alike.

    Raises:
      InputError: with the measurement that is missing.
    """
    free = problem.free
    count, kind = _settings(problem)
    if count < len(free):
        many = f"{count} {kind}{'s' * (count > 1)}"
        raise _inseparable(problem, many, free, f"shoot at {len(free)} {kind}s")
    # The standard deviations are estimated beside the parameters of the mean.
    needed = len(free) + len(problem.spreads) + 2
    if len(problem.shots) < needed:
        raise InputError(
            f"{_source(problem)}: {len(problem.shots)} shots are too few for {len(free)} parameters of the mean and "
            f"the standard deviations; shoot at least {needed}, better 20 at each {kind}",
            "too-few-shots",
        )


def check_information(problem: MuzzleProblem, fit: MuzzleFit) -> None:
    """Refuse shots whose information matrix is singular at the estimate.

    Raises:
      InputError: naming the parameters that trade against each other, and the measurement that is missing.
    """
    kind = _settings(problem)[1]
    free, root = problem.free, 1 / fit.expected_sd
    spreads = fit.residuals.scales.T * root[:, None] ** 2
    for names, columns in ((free, fit.design * root[:, None]), (problem.spreads, spreads)):
        blurred = _inseparable_names(names, columns)
        if blurred:
            remedy = f"shoot at {kind}s that lie further apart"
            raise _inseparable(problem, f"{kind}s so near each other", blurred, remedy)


def _inseparable_names(names: Sequence[str], columns: Array) -> tuple[str, ...]:
    """Name the parameters in the direction that the columns of derivatives, shape (N, k), say nothing about."""
    size = np.linalg.norm(columns, axis=0)
    if np.any(size == 0):
        return tuple(name for name, length in zip(names, size, strict=True) if length == 0)
    _, values, directions = np.linalg.svd(columns / size, full_matrices=False)
    if values[-1] > _SEPARABLE:
        return ()
    return tuple(name for name, share in zip(names, directions[-1], strict=True) if abs(share) > 0.1)


def _settings(problem: MuzzleProblem) -> tuple[int, str]:
    if problem.shots.on_plane:
        return int(np.unique(np.round(problem.shots.distance, 2)).size), "target distance"
    return int(settings(problem.shots).max()) + 1, "pitch setting"


def _inseparable(problem: MuzzleProblem, found: str, names: Sequence[str], more: str) -> InputError:
    told = " from ".join(name.replace("_sd", " scatter").replace("_", " ") for name in names)
    remedies = dict.fromkeys(_REMEDIES[name] for name in names if name in _REMEDIES)
    return InputError(
        f"{_source(problem)}: {found} can't separate {told}; {', or '.join([*remedies, more])}", "not-separable"
    )


def _source(problem: MuzzleProblem) -> str:
    return problem.shots.source or "shots"
