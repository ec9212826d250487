"""What the values of a robot must be to each other."""

import math
from typing import Any

from archerfish2.errors import InputError
from archerfish2.virtual_robot.description import RobotDescription

_AXES = ("pitch", "yaw")


def check_description(robot: RobotDescription) -> None:
    """Refuse values that contradict each other.

    Raises:
      InputError: naming table and keys.
    """
    _check_order(robot)
    _check_nesting(robot)
    _check_inertia(robot)
    _check_steady(robot)


def _check_order(robot: RobotDescription) -> None:
    for axis in _AXES:
        _ordered(getattr(robot.gimbal, axis), f"gimbal.{axis}", "low_deg", "high_deg")
        _ordered(getattr(robot.firmware, axis), f"firmware.{axis}", "command_low_deg", "command_high_deg")
        _ordered(getattr(robot.limits, axis), f"limits.{axis}", "low_deg", "high_deg")
    for name in ("command_latency", "feedback_latency"):
        _ordered(robot.link, "link", f"{name}_low_ms", f"{name}_high_ms", equal=True)
    _ordered(robot.camera, "camera", "latency_low_ms", "latency_high_ms", equal=True)


def _ordered(table: Any, name: str, low: str, high: str, *, equal: bool = False) -> None:
    smaller, larger = getattr(table, low), getattr(table, high)
    if smaller > larger or (smaller == larger and not equal):
        relation = "at most" if equal else "below"
        raise InputError(f"[{name}] {low} must be {relation} {high}, got {smaller:g} and {larger:g}; swap or mend them")


def _check_nesting(robot: RobotDescription) -> None:
    """Limits lie within the commands that the firmware takes, and these within the stops."""
    for axis in _AXES:
        stops, commands, limits = (getattr(part, axis) for part in (robot.gimbal, robot.firmware, robot.limits))
        gain = commands.angle_per_encoder
        reached = sorted([gain * commands.command_low_deg, gain * commands.command_high_deg])
        if reached[0] < stops.low_deg or reached[1] > stops.high_deg:
            raise InputError(
                f"[firmware.{axis}] command_low_deg and command_high_deg reach {reached[0]:g}…{reached[1]:g}°, outside "
                f"the stops of [gimbal.{axis}] {stops.low_deg:g}…{stops.high_deg:g}°; narrow the commands"
            )
        if limits.low_deg < commands.command_low_deg or limits.high_deg > commands.command_high_deg:
            raise InputError(
                f"[limits.{axis}] low_deg and high_deg {limits.low_deg:g}…{limits.high_deg:g}° lie "
                f"outside what [firmware.{axis}] {commands.command_low_deg:g}…{commands.command_high_deg:g}° takes; "
                "narrow the limits"
            )


def _check_inertia(robot: RobotDescription) -> None:
    body = robot.gimbal.pitch_body
    moments = sorted([body.roll_inertia_kg_m2, body.pitch_inertia_kg_m2, body.yaw_inertia_kg_m2])
    if moments[2] > moments[0] + moments[1]:
        raise InputError(
            "[gimbal.pitch_body] roll_inertia_kg_m2, pitch_inertia_kg_m2, yaw_inertia_kg_m2: the largest "
            f"({moments[2]:g}) exceeds the sum of the others ({moments[0] + moments[1]:g}), as in no body; mend them"
        )


def _check_steady(robot: RobotDescription) -> None:
    """Refuse a load that the pitch motor can't hold: the robot would fall on its stop before anything begins."""
    body, motor = robot.gimbal.pitch_body, robot.gimbal.pitch
    load = 9.81 * body.mass_kg * math.hypot(body.forward_m, body.up_m)
    stall = motor.motor_constant_v_s_per_rad * motor.supply_v / motor.resistance_ohm
    strongest = min(motor.torque_limit_n_m, stall)
    if load > strongest:
        raise InputError(
            f"[gimbal.pitch_body] mass_kg off the pivot weighs {load:.3g} N·m, more than the motor holds "
            f"({strongest:.3g} N·m by torque_limit_n_m and supply_v); mend mass_kg, forward_m, up_m or the motor"
        )
