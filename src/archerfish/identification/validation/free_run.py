"""How well a plant foretells a recording from its inputs alone."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq

from archerfish.identification.axis.state_space import free_responses, simulate
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_PIECE = 8192
"""Rows that are factorised at a time."""


class FreeRun(NamedTuple):
    """A recording beside its simulation."""

    simulated: Array
    """Simulated outputs, shape (N, p)."""
    residual: Array
    """Measured less simulated outputs, shape (N, p)."""
    fit_percent: Array
    """Fit of each output [%], shape (p,)."""


def fit_percent(measured: Array, simulated: Array) -> Array:
    """Return 100 (1 − ‖y − ŷ‖ / ‖y − mean y‖) of each output [%]: 100 is perfect, 0 is no better than the mean.

    Args:
      measured: shape (N, p).
      simulated: shape (N, p).

    Returns:
      Fit [%], shape (p,).

    Raises:
      InputError: if an output is constant, so that no fit is defined.
    """
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    if np.any(spread == 0):
        raise InputError("fit_percent: a measured output is constant; validate with a log in which the axis moves")
    return np.asarray(100 * (1 - np.linalg.norm(measured - simulated, axis=0) / spread))


def free_run(plant: PlantRecord, recording: Recording, offset: Array | float = 0.0, *, drift: int = 0) -> FreeRun:
    """Simulate a recording from its inputs; only the initial state is fitted to it, by least squares.

    Args:
      plant: the plant.
      recording: inputs and outputs of the plant.
      offset: constant that is added to the simulated outputs, from the training recordings, shape (p,) or ().
      drift: highest power of time that the outputs drift with by themselves, and that is fitted too.

    Raises:
      InputError: if the recording has another number of inputs or outputs, or another sampling period.
    """
    check_agreement(plant, recording)
    forced = simulate(plant, recording.inputs) + offset
    free = _free_parts(plant, recording, drift)
    weights = _weights([recording])
    triangle = _factor(_rows(free, recording.outputs - forced, weights))
    return _completed(recording, forced, free, lstsq(triangle[:, :-1], triangle[:, -1])[0])


def own_zero_run(plant: PlantRecord, recording: Recording, *, drift: int = 0) -> tuple[Array, FreeRun]:
    """Simulate a recording from its inputs; the initial state and a zero of its own are fitted together.

    The same as `free_run` with the offset that `common_offset` finds of this recording alone, simulated once.

    Args:
      plant: the plant.
      recording: inputs and outputs of the plant.
      drift: as in `free_run`.

    Returns:
      The recording's zero, shape (p,), and its run.

    Raises:
      InputError: if the recording has another number of inputs or outputs, or another sampling period.
    """
    check_agreement(plant, recording)
    forced = simulate(plant, recording.inputs)
    free = _free_parts(plant, recording, drift)
    weights, outputs = _weights([recording]), len(plant.C)
    triangle = _factor(_rows(free, recording.outputs - forced, weights, constants=True))
    found = lstsq(triangle[:, :-1], triangle[:, -1])[0]
    return found[:outputs], _completed(recording, forced + found[:outputs], free, found[outputs:])


def _free_parts(plant: PlantRecord, recording: Recording, drift: int) -> Array:
    """Return what is fitted to the outputs: responses to initial states, then drifts of no mean, shape (N, p, k)."""
    responses = free_responses(plant, len(recording))
    if not drift:
        return responses
    outputs = len(plant.C)
    time = np.linspace(-1, 1, len(recording))[:, None] ** np.arange(1, drift + 1)
    powers = (time - time.mean(axis=0))[:, None, None, :] * np.eye(outputs)[None, :, :, None]
    return np.concatenate([responses, powers.reshape(len(recording), outputs, -1)], axis=2)


def common_offset(plant: PlantRecord, recordings: Sequence[Recording], *, drift: int = 0) -> Array:
    """Estimate the constant between simulated and measured outputs that all recordings share, shape (p,).

    Each recording has its own initial state; a recording that says little about the constant (one that drifts, or
    never rests) gets little weight by the least squares itself.
    """
    outputs, order = len(plant.C), len(plant.A) + len(plant.C) * drift
    weights = _weights(recordings)
    # Of each recording no more is needed than the factor of its equations: their number does not grow with its length.
    height = outputs + order + 1
    design, rest = np.zeros((len(recordings) * height, outputs + len(recordings) * order)), []
    for index, each in enumerate(recordings):
        free = _free_parts(plant, each, drift)
        triangle = _factor(_rows(free, each.outputs - simulate(plant, each.inputs), weights, constants=True))
        rows = slice(index * height, index * height + len(triangle))
        design[rows, :outputs] = triangle[:, :outputs]
        design[rows, outputs + index * order : outputs + (index + 1) * order] = triangle[:, outputs:-1]
        rest.append(np.append(triangle[:, -1], np.zeros(height - len(triangle))))
    return np.asarray(lstsq(design, np.concatenate(rest))[0][:outputs])


def _rows(free: Array, rest: Array, weights: Array, *, constants: bool = False) -> Iterator[Array]:
    """Yield the equations for [constants,] initial state and what they are to explain, some thousand rows at a time.

    Args:
      free: shape (N, p, n).
      rest: shape (N, p).
      weights: of the outputs, shape (p,).
      constants: whether each output has a constant of its own.

    Yields:
      Shape (R, [p +] n + 1).
    """
    length = max(1, _PIECE // weights.size)
    for start in range(0, len(free), length):
        part = slice(start, start + length)
        columns = np.dstack([free[part], rest[part, :, None]]) * weights[:, None]
        if constants:
            own = np.broadcast_to(np.diag(weights), (len(columns), weights.size, weights.size))
            columns = np.dstack([own, columns])
        yield columns.reshape(-1, columns.shape[2])


def _factor(pieces: Iterator[Array]) -> Array:
    """Return R of the QR factorisation of all rows: least squares on R are those on the rows."""
    triangle = np.asarray(np.linalg.qr(next(pieces), mode="r"))
    for piece in pieces:
        triangle = np.asarray(np.linalg.qr(np.concatenate([triangle, piece]), mode="r"))
    return triangle


def _completed(recording: Recording, forced: Array, free: Array, initial: Array) -> FreeRun:
    simulated = forced + free @ initial
    return FreeRun(simulated, recording.outputs - simulated, fit_percent(recording.outputs, simulated))


def _weights(recordings: Sequence[Recording]) -> Array:
    """One over the deviation of each output, so that their units don't matter beside one another, shape (p,)."""
    spread = np.concatenate([each.outputs - each.outputs.mean(axis=0) for each in recordings]).std(axis=0)
    return np.asarray(1.0 / np.where(spread > 0, spread, 1.0))


def check_agreement(plant: PlantRecord, recording: Recording) -> None:
    """Raise InputError if a recording's signals or sampling period don't fit the plant."""
    source = recording.source or "recording"
    for name, found, expected in (
        ("inputs", recording.inputs.shape[1], plant.B.shape[1]),
        ("outputs", recording.outputs.shape[1], plant.C.shape[0]),
    ):
        if found != expected:
            raise InputError(f"{source}: has {found} {name}, the plant has {expected}; name the plant's columns")
    if abs(recording.sample_period_s / plant.sample_period_s - 1) > 0.01:
        raise InputError(
            f"{source}: is sampled every {recording.sample_period_s:g} s, the plant every {plant.sample_period_s:g} s; "
            "resample the log to the plant's sampling period"
        )
