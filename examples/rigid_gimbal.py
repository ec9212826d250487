"""A gimbal from first principles: an inertia with a position servo on each axis."""

import math

import archerfish as af

AXES = {"pitch": (0.012, 60.0, 1.1), "yaw": (0.035, 110.0, 2.9)}
"""Axis → inertia [kg m²], stiffness [N m/rad] and damping [N m s/rad] of the servo."""


def gimbal(axis):
    inertia, stiffness, damping = AXES[axis]
    natural_hz = math.sqrt(stiffness / inertia) / (2.0 * math.pi)
    return af.PlantRecord.second_order(natural_hz, damping / (2.0 * math.sqrt(stiffness * inertia)), delay_s=4e-3)
