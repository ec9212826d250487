"""Whether a model can explain shots at all: what it leaves of the group means against what repeated shots scatter."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

Array = NDArray[np.float64]
Groups = NDArray[np.intp]

SIGNIFICANT = 0.05
"""Chance below which a lack of fit is taken as shown."""
TRIFLE = 0.2
"""Misfit, as a share of the scatter of repeated shots, that widens where pellets go by 2 %: many shots show it, no hit
rate does."""


@dataclass(frozen=True)
class LackOfFit:
    """Classical lack-of-fit test over groups of repeated shots; percentages are of the distance."""

    rms_percent: float
    """Root mean square over the groups of mean measured less modelled value [%]."""
    worst_percent: float
    """The largest of them, with its sign [%]."""
    worst_setting: str
    """The setting of that group."""
    replicate_percent: float | None
    """Standard deviation of repeated shots within a group [%]; None without repetitions."""
    p_value: float | None
    """Chance of deviations this large if the model were right (F test); None without repetitions."""
    variance_ratio: float
    """Mean squares of the group means over those within the groups, F; 1 without repetitions."""
    statement: str
    """All this in a sentence."""

    @property
    def shown(self) -> bool:
        """Whether the model does not fit."""
        return self.p_value is not None and self.p_value < SIGNIFICANT

    @property
    def matters(self) -> bool:
        """Whether the model does not fit by enough to be seen beside the scatter."""
        return self.shown and not _is_trifle(self.rms_percent, self.replicate_percent)


def lack_of_fit(
    group: Groups, residual: Array, sd: Array, distance: Array, parameters: int, names: Sequence[str], model: str
) -> LackOfFit:
    """Compare the deviations of group means with the scatter inside the groups.

    Args:
      group: number of the group of each shot, from 0, shape (N,).
      residual: measured less modelled [m], shape (N,).
      sd: standard deviation of each measurement up to a common factor [m], shape (N,).
      distance: what percentages are of [m], shape (N,).
      parameters: number of parameters that were fitted to the means.
      names: name of each group's setting, for the statement.
      model: name of the model, for the statement.
    """
    sizes = np.bincount(group)
    share = residual / (np.bincount(group, distance) / sizes)[group]
    mean = np.bincount(group, share) / sizes
    worst = int(np.argmax(np.abs(mean)))
    spare = int(residual.size - sizes.size)
    replicate = float(np.sqrt(np.sum((share - mean[group]) ** 2) / spare)) if spare else None
    ratio, p_value = _variance_ratio(group, residual / sd, parameters) if replicate else (1.0, None)
    rms, furthest = 100 * float(np.sqrt(np.mean(mean**2))), 100 * float(mean[worst])
    replicate = None if replicate is None else 100 * replicate
    return LackOfFit(
        rms_percent=rms,
        worst_percent=furthest,
        worst_setting=names[worst],
        replicate_percent=replicate,
        p_value=p_value,
        variance_ratio=ratio,
        statement=_statement(
            f"{model} leaves {_percent(rms)} of the distance (rms over the settings), "
            f"at worst {_percent(furthest, '+')} at {names[worst]}",
            rms,
            replicate,
            p_value,
        ),
    )


def _is_trifle(rms: float, replicate: float | None) -> bool:
    return replicate is not None and rms < TRIFLE * replicate


def _variance_ratio(group: Groups, deviation: Array, parameters: int) -> tuple[float, float]:
    """F and its p-value, for deviations in standard deviations, shape (N,)."""
    sizes = np.bincount(group)
    mean = np.bincount(group, deviation) / sizes
    # As many parameters as groups leave no freedom, and a right model would pass through all means.
    freedom, spare = max(sizes.size - parameters, 1), group.size - sizes.size
    ratio = float((sizes @ mean**2 / freedom) / (np.sum((deviation - mean[group]) ** 2) / spare))
    return ratio, float(fisher.sf(ratio, freedom, spare))


def _statement(left: str, rms: float, replicate: float | None, p_value: float | None) -> str:
    if replicate is None or p_value is None:
        return f"{left}; without repeated shots this can't be told from scatter."
    scatter = f"repeated shots scatter by {_percent(replicate)}"
    if p_value < SIGNIFICANT and _is_trifle(rms, replicate):
        return f"{left}, while {scatter}: more than chance (p = {p_value:.2g}), but a trifle beside the scatter."
    if p_value < SIGNIFICANT:
        return f"{left}, while {scatter}: the flight model does not fit (p = {p_value:.2g})."
    return f"{left}, and {scatter}: no lack of fit shows (p = {p_value:.2g})."


def _percent(value: float, sign: str = "") -> str:
    return f"{value:{sign}.{1 if abs(value) >= 1 else 2}f} %"
