"""Bands of what a plant record foretells, from its posterior draws: frequency and step responses, poles, steady gain.

Every band is the pointwise central 95 % of the draws. A record without draws has no bands.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.drawn_simulation import simulate_draws
from archerfish.identification.axis.pole_pairing import nearest_poles
from archerfish.identification.axis.state_space import free_responses, simulate
from archerfish.records.plant import PlantRecord

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

CONFIDENCE = 0.95
"""Share of the draws between the two sides of a band."""

_MOST_NUMBERS = 4_000_000
"""Outputs that are simulated: all draws of an ordinary recording, of a longer one as many as come to that."""
_FEWEST_DRAWS = 40
"""Draws of any recording, however long."""
_DEPENDENT = np.finfo(float).eps
"""Share of the largest that free responses must add to those before them."""


class Band(NamedTuple):
    """Lower and upper side of a band."""

    low: Array
    """Lower side, shape as the quantity."""
    high: Array
    """Upper side, shape as the quantity."""


def band(values: Array) -> Band:
    """Return the central 95 % of drawn values.

    Args:
      values: shape (k, …).
    """
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(values, [tail, 1 - tail], axis=0)
    return Band(low, high)


def drawn_responses(plant: PlantRecord, frequency_hz: Array) -> ComplexArray:
    """Return the frequency response of every draw, shape (k, F, p, m); k is 0 without draws.

    Args:
      plant: the plant.
      frequency_hz: frequencies [Hz], shape (F,).
    """
    if not plant.draws:
        return np.zeros((0, frequency_hz.size, *plant.D.shape), np.complex128)
    z = np.exp(2j * np.pi * frequency_hz * plant.sample_period_s)[:, None, None]
    A, B, C, D = (plant.draws[name][:, None] for name in ("A", "B", "C", "D"))
    resolvent = np.linalg.solve(z * np.eye(A.shape[-1]) - A, B.astype(np.complex128))
    return np.asarray((C @ resolvent + D) * z ** -plant.delays_of_draws()[:, None, None, None].astype(np.float64))


def drawn_outputs(plant: PlantRecord, inputs: Array) -> Array:
    """Return the simulated outputs of the draws from the zero state, shape (k, N, p); k is 0 without draws.

    So many draws are simulated that four million numbers come of it, and at least 40: all 100 of an axis on a recording
    of up to 40,000 samples.

    Args:
      plant: the plant.
      inputs: shape (N, m); before the first sample they are taken to have been held.
    """
    if not plant.draws:
        return np.zeros((0, len(inputs), len(plant.C)))
    return simulate_draws(plant, inputs, max(_FEWEST_DRAWS, _MOST_NUMBERS // len(inputs)))


def parameter_errors(plant: PlantRecord, inputs: Array, output: int = 0) -> Array:
    """Return what the uncertainty of the plant adds to the residual of a free run, shape (k, N); k may be 0.

    The outputs of the draws less those of the plant, and less what a free run's own choice of the initial state takes.

    Args:
      plant: the plant.
      inputs: shape (N, m).
      output: which output.
    """
    if not plant.draws:
        return np.zeros((0, len(inputs)))
    errors = drawn_outputs(plant, inputs)[..., output]
    errors -= simulate(plant, inputs)[:, output]
    free = _orthonormal(free_responses(plant, len(inputs))[:, output])
    for error in errors:  # one by one: all draws of a long recording are large enough once
        error -= free @ (free.T @ error)
    return np.asarray(errors)


def _orthonormal(columns: Array) -> Array:
    """Return orthonormal columns that span the given ones, shape (N, n); fewer where those are dependent."""
    _, values, right = np.linalg.svd(np.linalg.qr(columns, mode="r"))
    kept = values > _DEPENDENT * values.max()
    return np.linalg.qr(columns @ (right[kept].T / values[kept]))[0]


def drawn_poles(plant: PlantRecord, poles: ComplexArray) -> ComplexArray:
    """Return the poles of every draw, each in the place of the nearest of the plant's, shape (k, n); k may be 0.

    Args:
      plant: the plant.
      poles: its poles in the z plane, shape (n,).
    """
    if not plant.draws:
        return np.zeros((0, poles.size), np.complex128)
    drawn = np.linalg.eigvals(plant.draws["A"]).astype(np.complex128)
    return np.stack([each[nearest_poles(poles, each)] for each in drawn])


def drawn_dc_gains(plant: PlantRecord) -> Array:
    """Return the steady gain of every draw, C (I − A)⁻¹ B + D, shape (k, p, m); k is 0 without draws."""
    return drawn_responses(plant, np.zeros(1))[:, 0].real
