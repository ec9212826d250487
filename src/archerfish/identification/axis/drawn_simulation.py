"""All posterior draws of a plant record set in motion at once: `state_space.simulate` for many plants abreast."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.plant import PlantRecord

Array = NDArray[np.float64]

_BLOCK = 32
"""Samples of a block: as many products for each sample, and a step of a Python loop for each block."""
_ABREAST = 64
"""Blocks whose products are formed together: what they need stays in the processor's cache."""


class _Blocks(NamedTuple):
    """What takes a block's inputs to the state after it, its first state to its outputs, and inputs to outputs."""

    step: Array
    """Shape (k, n, n)."""
    reach: Array
    """Shape (k, n, L m)."""
    observe: Array
    """Shape (k, L p, n)."""
    impulse: Array
    """Shape (k, L p, L m)."""


def simulate_draws(plant: PlantRecord, inputs: Array, count: int) -> Array:
    """Simulate the outputs of the first draws from the inputs alone, each from the zero state.

    Args:
      plant: with draws.
      inputs: shape (N, m); before the first sample they are taken to have been held.
      count: draws k.

    Returns:
      Outputs, shape (k, N, p).
    """
    blocks = _block_matrices(*(plant.draws[name][:count] for name in ("A", "B", "C", "D")))
    delays = plant.delays_of_draws()[:count]
    draws, outputs = len(delays), len(plant.C)
    simulated = np.empty((draws, len(inputs), outputs))
    state = np.zeros((draws, len(plant.A), 1))
    length = _BLOCK * _ABREAST
    for start in range(0, len(inputs), length):
        stop = min(start + length, len(inputs))
        height = -(-(stop - start) // _BLOCK)
        pushed, found = np.empty((draws, len(plant.A), height)), np.empty((draws, _BLOCK * outputs, height))
        for delay in np.unique(delays).tolist():
            own = delays == delay
            pushes = _pushes(inputs, start - delay, height)
            pushed[own], found[own] = blocks.reach[own] @ pushes, blocks.impulse[own] @ pushes
        states = np.empty_like(pushed)
        for index in range(height):
            states[..., index] = state[..., 0]
            state = blocks.step @ state + pushed[..., index, None]
        found += blocks.observe @ states
        simulated[:, start:stop] = found.swapaxes(1, 2).reshape(draws, -1, outputs)[:, : stop - start]
    return simulated


def _pushes(inputs: Array, first: int, blocks: int) -> Array:
    """Return the inputs of so many blocks from a sample on, a column each, shape (L m, blocks)."""
    samples = np.clip(np.arange(first, first + blocks * _BLOCK), 0, len(inputs) - 1)
    return inputs[samples].reshape(blocks, -1).T


def _block_matrices(A: Array, B: Array, C: Array, D: Array) -> _Blocks:
    (draws, order, inputs), outputs = B.shape, C.shape[1]
    powers = np.empty((_BLOCK + 1, draws, order, order))
    powers[0] = np.eye(order)
    for index in range(_BLOCK):
        powers[index + 1] = A @ powers[index]
    reach = (powers[_BLOCK - 1 :: -1] @ B).transpose(1, 2, 0, 3).reshape(draws, order, -1)
    observe = C @ powers[:_BLOCK]
    responses = np.concatenate([D[None], observe[:-1] @ B])
    impulse = np.zeros((draws, _BLOCK, outputs, _BLOCK, inputs))
    for row in range(_BLOCK):
        impulse[:, row, :, : row + 1] = responses[row::-1].transpose(1, 2, 0, 3)
    return _Blocks(
        powers[_BLOCK],
        reach,
        observe.swapaxes(0, 1).reshape(draws, -1, order),
        impulse.reshape(draws, _BLOCK * outputs, -1),
    )
