"""A linear stand-in for the gimbal's mechanics, for machines without MuJoCo: each axis J q̈ = τ − b q̇, and stops."""

import math

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.description import TICK_S, Gimbal

Array = NDArray[np.float64]


def axis_inertias(gimbal: Gimbal) -> Array:
    """Inertia of pitch and yaw about their joints, with the barrel level [kg·m²], shape (2,)."""
    body = gimbal.pitch_body
    pitch = body.pitch_inertia_kg_m2 + body.mass_kg * (body.forward_m**2 + body.up_m**2) + gimbal.pitch.armature_kg_m2
    yaw = body.yaw_inertia_kg_m2 + body.mass_kg * (body.forward_m**2 + body.left_m**2)
    return np.array([pitch, yaw + gimbal.yaw_body.inertia_kg_m2 + gimbal.yaw.armature_kg_m2])


class LinearGimbal:
    """B gimbals of two independent linear axes, stepped exactly under a torque that is held for a tick."""

    def __init__(self, gimbal: Gimbal, batch: int) -> None:
        axes = (gimbal.pitch, gimbal.yaw)
        self._low = np.radians([axis.low_deg for axis in axes])
        self._high = np.radians([axis.high_deg for axis in axes])
        steps = [
            _held_step(inertia, axis.damping_n_m_s_per_rad, TICK_S)
            for inertia, axis in zip(axis_inertias(gimbal), axes, strict=True)
        ]
        self._decay, self._way, self._push, self._shove = np.array(steps).T
        self.angle: Array = np.zeros((batch, 2))
        self.rate: Array = np.zeros((batch, 2))

    def reset(self, angle: Array) -> None:
        """Put the gimbals at rest at their angles [rad], shape (B, 2)."""
        self.angle = np.array(angle, dtype=np.float64)
        self.rate = np.zeros_like(self.angle)

    def holding_torque(self) -> Array:
        """Return zeros, since nothing pulls [N·m], shape (B, 2)."""
        return np.zeros_like(self.angle)

    def step(self, torque: Array) -> None:
        """Apply torques for one tick [N·m], shape (B, 2); a stop takes all speed."""
        free = self.angle + self._way * self.rate + self._shove * torque
        rate = self._decay * self.rate + self._push * torque
        self.angle = np.clip(free, self._low, self._high)
        self.rate = np.where(self.angle == free, rate, 0.0)


def _held_step(inertia: float, damping: float, period: float) -> tuple[float, float, float, float]:
    """Return rate by rate, angle by rate, rate by torque and angle by torque over a period."""
    z = damping * period / inertia
    if z < 1e-8:
        return 1.0, period, period / inertia, 0.5 * period**2 / inertia
    gone = -math.expm1(-z)
    return 1.0 - gone, gone * inertia / damping, gone / damping, (period - gone * inertia / damping) / damping
