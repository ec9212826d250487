"""A plant record set in motion: simulated outputs, free responses, and a balanced realisation."""

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgWarning, solve_discrete_lyapunov

from archerfish2.records.plant import PlantRecord

Array = NDArray[np.float64]
_BLOCK = 64


def simulate(plant: PlantRecord, inputs: Array, initial_state: Array | None = None) -> Array:
    """Simulate the outputs from the inputs alone, shape (N, p).

    Args:
      plant: the plant.
      inputs: shape (N, m); before the first sample they are taken to have been held.
      initial_state: of the plant, shape (n,); zero if not given.
    """
    n, m = plant.B.shape
    late = min(plant.delay_samples, len(inputs))
    u = np.concatenate([np.repeat(inputs[:1], late, axis=0), inputs[: len(inputs) - late]])
    # Block by block, so that only the states at the blocks' beginnings follow one another in a Python loop.
    blocks = -(-len(u) // _BLOCK)
    u = np.concatenate([u, np.zeros((blocks * _BLOCK - len(u), m))]).reshape(blocks, _BLOCK * m)
    observe = free_responses(plant, _BLOCK)
    markov = np.concatenate([plant.D[None], observe[:-1] @ plant.B])
    impulse = np.zeros((_BLOCK, len(plant.C), _BLOCK, m))
    for row in range(_BLOCK):
        impulse[row, :, : row + 1] = markov[row::-1].swapaxes(0, 1)
    powers = [plant.B]
    for _ in range(_BLOCK - 1):
        powers.append(plant.A @ powers[-1])
    into, step = u @ np.hstack(powers[::-1]).T, np.linalg.matrix_power(plant.A, _BLOCK)
    states = np.zeros((blocks, n))
    states[0] = 0.0 if initial_state is None else initial_state
    for block in range(blocks - 1):
        states[block + 1] = step @ states[block] + into[block]
    outputs = states @ observe.reshape(-1, n).T + u @ impulse.reshape(len(impulse) * len(plant.C), -1).T
    return np.asarray(outputs.reshape(blocks * _BLOCK, -1)[: len(inputs)])


def free_responses(plant: PlantRecord, count: int) -> Array:
    """Return the outputs without input from each unit initial state, C Aᵗ, shape (count, p, n)."""
    found, power = plant.C[None], plant.A
    while len(found) < count:  # by doubling: those of the next times are those found and a product with Aᵏ
        found, power = np.concatenate([found, found @ power]), power @ power
    return found[:count]


def balanced(plant: PlantRecord) -> PlantRecord:
    """Choose the states so that each is as easy to reach as to observe (Moore 1981); the responses stay the same.

    Companion forms are badly scaled for float32. A plant that is not minimal is returned as it is.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", LinAlgWarning)
        try:
            reach = _square_root(solve_discrete_lyapunov(plant.A, plant.B @ plant.B.T))
            observe = _square_root(solve_discrete_lyapunov(plant.A.T, plant.C.T @ plant.C))
        except (np.linalg.LinAlgError, LinAlgWarning):  # of poles on the unit circle, but for rounding
            return plant
    left, hankel, right = np.linalg.svd(observe.T @ reach)
    if hankel[-1] <= 1e-10 * hankel[0]:
        return plant
    into = (left / np.sqrt(hankel)).T @ observe.T
    out = reach @ right.T / np.sqrt(hankel)
    return plant.replace(A=into @ plant.A @ out, B=into @ plant.B, C=plant.C @ out)


def _square_root(gramian: Array) -> Array:
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
