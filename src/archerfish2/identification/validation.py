"""How well a plant explains a log: a free run, which sees no measured output but for its initial state."""

from typing import NamedTuple

import numpy as np

from archerfish2.identification.simulation import Array, free_responses, simulate
from archerfish2.logs.recording import Values
from archerfish2.records.plant import PlantRecord


class FreeRun(NamedTuple):
    """Outputs that a plant gives under the inputs of a log."""

    outputs: Array  # simulated, (N, p)
    fit_percent: Array  # 100 (1 − |error| / |output less its mean|) of each output, (p,)
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
    fit = 100 * (1 - np.linalg.norm(left, axis=0) / np.linalg.norm(outputs - outputs.mean(0), axis=0))
    fitted = found[free.shape[1] :][:size] if offset is None else np.asarray(offset)
    return FreeRun(outputs - left, fit, fitted)
