"""What is known of an axis when the recordings leave its structure open: a mixture over delays and feedthrough.

Near-by delays explain a noisy log about as well, each with other poles and numerators. An interval for one of them is
too narrow: it takes for known what is not. So every structure that the recordings don't reject gets the weight that
Bayes's information criterion gives it, exp(−½ criterion), all delays being as likely before; what is said of the axis
is said by all of them together.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from archerfish.identification.axis.modal_form import Poles
from archerfish.identification.axis.pole_pairing import nearest_poles
from archerfish.identification.axis.structure_choice import Structure
from archerfish.identification.axis.uncertainty import Posterior, interval, posterior, standard_deviations

Array = NDArray[np.float64]

_NEGLIGIBLE = 0.01
"""Weight below which a structure is left out."""
_HALVINGS = 50


class OpenStructure(NamedTuple):
    """One structure that the recordings leave open."""

    delay: int
    """Input delay [samples]."""
    known: Posterior
    """Its parameters."""
    weight: float
    """How likely it is; all weights sum to one."""
    fitted: Structure
    """What was fitted."""


def weigh_structures(
    structures: Sequence[Structure], criteria: Sequence[float] | None = None
) -> tuple[OpenStructure, ...]:
    """Weigh structures by their criterion, the residuals' colour allowed for.

    Args:
      structures: each fitted to all lines; the first one gives the colour.
      criteria: of the structures, if they are known; the first one is then the one of the estimate.

    Returns:
      Those that are not negligible, the likeliest first: an estimate of another one might lie outside its own interval.
    """
    best = posterior(structures[0].problem, structures[0].refinement)
    values = np.array(criteria or [each.criterion(best.inflation) for each in structures])
    weights = np.exp(-0.5 * (values - values.min()))
    order = np.argsort(-weights, kind="stable").tolist()
    if criteria:
        order = [0, *(index for index in order if index)]
    kept = [index for index in order if weights[index] >= _NEGLIGIBLE * weights.sum()]
    weights /= weights[kept].sum()
    return tuple(
        OpenStructure(
            structures[index].delay,
            posterior(structures[index].problem, structures[index].refinement) if index else best,
            float(weights[index]),
            structures[index],
        )
        for index in kept
    )


def mixture_interval(
    structures: Sequence[OpenStructure], function: Callable[[Posterior], Array], level: float = 0.95
) -> tuple[Array, Array]:
    """Return the central interval of what is computed from the parameters, over all structures.

    Args:
      structures: weighed.
      function: of the parameters, to an array of any shape.
      level: probability between the two ends.
    """
    values = np.stack([function(each.known) for each in structures])
    deviations = np.stack([standard_deviations(each.known, function) for each in structures])
    if len(structures) == 1:
        return interval(values[0], deviations[0], level)
    weights = np.array([each.weight for each in structures]).reshape(-1, *[1] * (values.ndim - 1))
    tail = 0.5 - level / 2
    return _quantile(values, deviations, weights, tail), _quantile(values, deviations, weights, 1 - tail)


def _quantile(values: Array, deviations: Array, weights: Array, probability: float) -> Array:
    """Halve the interval that holds a quantile of normal mixtures, until it is as good as a point."""
    deviations = np.maximum(deviations, np.finfo(float).tiny)
    low, high = (values - 9 * deviations).min(axis=0), (values + 9 * deviations).max(axis=0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = np.sum(weights * ndtr((middle - values) / deviations), axis=0) < probability
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))


def mixture_deviations(
    poles: Sequence[Poles], deviations: Sequence[tuple[Array, Array]], weights: Sequence[float]
) -> tuple[Array, Array]:
    """Return the deviations of the real and imaginary parts of poles about those of the first structure.

    Args:
      poles: of each structure, shape (n,) each.
      deviations: of real and imaginary parts in each structure, shape (n,) each.
      weights: of the structures.
    """
    real, imaginary = np.zeros(poles[0].size), np.zeros(poles[0].size)
    for place, (real_sd, imaginary_sd), weight in zip(poles, deviations, weights, strict=True):
        nearest = nearest_poles(poles[0], place)
        moved = place[nearest] - poles[0]
        real += weight * (real_sd[nearest] ** 2 + moved.real**2)
        imaginary += weight * (imaginary_sd[nearest] ** 2 + moved.imag**2)
    return np.sqrt(real), np.sqrt(imaginary)


def shares(weights: Sequence[float], count: int) -> list[int]:
    """Deal out a number of draws by weight: whole numbers that sum to `count`, none further than one from its share."""
    ends = np.round(count * np.cumsum(weights)).astype(int)
    return [int(each) for each in np.diff(ends, prepend=0)]
