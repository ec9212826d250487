"""What a robot is: the tables of its TOML file, with units and bounds, and what its values must be to one another.

Field names are the file's, so each ends in its unit. Angles: pitch with the muzzle up and yaw to the left are positive.
`docs/virtual_robot.md` has the format.
"""

import math
from typing import Annotated, Literal

from msgspec import Meta

from archerfish.errors import InputError
from archerfish.records.json_files import Number
from archerfish.records.record import Share, Struct

_Positive = Annotated[float, Meta(gt=0.0, le=1e12)]
_NotNegative = Annotated[float, Meta(ge=0.0, le=1e12)]
_Angle = Annotated[float, Meta(ge=-360.0, le=360.0)]
"""[°]."""
_Tilt = Annotated[float, Meta(ge=-45.0, le=45.0)]
"""[°]."""
_Aside = Annotated[float, Meta(ge=-10.0, le=10.0)]
"""[°]."""
_Spread = Annotated[float, Meta(ge=0.0, le=10.0)]
"""[°]."""
_Opening = Annotated[float, Meta(ge=1.0, le=179.0)]
"""[°]."""
_Offset = Annotated[float, Meta(ge=-1.0, le=1.0)]
"""[m]."""
_Frequency = Annotated[float, Meta(ge=1.0, le=1000.0)]
"""[Hz], no faster than the firmware."""
_Ratio = Annotated[float, Meta(ge=0.5, le=2.0)]
_Ticks = Annotated[int, Meta(ge=0, le=20)]
_FileName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][\w.-]*\Z", max_length=100)]
"""Letters, digits, _, - and the full stop."""

TICK_S = 0.001
"""Period of the firmware and of the physics [s]."""
GRAVITY_M_S2 = 9.81
"""[m/s²]."""


class _Table(Struct, frozen=True, kw_only=True, eq=True):
    """A table of the file; every field is required."""


class Placed(_Table, frozen=True):
    """What has a place relative to the pivot at zero angles: a centre of mass, the camera or the muzzle."""

    forward_m: _Offset
    """Towards the muzzle."""
    left_m: _Offset
    """To the left."""
    up_m: _Offset
    """Up."""


class GimbalAxis(_Table, frozen=True):
    """[gimbal.pitch] and [gimbal.yaw]: joint and motor of an axis."""

    low_deg: _Angle
    """Mechanical stop at the smallest angle."""
    high_deg: _Angle
    """Mechanical stop at the largest angle."""
    armature_kg_m2: _Positive
    """Inertia of the rotor and whatever else turns with this joint alone."""
    damping_n_m_s_per_rad: _NotNegative
    """Viscous friction."""
    friction_n_m: _NotNegative
    """Coulomb friction."""
    torque_limit_n_m: _Positive
    """Largest torque of the motor, by its current limit."""
    supply_v: _Positive
    """Voltage of the supply."""
    motor_constant_v_s_per_rad: _Positive
    """Back EMF per speed, which equals the torque per current [N·m/A]."""
    resistance_ohm: _Positive
    """Resistance of the winding; supply and back EMF limit the current through it."""
    current_lag_ms: _NotNegative
    """Time constant of the current loop."""
    recoil_n_m_s: Number
    """Angular impulse of one shot on this axis."""


class YawBody(_Table, frozen=True):
    """[gimbal.yaw_body]: what turns with the yaw axis, less what pitches."""

    inertia_kg_m2: _Positive
    """About the yaw axis."""


class PitchBody(Placed, frozen=True):
    """[gimbal.pitch_body]: what pitches, with its centre of mass relative to the pivot."""

    mass_kg: _Positive
    """Mass."""
    roll_inertia_kg_m2: _Positive
    """About the barrel's direction, through the centre of mass."""
    pitch_inertia_kg_m2: _Positive
    """About the pitch axis' direction, through the centre of mass."""
    yaw_inertia_kg_m2: _Positive
    """About the third direction, through the centre of mass."""


class Gimbal(_Table, frozen=True):
    """[gimbal]: two axes, yaw below pitch, that meet in the pivot."""

    pitch: GimbalAxis
    """[gimbal.pitch]."""
    yaw: GimbalAxis
    """[gimbal.yaw]."""
    yaw_body: YawBody
    """[gimbal.yaw_body]."""
    pitch_body: PitchBody
    """[gimbal.pitch_body]."""


