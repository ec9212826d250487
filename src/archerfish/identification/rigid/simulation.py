"""Logs of a rigid axis cut into segments, and the model of eqs (1)–(3) run through all of them at once.

The parameters are those in which the acceleration is linear,

    θ̈ = φ₀ torque − φ₁ θ̇ − φ₂ sin θ + φ₃ cos θ + φ₄ − φ₅ sign θ̇,

with φ = (1, b, m g l cos θ₀, m g l sin θ₀, torque offset, friction) / inertia and θ₀ the angle at which the arm hangs.
At rest friction holds up to φ₅.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.rigid_axis import RigidAxis, RigidState, dry_friction, rigid_step
from archerfish.records.recording import Recording

Array = NDArray[np.float64]


_FINE = 5e-3
"""Longest step with dry friction [s]: within it the axis can't both stop and break free."""


class Segments(NamedTuple):
    """S stretches of logs, each padded to L samples; channel 0 is the angle, channel 1, if any, the rate."""

    torque: Array
    """[N m], shape (L, S)."""
    outputs: Array
    """Measured angle [rad] and rate [rad/s], shape (L, S, p)."""
    lengths: tuple[int, ...]
    """Samples of each segment before padding, S of them."""
    owners: tuple[int, ...]
    """Index of the recording that each segment was cut from, S of them."""
    sample_period_s: float
    """Sampling period [s]."""


def cut_segments(recordings: Sequence[Recording], torque_per_unit: float, segment_s: float) -> Segments:
    """Cut recordings into segments of about equal length, at most `segment_s` long.

    Args:
      recordings: one input; angle, then rate if it was measured.
      torque_per_unit: torque per unit of the input [N m].
      segment_s: longest segment [s], or 0 for whole recordings.
    """
    pieces, owners = [], []
    for owner, recording in enumerate(recordings):
        longest = len(recording) if segment_s == 0 else max(2, round(segment_s / recording.sample_period_s))
        parts = np.array_split(np.arange(len(recording)), -(-len(recording) // longest))
        pieces += [(torque_per_unit * recording.inputs[part, 0], recording.outputs[part]) for part in parts]
        owners += [owner] * len(parts)
    longest = max(len(torque) for torque, _ in pieces)
    return Segments(
        np.stack([np.pad(torque, (0, longest - len(torque)), mode="edge") for torque, _ in pieces], axis=1),
        np.stack([np.pad(seen, ((0, longest - len(seen)), (0, 0)), mode="edge") for _, seen in pieces], axis=1),
        tuple(len(torque) for torque, _ in pieces),
        tuple(owners),
        recordings[0].sample_period_s,
    )


def simulate_segments(segments: Segments, phi: Array, initial: Array) -> Array:
    """Simulate angle and rate of all segments from the torque alone, held from sample to sample.

    Args:
      segments: the torques.
      phi: parameters, shape B + (6,); φ₀ > 0, φ₅ ≥ 0.
      initial: angle and rate that each segment starts from, shape B + (S, 2).

    Returns:
      Angle and rate, shape (L,) + B + (S, 2).
    """
    inertia = 1 / phi[..., 0:1]
    gravity, phase = np.hypot(phi[..., 2:3], phi[..., 3:4]), np.arctan2(phi[..., 3:4], phi[..., 2:3])
    # Of m and l only m l² and g / l act: l = 1 m makes m the inertia.
    axis = RigidAxis(inertia, np.ones_like(inertia), phi[..., 1:2] * inertia, gravity)
    torque = segments.torque.reshape(len(segments.torque), *[1] * (phi.ndim - 1), -1)
    pushed = torque + phi[..., 4:5] * inertia
    friction = phi[..., 5:6] * inertia
    steps = max(1, math.ceil(segments.sample_period_s / _FINE)) if np.any(friction > 0) else 1
    period = segments.sample_period_s / steps
    state = RigidState(initial[..., 0] - phase, initial[..., 1])
    found = np.empty((len(pushed), *np.broadcast_shapes(state.angle.shape, pushed.shape[1:]), 2))
    for index, push in enumerate(pushed):
        found[index, ..., 0], found[index, ..., 1] = state
        for _ in range(steps):
            held = dry_friction(axis, state, push, friction, period) if np.any(friction > 0) else 0.0
            state = rigid_step(axis, state, push + held, period)
    found[..., 0] += phase
    return found
