"""What a robot is: the tables of its TOML file, key by key.

Field names are the file's keys, so each carries its unit. Angles: pitch with the muzzle up and yaw to the left are
positive. `docs/virtual_robot.md` has the format.
"""

from dataclasses import dataclass
from typing import Literal

from archerfish2.virtual_robot.description_bounds import (
    AboveZero,
    AngleDeg,
    Aside,
    Finite,
    Frequency,
    NotNegative,
    OffsetM,
    Opening,
    Probability,
    Ratio,
    Spread,
    Ticks,
    Tilt,
)

TICK_S = 0.001
"""Period of the firmware and of the physics [s]."""


@dataclass(frozen=True)
class GimbalAxis:
    """[gimbal.pitch] and [gimbal.yaw]: joint and motor of an axis."""

    low_deg: AngleDeg
    """Mechanical stop at the smallest angle."""
    high_deg: AngleDeg
    """Mechanical stop at the largest angle."""
    armature_kg_m2: AboveZero
    """Inertia of the rotor and whatever else turns with this joint alone."""
    damping_n_m_s_per_rad: NotNegative
    """Viscous friction."""
    friction_n_m: NotNegative
    """Coulomb friction."""
    torque_limit_n_m: AboveZero
    """Largest torque of the motor, by its current limit."""
    supply_v: AboveZero
    """Voltage of the supply."""
    motor_constant_v_s_per_rad: AboveZero
    """Back EMF per speed, which equals the torque per current [N·m/A]."""
    resistance_ohm: AboveZero
    """Resistance of the winding; supply and back EMF limit the current through it."""
    current_lag_ms: NotNegative
    """Time constant of the current loop."""
    recoil_n_m_s: Finite
    """Angular impulse of one shot on this axis."""


@dataclass(frozen=True)
class YawBody:
    """[gimbal.yaw_body]: what turns with the yaw axis, less what pitches."""

    inertia_kg_m2: AboveZero
    """About the yaw axis."""


@dataclass(frozen=True)
class PitchBody:
    """[gimbal.pitch_body]: what pitches, with its centre of mass relative to the pivot."""

    mass_kg: AboveZero
    """Mass."""
    forward_m: OffsetM
    """Centre of mass: towards the muzzle."""
    left_m: OffsetM
    """Centre of mass: to the left."""
    up_m: OffsetM
    """Centre of mass: up."""
    roll_inertia_kg_m2: AboveZero
    """About the barrel's direction, through the centre of mass."""
    pitch_inertia_kg_m2: AboveZero
    """About the pitch axis' direction, through the centre of mass."""
    yaw_inertia_kg_m2: AboveZero
    """About the third direction, through the centre of mass."""


@dataclass(frozen=True)
class Gimbal:
    """[gimbal]: two axes, yaw below pitch, that meet in the pivot."""

    pitch: GimbalAxis
    """[gimbal.pitch]."""
    yaw: GimbalAxis
    """[gimbal.yaw]."""
    yaw_body: YawBody
    """[gimbal.yaw_body]."""
    pitch_body: PitchBody
    """[gimbal.pitch_body]."""


@dataclass(frozen=True)
class FirmwareAxis:
    """[firmware.pitch] and [firmware.yaw]: the cascade of an axis, angle P → rate PI → torque."""

    angle_gain_per_s: AboveZero
    """Asked rate per angle error."""
    rate_limit_rad_per_s: AboveZero
    """Largest rate that the angle loop asks."""
    rate_gain_n_m_s_per_rad: AboveZero
    """Torque per rate error."""
    integral_gain_n_m_per_rad: NotNegative
    """Torque per integrated rate error."""
    integral_limit_n_m: NotNegative
    """Largest torque of the integral; it also rests while the motor is at its limit and the error pushes on."""
    command_low_deg: AngleDeg
    """Commands below are raised to it."""
    command_high_deg: AngleDeg
    """Commands above are lowered to it."""
    encoder_counts_per_turn: AboveZero
    """Resolution of the encoder."""
    angle_per_encoder: Ratio
    """True angle over the encoder's, which the firmware brings to the command: the axis' steady gain."""
    gyro_noise_rad_per_s: NotNegative
    """Standard deviation of the rate gyro, each tick."""
    gyro_cutoff_hz: AboveZero
    """Corner of the gyro's low-pass filter."""


@dataclass(frozen=True)
class Firmware:
    """[firmware]: the gimbal's controller, at 1 kHz."""

    bus_delay_ms: Ticks
    """Whole milliseconds from the controller's output to the motor driver."""
    pitch: FirmwareAxis
    """[firmware.pitch]."""
    yaw: FirmwareAxis
    """[firmware.yaw]."""


@dataclass(frozen=True)
class Link:
    """[link]: between robot and host; latencies are uniform between low and high, and nothing overtakes."""

    command_rate_hz: Frequency
    """How often a host sends at most; `archerfish record` sends that often."""
    command_latency_low_ms: NotNegative
    """Shortest time from the host's sending until the robot has a command."""
    command_latency_high_ms: NotNegative
    """Longest."""
    command_quantum_deg: NotNegative
    """Step of the angles on the wire; 0 is none."""
    command_loss: Probability
    """Probability that a command never arrives."""
    feedback_rate_hz: Frequency
    """How often the robot reports its angles."""
    feedback_latency_low_ms: NotNegative
    """Shortest time from the reading until the host has it."""
    feedback_latency_high_ms: NotNegative
    """Longest."""
    feedback_angle_quantum_deg: NotNegative
    """Step of reported angles; 0 is none."""
    feedback_rate_quantum_deg_per_s: NotNegative
    """Step of reported rates; 0 is none."""
    feedback_loss: Probability
    """Probability that a report never arrives."""
    feedback_source: Literal["imu", "encoder"]
    """Whose angle is reported: the true one (of an attitude sensor) or the encoder's, which the firmware controls."""


