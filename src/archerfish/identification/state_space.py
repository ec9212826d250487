"""A plant record set in motion: its simulated response, its poles, and a well-scaled choice of its states."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from archerfish.identification.modal_form import Poles
from archerfish.identification.simulation_fit import delayed
from archerfish.records.plant import PlantRecord

Array = NDArray[np.float64]


def plant_poles(plant: PlantRecord) -> Poles:
    """Return the poles in the z plane, largest modulus first, shape (n,)."""
    poles = np.linalg.eigvals(plant.A).astype(np.complex128)
    return poles[np.lexsort((-poles.imag, -np.abs(poles).round(12)))]


def simulate(plant: PlantRecord, inputs: Array, initial_state: Array | None = None) -> Array:
    """Simulate the outputs from the inputs alone.

        x[t+1] = A x[t] + B u[t − delay],    y[t] = C x[t] + D u[t − delay]

    Args:
      plant: the plant.
      inputs: shape (N, m); before the first sample it is taken to have been held.
      initial_state: x[0], shape (n,); zero if not given.

    Returns:
      Outputs, shape (N, p).
    """
    driving = delayed(inputs, plant.delay_samples)
    pushes = driving @ plant.B.T
    states = np.empty((len(inputs), len(plant.A)))
    state = np.zeros(len(plant.A)) if initial_state is None else initial_state
    for index, push in enumerate(pushes):
        states[index] = state
        state = plant.A @ state + push
    return np.asarray(states @ plant.C.T + driving @ plant.D.T)


def free_responses(plant: PlantRecord, count: int) -> Array:
    """Return the outputs without input from each unit initial state, C Aᵗ, shape (count, p, n)."""
    response, power = plant.C[None], plant.A
    while len(response) < count:  # doubling: C Aᵗ for t < 2k is that for t < k and its product with Aᵏ
        response = np.concatenate([response, response @ power])
        power = power @ power
    return response[:count]


def balanced(plant: PlantRecord) -> PlantRecord:
    """Choose the states so that each is as easy to reach as to observe (Moore 1981); the responses stay the same.

    Identified plants come in observer form, whose entries are badly scaled for float32. A plant that is not minimal has
    no balanced form and is returned as it is.

    Args:
      plant: stable, without draws.
    """
    reach = _square_root(solve_discrete_lyapunov(plant.A, plant.B @ plant.B.T))
    observe = _square_root(solve_discrete_lyapunov(plant.A.T, plant.C.T @ plant.C))
    left, hankel_values, right = np.linalg.svd(observe.T @ reach)
    if hankel_values[-1] <= 1e-10 * hankel_values[0]:
        return plant
    weights = 1.0 / np.sqrt(hankel_values)
    into, out = weights[:, None] * (left.T @ observe.T), reach @ right.T * weights
    return replace(plant, A=into @ plant.A @ out, B=into @ plant.B, C=plant.C @ out)


def _square_root(gramian: Array) -> Array:
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
