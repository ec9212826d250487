"""First guesses of the poles: by subspace (MOESP, two horizons) and by ARX models, reduced by realising their response.

Prediction least squares weighs the errors wrongly for simulation, and a realisation the numerators: only the poles are
taken from them.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import hankel, lstsq, svd
from scipy.linalg.lapack import dtbtrs

from archerfish.identification.axis.lag_factor import LagFactor
from archerfish.identification.axis.modal_form import Poles

Array = NDArray[np.float64]

_ARX_ORDERS = (8, 16, 30)
_RESPONSE_HORIZONS = (20, 60)
_RANK_TOLERANCE = 1e-9


class ArxModel(NamedTuple):
    """Coefficients of y[t] + a₁ y[t−1] + … = b₀ u[t] + b₁ u[t−1] + …, one output."""

    a: Array
    """Denominator with its leading 1, shape (k + 1,)."""
    b: Array
    """Numerators, shape (m, k + 1)."""


def fit_arx(factor: LagFactor, order: int, output: int = 0) -> ArxModel:
    """Fit an ARX model by least squares, with a constant for each recording.

    Args:
      factor: of the recordings, with at least `order` lags.
      order: lags k of input and output.
      output: which output.
    """
    own = factor.output(range(order + 1))[:, output :: factor.outputs]
    regressors = np.hstack([-own[:, 1:], factor.input(range(order + 1))])
    # The pivoted QR driver: lags of a sweep are nearly collinear, and normal equations would lose the poles.
    solution = lstsq(regressors, own[:, 0], lapack_driver="gelsy")[0]
    return ArxModel(np.append(1.0, solution[:order]), solution[order:].reshape(order + 1, factor.inputs).T)


def impulse_response(model: ArxModel, length: int) -> Array:
    """Return the response to a unit impulse in each input, shape (length, m)."""
    numerators = np.zeros((length, len(model.b)))
    taps = min(length, model.b.shape[1])
    numerators[:taps] = model.b[:, :taps].T
    # The recursion a ∗ h = b as the forward substitution of a banded triangular system.
    bands = np.repeat(model.a[:length, None], length, axis=1)
    return np.asarray(dtbtrs(bands, numerators, uplo="L")[0])


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
    return _shift_poles(left[:, :order] * np.sqrt(values[:order]), 1)


def subspace_poles(factor: LagFactor, order: int, horizon: int, delay: int) -> Poles:
    """Find the poles by past-output MOESP (Verhaegen 1994): what the past says of the future beyond its inputs.

    Args:
      factor: of the recordings.
      order: number of poles n, below horizon · p.
      horizon: future samples; the past has the lags that are left.
      delay: input delay [samples].

    Returns:
      Poles, not necessarily stable, shape (n,).
    """
    future, past = range(horizon - 1, -1, -1), range(horizon, factor.lags + 1)
    inputs = factor.input([lag + delay for lag in future if lag + delay <= factor.lags])
    known = np.hstack([factor.output(past), factor.input([lag for lag in past if lag + delay <= factor.lags])])
    basis = np.linalg.qr(inputs)[0]
    known, unknown = (each - basis @ (basis.T @ each) for each in (known, factor.output(future)))
    foretold = known @ np.linalg.lstsq(known, unknown, rcond=_RANK_TOLERANCE)[0]
    _, values, right = svd(foretold, full_matrices=False)
    return _shift_poles(right[:order].T * np.sqrt(values[:order]), factor.outputs)


def _shift_poles(observability: Array, outputs: int) -> Poles:
    """Poles from the shift structure of an observability matrix, block rows of `outputs` rows."""
    A = np.linalg.lstsq(observability[:-outputs], observability[outputs:], rcond=None)[0]
    return np.linalg.eigvals(A).astype(np.complex128)


def initial_poles(factor: LagFactor, order: int, delays: Sequence[int]) -> Iterator[tuple[int, Poles]]:
    """Yield first guesses of the poles, each with the delay that it was made for.

    Args:
      factor: of the recordings.
      order: number of poles.
      delays: input delays to try, 0 among them [samples].
    """
    models = [
        fit_arx(factor, each, output)
        for output in range(factor.outputs)
        for each in dict.fromkeys((order, *_ARX_ORDERS))
        if order <= each <= factor.lags
    ]
    length = max(delays) + 1 + 2 * max(_RESPONSE_HORIZONS)
    responses = [impulse_response(model, length) for model in models]
    usable = [each for each in responses if np.all(np.isfinite(each)) and np.abs(each).max() < 1e9]
    for model in models:
        if len(model.a) == order + 1:
            yield 0, np.roots(model.a).astype(np.complex128)
    for delay in delays:
        for horizon in dict.fromkeys((factor.lags // 2, factor.lags // 4)):
            if order < horizon * factor.outputs - 1 and order < factor.lags - horizon - delay:
                yield delay, subspace_poles(factor, order, horizon, delay)
        for response in usable if delay == 0 else usable[:1]:
            for horizon in _RESPONSE_HORIZONS if delay == 0 else _RESPONSE_HORIZONS[:1]:
                if horizon > 2 * order:
                    yield delay, realised_poles(response[delay + 1 : delay + 1 + 2 * horizon], order)
