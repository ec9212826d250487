"""A plant record set in motion: its simulated response, its poles, and a well-scaled choice of its states."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from archerfish.identification.axis.modal_form import Poles
from archerfish.identification.axis.spectra import delayed
from archerfish.records.plant import PlantRecord

Array = NDArray[np.float64]

_BLOCK = 64


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
    channels = driving.shape[1]
    # Block by block, so that only the states at the blocks' beginnings follow one another in a Python loop.
    blocks = -(-len(driving) // _BLOCK)
    pushes = np.zeros((blocks * _BLOCK, channels))
    pushes[: len(driving)] = driving
    pushes = pushes.reshape(blocks, _BLOCK * channels)
    reach, observe, impulse = _block_matrices(plant)
    step = np.linalg.matrix_power(plant.A, _BLOCK)
    states = np.empty((blocks, len(plant.A)))
    state = np.zeros(len(plant.A)) if initial_state is None else initial_state
    for index, push in enumerate(pushes @ reach.T):
        states[index] = state
        state = step @ state + push
    outputs = states @ observe.T + pushes @ impulse.T
    return np.asarray(outputs.reshape(blocks * _BLOCK, -1)[: len(driving)])


def _block_matrices(plant: PlantRecord) -> tuple[Array, Array, Array]:
    """Return what takes a block's inputs to the state after it, its first state to its outputs, and inputs to outputs.

    Shapes (n, L m), (L p, n) and (L p, L m), samples one after another.
    """
    powers = [np.eye(len(plant.A))]
    for _ in range(_BLOCK - 1):
        powers.append(plant.A @ powers[-1])
    reach = np.hstack([power @ plant.B for power in reversed(powers)])
    observe = np.vstack([plant.C @ power for power in powers])
    outputs, inputs = plant.D.shape
    responses = np.concatenate([plant.D[None], np.reshape(observe @ plant.B, (_BLOCK, outputs, inputs))])
    impulse = np.zeros((_BLOCK, outputs, _BLOCK, inputs))
    for row in range(_BLOCK):
        impulse[row, :, : row + 1] = responses[row::-1].swapaxes(0, 1)
    return reach, observe, impulse.reshape(_BLOCK * outputs, _BLOCK * inputs)


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
    no balanced form and is returned as it is. Draws get the same change of states as the best estimate.

    Args:
      plant: stable.
    """
    reach = _square_root(solve_discrete_lyapunov(plant.A, plant.B @ plant.B.T))
    observe = _square_root(solve_discrete_lyapunov(plant.A.T, plant.C.T @ plant.C))
    left, hankel_values, right = np.linalg.svd(observe.T @ reach)
    if hankel_values[-1] <= 1e-10 * hankel_values[0]:
        return plant
    weights = 1.0 / np.sqrt(hankel_values)
    into, out = weights[:, None] * (left.T @ observe.T), reach @ right.T * weights
    draws = plant.draws
    if draws:
        draws = {"A": into @ draws["A"] @ out, "B": into @ draws["B"], "C": draws["C"] @ out, "D": draws["D"]}
    return replace(plant, A=into @ plant.A @ out, B=into @ plant.B, C=plant.C @ out, draws=draws)


def _square_root(gramian: Array) -> Array:
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
