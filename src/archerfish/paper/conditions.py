"""The conditions behind Tables II and III: the few that are printed, and those that we assume.

Most are not printed. We chose them once, so that our honestly tuned Kalman baseline lands on the paper's Kalman
columns; `calibration` holds how well it does, and how far the choice is from unique.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from archerfish.records import storage


@dataclass(frozen=True)
class Conditions:
    """Who is met where, and with what muzzle; SI units and radians, in our right-handed frame."""

    range_bins: tuple[tuple[float, float], ...]
    """Bins of the distance X₀ to the armor or the parabola's vertex, drawn uniformly [m] (printed: Tables II–V)."""
    hit_radius: float
    """Largest miss distance that hits [m] (printed with eq 8)."""
    parabola_curvature: float
    """Coefficient of eq (7) [1/m] (printed)."""
    parabola_rise: float
    """The target turns back where x − X₀ reaches this [m] (printed with eq 7)."""
    control_period_s: float
    """One command and one pellet each [s]."""
    engagement_s: float
    """Length of an engagement [s]."""
    settled_after_s: float
    """A miss before this time counts as slewing, after it as settled [s]."""
    start_pitch: float
    """Pitch of the resting gimbal when the engagement begins [rad]."""
    start_yaw: float
    """Yaw of the resting gimbal when the engagement begins [rad]."""
    max_lateral_offset: float
    """The vertex lies at most this far to either side, drawn uniformly [m]."""
    armor_height: float
    """Height of the armor's centre above the muzzle [m]."""
    max_lateral_speed: float
    """Lateral speeds of moving targets are drawn uniformly up to this [m/s]."""
    muzzle_speed: float
    """Mean muzzle speed [m/s]."""
    muzzle_speed_sd: float
    """Standard deviation of the muzzle speed [m/s]."""
    dispersion: float
    """Standard deviation of the disturbance angles of eq (6), each [rad]."""
    drag: float
    """Quadratic drag coefficient k [1/m]."""
    position_noise: float
    """Standard deviation of the seen target position, along the line of sight and across it [m]."""
    line_of_sight_lead: float
    """Command limit `los-2deg`: largest angle between yaw command and line of sight [rad]."""
    kalman_acceleration_sd: float
    """Process noise of the baseline's Kalman filter, as a standard deviation of the acceleration [m/s²]."""
    kalman_position_sd: float
    """Measurement noise that the baseline's Kalman filter supposes [m]."""

    kalman_extra_lead_s: float
    """What the baseline leads beyond the control period and the time of flight [s]; it stands for the gimbal's lag."""

    @property
    def reversal_half_width(self) -> float:
        """Distance |y − Y₀| at which a moving target turns back [m], from eq (7)."""
        return math.sqrt(self.parabola_rise / self.parabola_curvature)

    @property
    def decisions(self) -> int:
        """Number of decisions, and of pellets, in an engagement."""
        return round(self.engagement_s / self.control_period_s)


@dataclass(frozen=True)
class CalibrationCell:
    """Our Kalman baseline beside the paper's, in one cell of Table II or III."""

    table: str
    """"II" or "III"."""
    range_m: tuple[float, float]
    """Bin of the distance [m]."""
    ours_percent: float
    """Hit rate of our baseline [%]."""
    residual_points: float
    """Ours less the paper's [percentage points]."""


@dataclass(frozen=True)
class Calibration:
    """How well the assumed conditions reproduce the paper's Kalman columns."""

    cells: tuple[CalibrationCell, ...]
    """All eight."""
    rmse_points: float
    """Root mean square of the residuals [percentage points]."""
    engagements: int
    """Engagements behind each cell."""
    sets_tried: int
    """Sets of conditions that were tried."""
    sets_within_3_points: int
    """How many of them came within 3 points: how far from unique the choice is."""
    note: str
    """What else would fit, and what would not."""


def assumed_conditions() -> Conditions:
    """Return the one set of conditions that stands for the paper's."""
    facts = _facts()
    values = dict(_in_radians(name, value) for name, value in (facts["printed"] | facts["assumed"]).items())
    bins = tuple((float(low), float(high)) for low, high in values.pop("range_bins"))
    return Conditions(range_bins=bins, **values)


def _facts() -> dict[str, Any]:
    return dict(storage.read_json(Path(__file__).with_name("conditions.json")))


def _in_radians(name: str, value: Any) -> tuple[str, Any]:
    return (name.removesuffix("_deg"), math.radians(value)) if name.endswith("_deg") else (name, value)


def calibration() -> Calibration | None:
    """Return the residuals of the assumed conditions, or None until they have been computed."""
    facts = _facts()["calibration"]
    return None if facts is None else calibration_from(facts)


def calibration_from(facts: dict[str, Any]) -> Calibration:
    """Read the field `calibration` of conditions.json, whose names are those of `Calibration`."""
    cells = tuple(
        CalibrationCell(**{**cell, "range_m": (float(cell["range_m"][0]), float(cell["range_m"][1]))})
        for cell in facts["cells"]
    )
    return Calibration(**{**facts, "cells": cells})
