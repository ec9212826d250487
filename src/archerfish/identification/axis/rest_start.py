"""Recordings that begin at rest: their initial state is known, and no parameter.

A step log that starts at rest holds one transient, the response itself. With a free initial state a slow mode can
explain that transient without any input, so that the steady gain may come out at anything. From rest the transient of
`spectra` follows from the inputs: for the section 1 / (1 + a₁ z⁻¹ + a₂ z⁻²) in observer form, driven through b₁ or b₂
alone from the zero state, it is minus the state after the last sample,

    b₁: −(w[N−1], −a₂ w[N−2]),    b₂: −(w[N−2], −a₂ w[N−3] + u[N−1]),    w = u / (1 + a₁ z⁻¹ + a₂ z⁻²).

The response's derivative by a₁ and a₂ is minus the section's own output filtered once more, with the same transient.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.modal_form import Sections, section_offsets, section_poles
from archerfish.identification.axis.recursive_filter import recursion
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_FEWEST = 2
"""Samples of constant input that a rest has at least."""
_EQUAL = 1e-9
"""Share of an input's range up to which it counts as constant."""
_HELD = 0.5
"""Share of the samples at which the inputs keep their values, from which they are steps."""
_TRIFLE = 0.01
"""Share of an output's range up to which a change of it at rest is none."""
_BEYOND_NOISE = 6.0
"""Standard errors up to which a change of an output at rest may be noise, coloured noise included."""
_QUIET = 0.3
"""Share of an output's deviation that it may have at rest."""
_LATEST = 5
"""Last samples of the filtered inputs that a transient and its derivative are made of."""
_FORGOTTEN = 28.0
"""Natural logarithm of what a section has forgotten of inputs so far back that they no longer matter."""


class RestStart(NamedTuple):
    """What an experiment did from its rest on."""

    inputs: Array
    """Inputs less what they were at rest, from the beginning, without those that a delay moves out; shape (K, m)."""
    unit: float
    """Factor of the transform's scale."""


class SectionEnd(NamedTuple):
    """The last samples of what a section makes of the inputs, the latest first."""

    once: Array
    """Inputs filtered by 1 / (1 + …), shape (5, m)."""
    twice: Array
    """Filtered twice, shape (5, m)."""
    last: Array
    """Last input, shape (m,)."""


def rest_samples(recording: Recording) -> int:
    """Return how many samples at the beginning of a recording show its axis at rest; 0 if none do.

    The inputs are constant there, and no output changes by more than its noise.
    """
    moving = np.abs(recording.inputs - recording.inputs[0]) > _EQUAL * np.ptp(recording.inputs, axis=0)
    count = int(np.argmax(moving.any(axis=1)))
    if count < _FEWEST:
        return 0
    resting = all(_is_still(signal[:count], signal) for signal in recording.outputs.T)
    return count if resting else 0


def begins_at_rest(recording: Recording) -> bool:
    """Tell whether a recording is one of steps from rest, whose few transients its initial state must not explain.

    Where the inputs keep moving, the initial state is one transient of many, and better left free: what is nonlinear
    between rest and motion would bend the whole fit otherwise.
    """
    still = np.all(np.abs(np.diff(recording.inputs, axis=0)) <= _EQUAL * np.ptp(recording.inputs, axis=0), axis=1)
    return float(np.mean(still)) > _HELD and rest_samples(recording) > 0


def _is_still(start: Array, whole: Array) -> bool:
    third = max(1, start.size // 3)
    change = abs(float(start[-third:].mean() - start[:third].mean()))
    noise = float(np.std(np.diff(start))) / np.sqrt(2) if start.size > 2 else 0.0
    small = change <= max(_TRIFLE * float(np.ptp(whole)), _BEYOND_NOISE * noise * np.sqrt(2 / third))
    return small and float(start.std()) <= _QUIET * float(whole.std())


def section_ends(sections: Sections, start: RestStart) -> list[SectionEnd]:
    """Filter the inputs of an experiment by every section, as far back as it remembers."""
    ends = []
    for section in sections:
        decay = -np.log(max(float(np.abs(section_poles((section,))).max()), 1e-12))
        reach = min(len(start.inputs), int(_FORGOTTEN / max(decay, 1e-12)) + 2 * _LATEST)
        recent = start.inputs[len(start.inputs) - reach :]
        once = recursion(section, recent)
        twice = recursion(section, once)
        ends.append(SectionEnd(_latest(once), _latest(twice), recent[-1] if reach else np.zeros(recent.shape[1])))
    return ends


def _latest(signal: Array) -> Array:
    padded = np.concatenate([np.zeros((_LATEST, signal.shape[1])), signal])
    return np.asarray(padded[: -_LATEST - 1 : -1])


def driven_transients(sections: Sections, ends: Sequence[SectionEnd], unit: float) -> Array:
    """Return the transient that each numerator brings with it.

    Args:
      sections: of n poles in all.
      ends: of each section, m inputs.
      unit: factor of the transform's scale.

    Returns:
      Coefficients of the transients of all sections for a unit of each numerator, entry by entry, input by input;
      shape (n m, n).
    """
    order, inputs = sum(section.size for section in sections), ends[0].last.size
    found = np.zeros((order, inputs, order))
    for (start, section), end in zip(section_offsets(sections), ends, strict=True):
        found[start : start + section.size, :, start : start + section.size] = _transients(section, end.once, end.last)
    return -unit * found.reshape(order * inputs, order)


def slope_transients(sections: Sections, ends: Sequence[SectionEnd], unit: float, numerators: Array) -> Array:
    """Return the transient that the derivative by each section coefficient has.

    Args:
      sections: of n poles in all.
      ends: of each section, m inputs.
      unit: factor of the transform's scale.
      numerators: shape (n, m, p).

    Returns:
      Coefficients of the transients of all sections in the section's output filtered once more, for each output and
      coefficient; shape (p, n, n). The derivative is minus that.
    """
    order, outputs = numerators.shape[0], numerators.shape[2]
    found = np.zeros((outputs, order, order))
    for (start, section), end in zip(section_offsets(sections), ends, strict=True):
        own = slice(start, start + section.size)
        # The section's output is b₁ w[t−1] + b₂ w[t−2]; what it is filtered to follows likewise.
        output, filtered = (
            sum(
                np.einsum("lm,mp->lp", signal[lag : lag + 3], numerators[start + lag - 1])
                for lag in range(1, section.size + 1)
            )
            for signal in (end.once, end.twice)
        )
        found[:, own, own] = np.moveaxis(_transients(section, filtered, output[0]), 1, 0)
    return -unit * found


def _transients(section: Array, filtered: Array, last: Array) -> Array:
    """Return the state after the last sample by the entry that was driven, shape (s, k, s) for k signals.

    Args:
      section: s coefficients.
      filtered: last samples of the signals behind the section's denominator, the latest first; shape (≥ 3, k).
      last: last sample of the signals, shape (k,).
    """
    if section.size == 1:
        return np.asarray(filtered[0][None, :, None])
    first = np.stack([filtered[0], -section[1] * filtered[1]], axis=1)
    second = np.stack([filtered[1], -section[1] * filtered[2] + last], axis=1)
    return np.stack([first, second])