class FirmwareAxis(_Table, frozen=True):
    """[firmware.pitch] and [firmware.yaw]: the cascade of an axis, angle P → rate PI → torque."""

    angle_gain_per_s: _Positive
    """Asked rate per angle error."""
    rate_limit_rad_per_s: _Positive
    """Largest rate that the angle loop asks."""
    rate_gain_n_m_s_per_rad: _Positive
    """Torque per rate error."""
    integral_gain_n_m_per_rad: _NotNegative
    """Torque per integrated rate error."""
    integral_limit_n_m: _NotNegative
    """Largest torque of the integral; it also rests while the motor is at its limit and the error pushes on."""
    command_low_deg: _Angle
    """Commands below are raised to it."""
    command_high_deg: _Angle
    """Commands above are lowered to it."""
    encoder_counts_per_turn: _Positive
    """Resolution of the encoder."""
    angle_per_encoder: _Ratio
    """True angle over the encoder's, which the firmware brings to the command: the axis' steady gain."""
    gyro_noise_rad_per_s: _NotNegative
    """Standard deviation of the rate gyro, each tick."""
    gyro_cutoff_hz: _Positive
    """Corner of the gyro's low-pass filter."""


class Firmware(_Table, frozen=True):
    """[firmware]: the gimbal's controller, at 1 kHz."""

    bus_delay_ms: _Ticks
    """Whole milliseconds from the controller's output to the motor driver."""
    pitch: FirmwareAxis
    """[firmware.pitch]."""
    yaw: FirmwareAxis
    """[firmware.yaw]."""


class Link(_Table, frozen=True):
    """[link]: between robot and host; latencies are uniform between low and high, and nothing overtakes."""

    command_rate_hz: _Frequency
    """How often a host sends at most; `archerfish record` sends that often."""
    command_latency_low_ms: _NotNegative
    """Shortest time from the host's sending until the robot has a command."""
    command_latency_high_ms: _NotNegative
    """Longest."""
    command_quantum_deg: _NotNegative
    """Step of the angles on the wire; 0 is none."""
    command_loss: Share
    """Probability that a command never arrives."""
    feedback_rate_hz: _Frequency
    """How often the robot reports its angles."""
    feedback_latency_low_ms: _NotNegative
    """Shortest time from the reading until the host has it."""
    feedback_latency_high_ms: _NotNegative
    """Longest."""
    feedback_angle_quantum_deg: _NotNegative
    """Step of reported angles; 0 is none."""
    feedback_rate_quantum_deg_per_s: _NotNegative
    """Step of reported rates; 0 is none."""
    feedback_loss: Share
    """Probability that a report never arrives."""
    feedback_source: Literal["imu", "encoder"]
    """Whose angle is reported: the true one (of an attitude sensor) or the encoder's, which the firmware controls."""


class Camera(Placed, frozen=True):
    """[camera]: rides on what pitches, x forward, y left, z up."""

    rate_hz: _Frequency
    """Frames per second."""
    latency_low_ms: _NotNegative
    """Shortest time from exposure until the host has the detection; uniform up to the longest."""
    latency_high_ms: _NotNegative
    """Longest."""
    clock_offset_ms: Number
    """Stamp of a frame less the moment of its exposure on the robot's clock."""
    stamp_jitter_ms: _NotNegative
    """Standard deviation of the stamps."""
    bearing_sd_mrad: _NotNegative
    """Noise across the line of sight, sideways, at any distance; adds to the lateral noise."""
    elevation_sd_mrad: _NotNegative
    """Noise across the line of sight, upwards."""
    lateral_sd_mm: _NotNegative
    """Noise across the line of sight, each way, in length at the plate."""
    range_sd_percent: _NotNegative
    """Noise along the line of sight, of the distance."""
    miss_probability: Share
    """Probability that the plate is not found in a frame that shows it."""
    field_of_view_yaw_deg: _Opening
    """Whole width of the picture; a plate outside is not found."""
    field_of_view_pitch_deg: _Opening
    """Whole height of the picture."""
    misalignment_yaw_deg: _Tilt
    """The camera looks this far left of the barrel, unknown to the host."""
    misalignment_pitch_deg: _Tilt
    """The camera looks this far above the barrel, unknown to the host."""


class MuzzleTable(Placed, frozen=True):
    """[muzzle]: how pellets leave, and the air that they fly through."""

    speed_m_s: _Positive
    """Mean speed of a pellet from rested friction wheels."""
    speed_sd_m_s: _NotNegative
    """Its standard deviation from shot to shot."""
    droop_per_shot_m_s: _NotNegative
    """Speed that a shot takes from the next ones."""
    droop_recovery_ms: _Positive
    """Time constant with which the wheels regain it."""
    dispersion_pitch_deg: _Spread
    """Standard deviation of the elevation from shot to shot."""
    dispersion_yaw_deg: _Spread
    """Standard deviation of the azimuth from shot to shot."""
    boresight_pitch_deg: _Aside
    """Mean elevation of the shots above the barrel."""
    boresight_yaw_deg: _Aside
    """Mean azimuth of the shots, left of the barrel."""
    height_m: _Positive
    """Height of the pivot above the ground."""
    drag_per_m: _NotNegative
    """Quadratic drag k: a pellet slows down by k v²."""
    speed_sensor_sd_m_s: _NotNegative
    """Standard deviation of the measured muzzle speed about the true one."""


