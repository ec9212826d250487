"""A gimbal from first principles: two rigid axes, each with an inertia and a position servo, sampled every 1 ms."""

import numpy as np
from scipy.signal import cont2discrete

from archerfish.records.plant import PlantRecord

SERVOS = {"pitch": (0.012, 60.0, 1.1), "yaw": (0.035, 110.0, 2.9)}
"""Axis → inertia [kg m²], stiffness of the servo [N m/rad], damping [N m s/rad]."""
DELAY_MS = 4
"""From command to torque."""


def gimbal(axis: str) -> PlantRecord:
    """Return the plant of "pitch" or "yaw": commanded angle in, angle out [rad]."""
    inertia, stiffness, damping = SERVOS[axis]
    state = np.array([[0.0, 1.0], [-stiffness / inertia, -damping / inertia]])
    drive = np.array([[0.0], [stiffness / inertia]])
    angle, none = np.array([[1.0, 0.0]]), np.zeros((1, 1))
    A, B, C, D, period = cont2discrete((state, drive, angle, none), 1e-3)
    return PlantRecord(A, B, C, D, delay_samples=DELAY_MS, sample_period_s=period, axis=axis)
