"""Whether a model can explain shots at all: what it leaves of the group means against what repeated shots scatter."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

Array = NDArray[np.float64]

_SIGNIFICANT = 0.05


@dataclass(frozen=True)
class LackOfFit:
    """Classical lack-of-fit test over groups of repeated shots; percentages are of the measured mean distance."""

    rms_percent: float
    """Root mean square over the groups of mean measured less modelled distance [%]."""
    worst_percent: float
    """The largest of them, with its sign [%]."""
    worst_pitch: float
    """Pitch of that group [rad]."""
    replicate_percent: float | None
    """Standard deviation of repeated shots within a group [%]; None without repetitions."""
    p_value: float | None
    """Chance of deviations this large if the model were right (F test); None without repetitions."""
    statement: str
    """All this in a sentence."""


def lack_of_fit(setting: Array, measured: Array, modelled: Array, parameters: int) -> LackOfFit:
    """Compare the deviations of group means with the scatter inside the groups.

    Args:
      setting: shots with the same value form a group, shape (N,).
      measured: shape (N,).
      modelled: shape (N,).
      parameters: number of parameters that were fitted to the means.
    """
    _, group = np.unique(np.round(setting, 6), return_inverse=True)
    sizes = np.bincount(group)
    level = np.bincount(group, measured) / sizes
    residual = (measured - modelled) / level[group]
    mean = np.bincount(group, residual) / sizes
    within = residual - mean[group]
    worst = int(np.argmax(np.abs(mean)))
    spare = int(measured.size - sizes.size)
    replicate = float(np.sqrt(within @ within / spare)) if spare else None
    # As many parameters as groups leave no freedom, and a right model would pass through all means.
    freedom = max(sizes.size - parameters, 1)
    p_value = None
    if replicate:
        p_value = float(fisher.sf(sizes @ mean**2 / freedom / replicate**2, freedom, spare))
    rms = float(np.sqrt(np.mean(mean**2)))
    pitch = float(setting[group == worst][0])
    return LackOfFit(
        rms_percent=100 * rms,
        worst_percent=100 * float(mean[worst]),
        worst_pitch=pitch,
        replicate_percent=None if replicate is None else 100 * replicate,
        p_value=p_value,
        statement=_statement(100 * rms, 100 * float(mean[worst]), np.degrees(pitch), replicate, p_value),
    )


def _statement(rms: float, worst: float, pitch_deg: float, replicate: float | None, p_value: float | None) -> str:
    left = f"The model leaves {rms:.1f} % (rms) of the mean distances, at worst {worst:+.1f} % at {pitch_deg:g}° pitch"
    if replicate is None or p_value is None:
        return f"{left}; without repeated shots this can't be told from scatter."
    scatter = f"repeated shots scatter by {100 * replicate:.1f} %"
    if p_value < _SIGNIFICANT:
        return f"{left}, while {scatter}: the flight model does not fit (p = {p_value:.2g})."
    return f"{left}, and {scatter}: no lack of fit shows (p = {p_value:.2g})."