@dataclass(frozen=True)
class Camera:
    """[camera]: rides on what pitches, x forward, y left, z up."""

    rate_hz: Frequency
    """Frames per second."""
    latency_low_ms: NotNegative
    """Shortest time from exposure until the host has the detection; uniform up to the longest."""
    latency_high_ms: NotNegative
    """Longest."""
    clock_offset_ms: Finite
    """Stamp of a frame less the moment of its exposure on the robot's clock."""
    stamp_jitter_ms: NotNegative
    """Standard deviation of the stamps."""
    bearing_sd_mrad: NotNegative
    """Noise across the line of sight, sideways, at any distance; adds to the lateral noise."""
    elevation_sd_mrad: NotNegative
    """Noise across the line of sight, upwards."""
    lateral_sd_mm: NotNegative
    """Noise across the line of sight, each way, in length at the plate."""
    range_sd_percent: NotNegative
    """Noise along the line of sight, of the distance."""
    miss_probability: Probability
    """Probability that the plate is not found in a frame that shows it."""
    field_of_view_yaw_deg: Opening
    """Whole width of the picture; a plate outside is not found."""
    field_of_view_pitch_deg: Opening
    """Whole height of the picture."""
    forward_m: OffsetM
    """Position relative to the pivot at zero angles: towards the muzzle."""
    left_m: OffsetM
    """To the left."""
    up_m: OffsetM
    """Up."""
    misalignment_yaw_deg: Tilt
    """The camera looks this far left of the barrel, unknown to the host."""
    misalignment_pitch_deg: Tilt
    """The camera looks this far above the barrel, unknown to the host."""


@dataclass(frozen=True)
class MuzzleTable:
    """[muzzle]: how pellets leave, and the air that they fly through."""

    speed_m_s: AboveZero
    """Mean speed of a pellet from rested friction wheels."""
    speed_sd_m_s: NotNegative
    """Its standard deviation from shot to shot."""
    droop_per_shot_m_s: NotNegative
    """Speed that a shot takes from the next ones."""
    droop_recovery_ms: AboveZero
    """Time constant with which the wheels regain it."""
    dispersion_pitch_deg: Spread
    """Standard deviation of the elevation from shot to shot."""
    dispersion_yaw_deg: Spread
    """Standard deviation of the azimuth from shot to shot."""
    boresight_pitch_deg: Aside
    """Mean elevation of the shots above the barrel."""
    boresight_yaw_deg: Aside
    """Mean azimuth of the shots, left of the barrel."""
    forward_m: OffsetM
    """Muzzle relative to the pivot at zero angles: forward."""
    left_m: OffsetM
    """To the left."""
    up_m: OffsetM
    """Up."""
    height_m: AboveZero
    """Height of the pivot above the ground."""
    drag_per_m: NotNegative
    """Quadratic drag k: a pellet slows down by k v²."""
    speed_sensor_sd_m_s: NotNegative
    """Standard deviation of the measured muzzle speed about the true one."""


@dataclass(frozen=True)
class RefereeTable:
    """[referee]: what counts and what is allowed."""

    hit_radius_m: AboveZero
    """A pellet that crosses the plate's plane this near to its centre hits."""
    max_rate_hz: AboveZero
    """Most shots per second."""
    heat_per_shot: NotNegative
    """Heat of one shot."""
    heat_limit: AboveZero
    """A shot that would pass it is not allowed."""
    cooling_per_s: NotNegative
    """Heat that is lost per second."""


@dataclass(frozen=True)
class LimitsAxis:
    """[limits.pitch] and [limits.yaw]: what the team knows that it may ask."""

    low_deg: AngleDeg
    """Smallest angle."""
    high_deg: AngleDeg
    """Largest angle."""
    max_rate_rad_per_s: AboveZero
    """Largest rate of the commanded angle."""
    max_acceleration_rad_per_s2: AboveZero
    """Largest acceleration of the commanded angle."""


@dataclass(frozen=True)
class LimitsTable:
    """[limits]: what the team knows of its robot without any identification."""

    pitch: LimitsAxis
    """[limits.pitch]."""
    yaw: LimitsAxis
    """[limits.yaw]."""


@dataclass(frozen=True)
class Schema:
    """[schema]: which format this is, and the robot's name."""

    format: Literal["archerfish.robot/1"]
    """Name and version of the format."""
    name: str
    """Of the robot; names files."""


@dataclass(frozen=True)
class RobotDescription:
    """A whole robot."""

    schema: Schema
    """[schema]."""
    gimbal: Gimbal
    """[gimbal]."""
    firmware: Firmware
    """[firmware]."""
    link: Link
    """[link]."""
    camera: Camera
    """[camera]."""
    muzzle: MuzzleTable
    """[muzzle]."""
    referee: RefereeTable
    """[referee]."""
    limits: LimitsTable
    """[limits]."""
