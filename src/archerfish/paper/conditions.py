"""The conditions behind Tables II and III: the few that are printed, and those that we assume.

Most are not printed. We chose them once, so that our honestly tuned Kalman baseline lands on the paper's Kalman
columns; `calibration` has how well it does, and how far the choice is from unique. Under them the classical controllers
were tuned once, for the printed gimbal never changes.
"""

import math
from dataclasses import dataclass

import msgspec

from archerfish.paper import facts
from archerfish.records.muzzle import MuzzleRecord


@dataclass(frozen=True)
class Conditions:
    """Targets, period and muzzle of the paper; SI units and radians, in our right-handed frame."""

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
    """Standard deviation of the detected position, along the line of sight and across it [m]."""
    line_of_sight_lead: float
    """Command limit `los-2deg`: largest angle between yaw command and line of sight [rad]."""
    kalman_acceleration_sd: float
    """Process noise of the baseline's Kalman filter, as a standard deviation of the acceleration [m/s²]."""
    kalman_position_sd: float
    """Measurement noise that the baseline's Kalman filter assumes [m]."""
    kalman_extra_lead_s: float
    """By how much the baseline leads beyond the control period and the flight time [s], for the gimbal's lag."""


@dataclass(frozen=True)
class Calibration:
    """How well the assumed conditions reproduce the paper's Kalman columns."""

    cells: tuple[tuple[str, tuple[float, float], float, float], ...]  # table, distances [m], our baseline's hit rate
    #        [%], and ours less the paper's [percentage points], of all eight cells of Tables II and III
    rmse_points: float  # root mean square of the residuals [percentage points]
    engagements: int  # behind each cell
    sets_tried: int  # of conditions
    sets_within_3_points: int  # how many of them came within 3 points: how far from unique the choice is
    note: str  # what else would fit, and what would not


def assumed_conditions() -> Conditions:
    """Return the one set of conditions that is used for the paper's."""
    found = facts("conditions")["printed"] | facts("conditions")["assumed"]
    degrees = [name for name in found if name.endswith("_deg")]
    radians = {name.removesuffix("_deg"): math.radians(found.pop(name)) for name in degrees}
    return msgspec.convert(found | radians, Conditions)


def calibration() -> Calibration:
    """Return the residuals of the assumed conditions."""
    return msgspec.convert(facts("conditions")["calibration"], Calibration)


def paper_muzzle() -> MuzzleRecord:
    """Return the muzzle of the assumed conditions; its pellets start at the pivot."""
    c = assumed_conditions()
    sd = c.dispersion
    return MuzzleRecord(speed=c.muzzle_speed, speed_sd=c.muzzle_speed_sd, pitch_sd=sd, yaw_sd=sd, drag=c.drag)


def paper_tuning(command_limit: str) -> dict[str, dict[str, float]]:
    """Return the settings of each controller under a command limit, by their names in `Tuning`.

    Those of `kalman-paper` were not tuned under that limit: they are of the conditions that were calibrated with it.

    Args:
      command_limit: "box", "gate" or "los-2deg".
    """
    c = assumed_conditions()
    settings = {"kalman-paper": {"acceleration_sd": c.kalman_acceleration_sd, "extra_lead_s": c.kalman_extra_lead_s}}
    for tuned in facts("tuning")["controllers"]:
        if tuned["command_limit"] == command_limit:
            settings[tuned["controller"]] = dict(tuned["settings"])
    return settings
