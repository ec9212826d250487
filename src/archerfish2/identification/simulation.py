"""A plant record set in motion: simulated outputs and free responses."""

import math

import numpy as np
from numpy.typing import NDArray

from archerfish2.records.plant import PlantRecord

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def simulate(plant: PlantRecord, inputs: Array) -> Array:
    """Simulate the outputs from a zero state, shape (N, p).

    Args:
      plant: the plant.
      inputs: shape (N, m); before the first sample they are taken to have been held.
    """
    count, late = len(inputs), min(plant.delay_samples, len(inputs))
    u = np.concatenate([np.repeat(inputs[:1], late, axis=0), inputs[: count - late]])
    # In about √N blocks of √N samples: all blocks together from zero, the states between them, all of them from those.
    length = math.isqrt(count) + 1
    blocks = -(-count // length)
    drive = np.zeros((blocks, length, len(plant.A)))
    drive.reshape(blocks * length, -1)[:count] = u @ plant.B.T
    states, first, step = np.zeros_like(drive), np.zeros_like(drive[:, 0]), np.linalg.matrix_power(plant.A, length)
    last = first
    for sample in range(length):
        last = last @ plant.A.T + drive[:, sample]
    for block in range(1, blocks):
        first[block] = step @ first[block - 1] + last[block - 1]
    for sample in range(length):
        states[:, sample] = first
        first = first @ plant.A.T + drive[:, sample]
    return np.asarray(states.reshape(blocks * length, -1)[:count] @ plant.C.T + u @ plant.D.T)


def free_responses(plant: PlantRecord, count: int) -> Array:
    """Return the outputs without input from each unit initial state, C Aᵗ, shape (count, p, n)."""
    found, power = plant.C[None], plant.A
    while len(found) < count:  # by doubling: those of the next times are those found and a product with Aᵏ
        found, power = np.concatenate([found, found @ power]), power @ power
    return found[:count]
