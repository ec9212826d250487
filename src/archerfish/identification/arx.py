"""First guesses of the poles: high-order ARX models by least squares, reduced by realising their impulse responses.

    y[t] + a₁ y[t−1] + … = b₀ u[t] + b₁ u[t−1] + … + constant of the recording

Prediction least squares weighs the errors wrongly for simulation, so only the poles are taken from it.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import hankel, lstsq, svd
from scipy.signal import lfilter

from archerfish.identification.modal_form import Poles
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_ORDERS = (8, 20, 50)
_HORIZONS = (20, 60, 150)


class ArxModel(NamedTuple):
    """Coefficients of an ARX model with one output."""

    a: Array
    """Denominator with its leading 1, shape (k + 1,)."""
    b: Array
    """Numerators, shape (m, k + 1)."""


def fit_arx(recordings: Sequence[Recording], order: int) -> ArxModel:
    """Fit one ARX model to several recordings by least squares, with a constant for each recording.

    Args:
      recordings: m inputs and one output each, more than `order` samples long.
      order: lags k of input and output.
    """
    inputs = recordings[0].inputs.shape[1]
    rows = [_regressors(recording, order) for recording in recordings]
    constants = np.repeat(np.eye(len(rows)), [len(row) for row in rows], axis=0)
    target = np.concatenate([recording.outputs[order:, 0] for recording in recordings])
    # The pivoted QR driver: lags of a sweep are nearly collinear, and normal equations would lose the poles.
    solution = lstsq(np.hstack([np.vstack(rows), constants]), target, lapack_driver="gelsy")[0]
    b = solution[order : order + inputs * (order + 1)].reshape(inputs, order + 1)
    return ArxModel(np.append(1.0, solution[:order]), b)


def _regressors(recording: Recording, order: int) -> Array:
    count = len(recording)
    past = [-recording.outputs[order - lag : count - lag, 0] for lag in range(1, order + 1)]
    signals = recording.inputs.T
    driven = [signal[order - lag : count - lag] for signal in signals for lag in range(order + 1)]
    return np.column_stack([*past, *driven])


def impulse_response(model: ArxModel, length: int) -> Array:
    """Return the response to a unit impulse in each input, shape (length, m)."""
    impulse = np.zeros(length)
    impulse[0] = 1.0
    return np.column_stack([lfilter(numerator, model.a, impulse) for numerator in model.b])


def realised_poles(response: Array, order: int) -> Poles:
    """Find the poles of the best low-order realisation of an impulse response (Ho and Kalman; Kung).

    Args:
      response: impulse response from the first sample after the delay on, shape (L, m).
      order: number of poles n, below L / 2.

    Returns:
      Poles, not necessarily stable, shape (n,).
    """
    rows = (len(response) + 1) // 2
    blocks = [hankel(column[:rows], column[rows - 1 :]) for column in response.T]
    left, values, _ = svd(np.hstack(blocks), full_matrices=False)
    observability = left[:, :order] * np.sqrt(values[:order])
    poles = np.linalg.eigvals(lstsq(observability[:-1], observability[1:])[0])
    return poles.astype(np.complex128)


def impulse_responses(recordings: Sequence[Recording], order: int, longest: int) -> list[Array]:
    """Estimate the impulse response by ARX models of several orders, as far as the recordings are long enough for them.

    Args:
      recordings: m inputs and one output each.
      order: order of the plant that is sought, the lowest order tried.
      longest: number of samples to return.

    Returns:
      Impulse responses, each of shape (longest, m); those of unstable models that run away are left out.
    """
    shortest = min(len(recording) for recording in recordings)
    samples = sum(len(recording) for recording in recordings)
    lags = 1 + recordings[0].inputs.shape[1]
    fitting = [each for each in _ORDERS if each > order and 3 * lags * each < samples and 2 * each < shortest]
    responses = [impulse_response(fit_arx(recordings, each), longest) for each in (order, *fitting)]
    return [response for response in responses if np.all(np.isfinite(response)) and np.abs(response).max() < 1e9]


def initial_poles(responses: Sequence[Array], order: int, delay: int) -> Iterator[Poles]:
    """Yield first guesses of the poles of a plant, from impulse responses seen over several horizons.

    Args:
      responses: impulse responses from the time of the impulse on, each of shape (L, m).
      order: number of poles.
      delay: samples before the plant can respond.
    """
    for response in responses:
        for horizon in _HORIZONS:
            if horizon > 2 * order and delay + 1 + 2 * horizon <= len(response):
                yield realised_poles(response[delay + 1 : delay + 1 + 2 * horizon], order)


def response_length(max_delay: int) -> int:
    """Return how many samples of the impulse response `initial_poles` needs for delays up to `max_delay`."""
    return max_delay + 1 + 2 * max(_HORIZONS)
