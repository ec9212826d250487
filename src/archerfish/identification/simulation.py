"""Simulated outputs, free responses and the balanced realisation of a plant record."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from archerfish.logs.recording import Values
from archerfish.records.plant import PlantRecord

Array = NDArray[np.floating[Any]]
Complex = NDArray[np.complex128]
Delays = NDArray[np.int64]

TINY = 1e-300
"""Added to divisors that may be zero: less than the square of any signal."""
_LEAST_HANKEL_VALUE = 1e-10  # of the largest, below which a plant is not minimal


def matrices(plant: PlantRecord, *, draws: bool = False) -> tuple[Array, Array, Array, Array, Delays]:
    """Return A, B, C, D and the delay with a leading axis: of the plant alone, or of its k draws, where k may be 0."""
    alone = {name: getattr(plant, name)[None] for name in "ABCD"}
    if not draws:
        return alone["A"], alone["B"], alone["C"], alone["D"], np.array([plant.delay_samples])
    A, B, C, D = (plant.draws.get(name, matrix[:0]) for name, matrix in alone.items())
    return A, B, C, D, plant.delays_of_draws()


def simulate(plant: PlantRecord, inputs: Array, *, draws: bool = False) -> Array:
    """Simulate the outputs from a zero state, shape (N, p), or (k, N, p) of its draws.

    Args:
      plant: the plant.
      inputs: shape (N, m); before the first sample they are taken to have been held.
      draws: whether to simulate the k draws instead of the plant itself.
    """
    A, B, C, D, delays = matrices(plant, draws=draws)
    count = len(inputs)
    u = inputs[np.maximum(np.arange(count) - delays[:, None], 0)]
    states, power, span = np.zeros((len(A), count, A.shape[1])), A.swapaxes(1, 2), 1
    states[:, 1:] = u[:, :-1] @ B.swapaxes(1, 2)
    while span < count:  # by doubling: a state is what the last inputs drive, and Aᵏ times the state k samples before
        states[:, span:] += states[:, :-span] @ power
        power, span = power @ power, 2 * span
    found = states @ C.swapaxes(1, 2) + u @ D.swapaxes(1, 2)
    return np.asarray(found if draws else found[0])


def free_responses(plant: PlantRecord, count: int) -> Array:
    """Return the outputs without input from each unit initial state, C Aᵗ, shape (count, p, n)."""
    found, power = plant.C[None], plant.A
    while len(found) < count:  # by doubling: responses of the next k samples are those found, times Aᵏ
        found, power = np.concatenate([found, found @ power]), power @ power
    return found[:count]


def balanced(plant: PlantRecord) -> PlantRecord:
    """Return the realisation whose states are each as easy to reach as to observe (Moore 1981).

    The Gramians of controllability and observability become one diagonal matrix, for each draw its own; the transfer
    function stays the same. A plant or draw that is not minimal has no balanced realisation and stays as it is.

    Args:
      plant: stable.
    """
    A, B, C, D, _ = matrices(plant, draws=True)
    own = _balanced(plant.A, plant.B, plant.C)
    drawn = [_balanced(*matrices_of_draw) for matrices_of_draw in zip(A, B, C, strict=True)]
    draws = {name: np.stack(stack) for name, stack in zip("ABC", zip(*drawn, strict=True), strict=False)}
    return plant.replace(A=own[0], B=own[1], C=own[2], draws=draws | {"D": D} if draws else {})


def _balanced(A: Array, B: Array, C: Array) -> tuple[Array, Array, Array]:
    reach, observe = (_square_root(solve_discrete_lyapunov(a, b @ b.T)) for a, b in ((A, B), (A.T, C.T)))
    left, hankel_values, right = np.linalg.svd(observe.T @ reach)
    if hankel_values[-1] <= _LEAST_HANKEL_VALUE * hankel_values[0]:
        return A, B, C
    weights = 1 / np.sqrt(hankel_values)
    into, out = weights[:, None] * (left.T @ observe.T), reach @ right.T * weights
    return into @ A @ out, into @ B, C @ out


def _square_root(gramian: Array) -> Array:
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def fit_percent(measured: Values, simulated: Array) -> Array:
    """Return 100 (1 − |measured − simulated| / |measured less its mean|) of each output, shape (p,).

    Args:
      measured: outputs, shape (N, p), none of them constant.
      simulated: of the same shape.
    """
    error = np.linalg.norm(measured - simulated, axis=0)
    return np.asarray(100 * (1 - error / np.linalg.norm(measured - measured.mean(0), axis=0)))


def first_motion(inputs: Values) -> int:
    """Return the first sample at which any input, shape (N, m), differs from its first value; 0 if none does."""
    return int(np.argmax(np.any(inputs != inputs[0], axis=1)))


class FreeRun(NamedTuple):
    """Outputs that a plant gives under the inputs of a log."""

    outputs: Array  # simulated, (N, p)
    fit_percent: Array  # of each output, (p,)
    offset: Array  # constant of each output, (p,)


def free_run(
    plant: PlantRecord, inputs: Values, outputs: Values, offset: Array | None = None, *, drift: bool = False
) -> FreeRun:
    """Simulate a log from the initial state that fits it best.

    Args:
      plant: the plant.
      inputs: shape (N, m).
      outputs: measured, shape (N, p), none of them constant.
      offset: constant of each output, shape (p,); fitted too if not given.
      drift: whether the outputs drift, by a polynomial of third degree that is fitted too.
    """
    samples, size = outputs.shape
    driven = simulate(plant, np.asarray(inputs, dtype=np.float64)) + (0.0 if offset is None else offset)
    free = free_responses(plant, samples).reshape(samples * size, -1)
    powers = [0, 1, 2, 3] if drift else [0]
    time = np.linspace(-1, 1, samples)[:, None] ** (powers if offset is None else powers[1:])
    columns = np.hstack([free, np.kron(time, np.eye(size))])
    weight = np.tile(1 / outputs.std(0), samples)  # outputs may have different units
    error = (outputs - driven).reshape(-1)
    found = np.linalg.lstsq(weight[:, None] * columns, weight * error, rcond=None)[0]
    left = (error - columns @ found).reshape(samples, size)
    fitted = found[free.shape[1] :][:size] if offset is None else np.asarray(offset)
    simulated = outputs - left
    return FreeRun(simulated, fit_percent(outputs, simulated), fitted)