class RefereeTable(_Table, frozen=True):
    """[referee]: what counts and what is allowed."""

    hit_radius_m: _Positive
    """A pellet that crosses the plate's plane this near to its centre hits."""
    max_rate_hz: _Positive
    """Most shots per second."""
    heat_per_shot: _NotNegative
    """Heat of one shot."""
    heat_limit: _Positive
    """A shot that would pass it is not allowed."""
    cooling_per_s: _NotNegative
    """Heat that is lost per second."""


class LimitsAxis(_Table, frozen=True):
    """[limits.pitch] and [limits.yaw]: what the team knows that it may ask."""

    low_deg: _Angle
    """Smallest angle."""
    high_deg: _Angle
    """Largest angle."""
    max_rate_rad_per_s: _Positive
    """Largest rate of the commanded angle."""
    max_acceleration_rad_per_s2: _Positive
    """Largest acceleration of the commanded angle."""


class LimitsTable(_Table, frozen=True):
    """[limits]: what the team knows of its robot without any identification."""

    pitch: LimitsAxis
    """[limits.pitch]."""
    yaw: LimitsAxis
    """[limits.yaw]."""


class Schema(_Table, frozen=True):
    """[schema]: which format this is, and the robot's name."""

    format: Literal["archerfish.robot/1"]
    """Name and version of the format."""
    name: _FileName
    """Of the robot; names files."""


class RobotDescription(_Table, frozen=True):
    """A whole robot.

    Raises:
      InputError: if values contradict one another.
    """

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

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_order(self, "")
        _check_nesting("pitch", self.gimbal.pitch, self.firmware.pitch, self.limits.pitch)
        _check_nesting("yaw", self.gimbal.yaw, self.firmware.yaw, self.limits.yaw)
        _check_load(self.gimbal.pitch_body, self.gimbal.pitch)


def _check_order(table: _Table, place: str) -> None:
    """Refuse a smallest value above its largest; an angle's range must not be empty, a latency may be fixed."""
    for field in table.__struct_fields__:
        value, partner = getattr(table, field), field.replace("low", "high")
        if isinstance(value, _Table):
            _check_order(value, f"{place}{field}.")
        elif partner != field:
            high, relation = getattr(table, partner), "<" if field.endswith("_deg") else "≤"
            if value > high or (value == high and relation == "<"):
                raise InputError(f"field {place}{field}: expected {relation} {partner}, got {value:g} and {high:g}")


def _check_nesting(axis: str, stops: GimbalAxis, commands: FirmwareAxis, limits: LimitsAxis) -> None:
    """Refuse limits beyond the commands that the firmware takes, and commands beyond the stops."""
    low, high = commands.command_low_deg, commands.command_high_deg
    reached = low * commands.angle_per_encoder, high * commands.angle_per_encoder
    if reached[0] < stops.low_deg or reached[1] > stops.high_deg:
        raise InputError(
            f"field firmware.{axis}: command_low_deg and command_high_deg times angle_per_encoder are "
            f"{reached[0]:g}…{reached[1]:g}°, expected within gimbal.{axis} {stops.low_deg:g}…{stops.high_deg:g}°"
        )
    if limits.low_deg < low or limits.high_deg > high:
        raise InputError(
            f"field limits.{axis}: low_deg and high_deg are {limits.low_deg:g}…{limits.high_deg:g}°, expected within "
            f"the commands of firmware.{axis} {low:g}…{high:g}°"
        )
    if not limits.low_deg <= 0.0 <= limits.high_deg:
        raise InputError(
            f"field limits.{axis}: low_deg and high_deg are {limits.low_deg:g}…{limits.high_deg:g}°, expected to "
            "include 0°, where recordings begin"
        )


def _check_load(body: PitchBody, motor: GimbalAxis) -> None:
    """Refuse moments of inertia that no body has, and a load that the motor can't hold: it would fall on its stop."""
    *others, largest = sorted((body.roll_inertia_kg_m2, body.pitch_inertia_kg_m2, body.yaw_inertia_kg_m2))
    if largest > sum(others):
        raise InputError(
            f"field gimbal.pitch_body: expected the largest of roll_inertia_kg_m2, pitch_inertia_kg_m2 and "
            f"yaw_inertia_kg_m2 to be at most the sum of the others, {sum(others):g}, got {largest:g}"
        )
    load = GRAVITY_M_S2 * body.mass_kg * math.hypot(body.forward_m, body.up_m)
    stall = motor.motor_constant_v_s_per_rad * motor.supply_v / motor.resistance_ohm
    if load > min(motor.torque_limit_n_m, stall):
        raise InputError(
            f"field gimbal.pitch_body: mass_kg at forward_m and up_m needs {load:.3g} N·m, expected at most what the "
            f"motor holds, {motor.torque_limit_n_m:.3g} N·m by torque_limit_n_m and {stall:.3g} N·m by supply_v"
        )
