"""First guess of a rigid axis' parameters: the equation of motion, integrated twice, is linear in them.

    θ(t) = θ(0) + θ̇(0) t + φ₀ ∬T − φ₁ (∫θ − θ(0) t) − φ₂ ∬sin θ + φ₃ ∬cos θ + φ₄ t²/2

With the measured angle on the right this is a linear regression that differentiates nothing.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from archerfish.identification.rigid.simulation import Segments
from archerfish.records.errors import InputError

Array = NDArray[np.float64]

_SPAN, _FEWEST = 0.1, 8
"""Time [s] over which an angle is all but a parabola, and samples that outweigh its noise."""


def first_guess(segments: Segments, free: list[int]) -> tuple[Array, Array]:
    """Estimate parameters and initial states by linear regression.

    Args:
      segments: torques and measured angles.
      free: indices of the estimated parameters; the others are zero.

    Returns:
      φ, shape (6,), of which friction is zero, and the initial angle and rate of each segment, shape (S, 2).

    Raises:
      InputError: if torque that rises would slow the axis down.
    """
    columns, targets, own = [], [], []
    for index, length in enumerate(segments.lengths):
        time = segments.sample_period_s * np.arange(length, dtype=np.float64)
        local = np.column_stack([np.ones(length), time])
        full = _columns(segments.torque[:length, index], segments.outputs[:length, index, 0], time)[:, free]
        own.append(np.linalg.pinv(local))
        columns.append(full)
        targets.append(segments.outputs[:length, index, 0])
    projected = [_without(each, p) for each, p in zip(columns, own, strict=True)]
    aims = [_without(each, p) for each, p in zip(targets, own, strict=True)]
    scale = np.linalg.norm(np.vstack(projected), axis=0)
    scale[scale == 0] = 1.0
    solved = np.linalg.lstsq(np.vstack(projected) / scale, np.concatenate(aims), rcond=None)[0] / scale
    if not solved[0] > 0:
        raise InputError(
            "the angle accelerates against the torque, or not with it at all: check the sign of the torque (a negative "
            "--torque-per-unit turns it), that torque and angle are not swapped, and that --axis-kind is right (an arm "
            "under gravity is a pitch axis)"
        )
    phi = np.zeros(6)
    phi[free] = solved
    initial = np.array([p @ (y - x @ solved) for p, y, x in zip(own, targets, columns, strict=True)])
    # The damping's column holds −∫θ, to which θ(0) t belongs.
    initial[:, 1] -= phi[1] * initial[:, 0]
    return phi, initial


def measured_starts(segments: Segments) -> Array:
    """Return angle and rate at the beginning of each segment, by a parabola through its first samples, shape (S, 2)."""
    count = min(max(_FEWEST, round(_SPAN / segments.sample_period_s)), *segments.lengths)
    time = segments.sample_period_s * np.arange(count)
    parabolas = np.polynomial.polynomial.polyfit(time, segments.outputs[:count, :, 0], 2)
    return np.asarray(parabolas[:2].T)


def _columns(torque: Array, angle: Array, time: Array) -> Array:
    period = time[1] - time[0]
    held = np.concatenate([[0.0], np.cumsum(torque[:-1])]) * period

    def once(signal: Array) -> Array:
        return np.asarray(cumulative_trapezoid(signal, dx=period, initial=0.0))

    return np.column_stack(
        [once(held), -once(angle), -once(once(np.sin(angle))), once(once(np.cos(angle))), 0.5 * time**2]
    )


def _without(signals: Array, inverse: Array) -> Array:
    local = np.linalg.pinv(inverse)
    return np.asarray(signals - local @ (inverse @ signals))
