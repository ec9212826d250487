"""How well a plant foretells a recording from its inputs alone."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, lstsq

from archerfish.identification.axis.state_space import free_responses, simulate
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import Recording

Array = NDArray[np.float64]


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
    free = np.concatenate([free_responses(plant, len(recording)), _drift(recording, drift)], axis=2)
    weights = _weights([recording])
    rest = (recording.outputs - forced) * weights
    initial = lstsq((free * weights[:, None]).reshape(-1, free.shape[2]), rest.reshape(-1))[0]
    simulated = forced + free @ initial
    return FreeRun(simulated, recording.outputs - simulated, fit_percent(recording.outputs, simulated))


def _drift(recording: Recording, degree: int) -> Array:
    """Return the powers of time of each output, shape (N, p, p degree); of no mean, so that none is an offset."""
    time = np.linspace(-1, 1, len(recording))[:, None] ** np.arange(1, degree + 1)
    outputs = recording.outputs.shape[1]
    columns = (time - time.mean(axis=0))[:, None, None, :] * np.eye(outputs)[None, :, :, None]
    return np.asarray(columns.reshape(len(recording), outputs, outputs * degree))


def common_offset(plant: PlantRecord, recordings: Sequence[Recording], *, drift: int = 0) -> Array:
    """Estimate the constant between simulated and measured outputs that all recordings share, shape (p,).

    Each recording has its own initial state; a recording that says little about the constant (one that drifts, or
    never rests) gets little weight by the least squares itself.
    """
    outputs = len(plant.C)
    weights = _weights(recordings)
    responses = [
        np.concatenate([free_responses(plant, len(each)), _drift(each, drift)], axis=2) * weights[:, None]
        for each in recordings
    ]
    free = block_diag(*(each.reshape(-1, each.shape[2]) for each in responses))
    rest = np.concatenate(
        [((each.outputs - simulate(plant, each.inputs)) * weights).reshape(-1) for each in recordings]
    )
    constants = np.tile(np.diag(weights), (len(rest) // outputs, 1))
    return np.asarray(lstsq(np.hstack([constants, free]), rest)[0][:outputs])


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
