"""What is linear once the poles are known: B, D, initial states and offsets by simulation least squares.

With A and C in the observer form of `modal_form` the simulated output of a recording is

    y = Σ_sections (b₁ z⁻¹ + b₂ z⁻²) / (1 + a₁ z⁻¹ + a₂ z⁻²) u + D u  +  response to x₀ + offset,

B and D shared by all recordings, x₀ and the offset each recording's own. The own columns are projected out recording
by recording, so that the cost grows with the number of samples and not with the square of the number of recordings.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular
from scipy.signal import lfilter

from archerfish.identification.modal_form import Sections, section_offsets
from archerfish.records.recording import Recording

Array = NDArray[np.float64]


class Structure(NamedTuple):
    """What is decided before anything is estimated."""

    delay: int
    """Input delay [samples]."""
    feedthrough: bool
    """Whether D is estimated; it is zero otherwise."""


class LinearFit(NamedTuple):
    """Least-squares estimate for given poles, and what a search over the poles needs."""

    B: Array
    """Input matrix in observer form, shape (n, m)."""
    D: Array
    """Feedthrough, shape (1, m)."""
    offsets: Array
    """Offset of each recording, shape (K,)."""
    residuals: Array
    """Measured less simulated output of all recordings, shape (sum of N,)."""
    slopes: Array
    """∂(simulated output)/∂(section coefficients), projected off all linear parameters, shape (sum of N, n)."""

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residuals @ self.residuals)


class _Span(NamedTuple):
    """Orthonormal basis of the columns of a matrix, blind to directions that rounding alone tells apart."""

    basis: Array
    recover: Array

    def coefficients(self, target: Array) -> Array:
        return np.asarray(self.recover @ (self.basis.T @ target))

    def remove(self, signals: Array) -> Array:
        return np.asarray(signals - self.basis @ (self.basis.T @ signals))


def delayed(inputs: Array, delay: int) -> Array:
    """Shift inputs, shape (N, m), by `delay` samples; before a recording its first input is taken to have been held."""
    return inputs if delay == 0 else np.vstack([np.repeat(inputs[:1], delay, axis=0), inputs[:-delay]])


def fit_linear_parameters(
    sections: Sections, recordings: Sequence[Recording], structure: Structure, *, with_slopes: bool = True
) -> LinearFit:
    """Estimate everything but the poles by least squares on the simulated output.

    Args:
      sections: the poles, as stable sections.
      recordings: m inputs and one output each.
      structure: delay and feedthrough.
      with_slopes: whether `slopes` are wanted; left empty otherwise, for speed.
    """
    order = sum(section.size for section in sections)
    inputs = recordings[0].inputs.shape[1]
    driven = [_driven_columns(sections, recording, structure) for recording in recordings]
    own = [_own_columns(sections, len(recording)) for recording in recordings]
    spans = [_span(columns) for columns in own]
    targets = [recording.outputs[:, 0] for recording in recordings]
    shared = _span(np.vstack([span.remove(columns) for span, columns in zip(spans, driven, strict=True)]))
    target = np.concatenate([span.remove(signal) for span, signal in zip(spans, targets, strict=True)])
    common = shared.coefficients(target)
    local = [
        span.coefficients(signal - columns @ common)
        for span, signal, columns in zip(spans, targets, driven, strict=True)
    ]
    slopes = np.empty((0, order))
    if with_slopes:
        raw = [
            span.remove(_section_slopes(sections, columns, common, free, values))
            for span, columns, free, values in zip(spans, driven, own, local, strict=True)
        ]
        slopes = shared.remove(np.vstack(raw))
    B = common[: order * inputs].reshape(order, inputs)
    D = common[order * inputs :].reshape(1, inputs) if structure.feedthrough else np.zeros((1, inputs))
    return LinearFit(B, D, np.array([values[-1] for values in local]), shared.remove(target), slopes)


def _driven_columns(sections: Sections, recording: Recording, structure: Structure) -> Array:
    """Responses to each input through each entry of B (row by row), then the inputs themselves for D."""
    inputs = delayed(recording.inputs, structure.delay)
    columns = [
        _shifted(lfilter([1.0], [1.0, *section], inputs, axis=0), lag)
        for section in sections
        for lag in range(1, section.size + 1)
    ]
    return np.hstack([*columns, inputs] if structure.feedthrough else columns)


def _own_columns(sections: Sections, count: int) -> Array:
    """Responses to each initial state, then a constant."""
    impulse = np.zeros((count, 1))
    impulse[0] = 1.0
    columns = [
        _shifted(lfilter([1.0], [1.0, *section], impulse, axis=0), lag)
        for section in sections
        for lag in range(section.size)
    ]
    return np.hstack([*columns, np.ones((count, 1))])


def _section_slopes(sections: Sections, driven: Array, common: Array, own: Array, local: Array) -> Array:
    """Differentiate one recording's simulated output by every aᵢ: −z⁻ⁱ s / a(z) for a section's output s."""
    order = sum(section.size for section in sections)
    inputs = common.size // order
    slopes = np.empty((len(driven), order))
    for start, section in section_offsets(sections):
        stop = start + section.size
        entries = slice(start * inputs, stop * inputs)
        output = driven[:, entries] @ common[entries] + own[:, start:stop] @ local[start:stop]
        filtered = lfilter([1.0], [1.0, *section], output)
        for lag in range(1, section.size + 1):
            slopes[:, start + lag - 1] = -_shifted(filtered, lag)
    return slopes


def _shifted(signal: Array, lag: int) -> Array:
    shifted = np.zeros_like(signal)
    shifted[lag:] = signal[: len(signal) - lag]
    return shifted


def _span(columns: Array) -> _Span:
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    basis, triangle, pivot = qr(columns / scale, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    # Poles close to one another give columns that differ by rounding only; such directions are left at zero.
    rank = int(np.count_nonzero(size > 1e-11 * size[0]))
    recover = np.zeros((columns.shape[1], rank))
    recover[pivot[:rank]] = solve_triangular(triangle[:rank, :rank], np.eye(rank))
    return _Span(basis[:, :rank], recover / scale[:, None])
