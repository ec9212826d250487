"""The rules that the gate keeps: of the robot and the task, narrowed by a configuration and never widened."""

from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta

from archerfish.arrays import Array, single_precision
from archerfish.dynamics.command_limits import NEVER, CommandLimits
from archerfish.errors import InputError
from archerfish.records.limits import AxisLimits, LimitsRecord
from archerfish.records.record import Struct
from archerfish.robot import Robot
from archerfish.task import Task

STALE_S, LOST_S, STEADY_S, UNSEEN_S, SETTLING_S = 0.05, 0.1, 0.5, 0.25, 0.3
"""Age of feedback that holds, time without good input that is a fault, time of good input before the robot may be
armed, time after which a plate counts as unseen, and time after arming in which nothing is fired [s]."""
_SETTLING_PERIODS = 15  # nothing is fired in either, so that `plausibility` has judged three decisions before a shot
_LATE_PERIODS = 2.5


class Rules(NamedTuple):
    """What the gate keeps; `gate_rules` makes them."""

    limits: CommandLimits  # of the commands, (2,) each
    period: Array  # of decisions [s], ()
    stale: Array  # feedback that is older holds [s], ()
    late: Array  # a decision that comes later after the last one holds [s], ()
    lost: Array  # so long without good input, or feedback that is older, is a fault [s], ()
    steady: Array  # so long must the input be good before the robot may be armed [s], ()
    unseen: Array  # a plate that was not seen for longer is not shot at [s], ()
    settling: Array  # so long after it was armed nothing is fired [s], ()
    interval: Array  # least time between shots [s], ()
    near: Array  # largest distance of the gimbal from its command at a shot [rad], ()


class GateConfig(Struct, frozen=True, kw_only=True):
    """What a team may narrow; nothing here switches a rule off."""

    pitch: AxisLimits | None = None
    """Limits of the pitch command, within those of the robot."""
    yaw: AxisLimits | None = None
    """Limits of the yaw command, within those of the robot."""
    shots_per_s: Annotated[float, Meta(ge=0.2, le=1000.0)] | None = None
    """Most shots in a second, evenly spaced."""
    near_deg: Annotated[float, Meta(gt=0.0, le=180.0)] | None = None
    """Largest distance of the gimbal from its command at a shot [°]; controllers lead the gimbal, so a small one costs
    shots at moving targets."""


def gate_rules(robot: Robot, task: Task, config: GateConfig | None = None) -> Rules:
    """Return the rules of a robot in a task, in float32.

    Args:
      robot: has the limits of its commands.
      task: decision period and command limit.
      config: what is narrowed.

    Raises:
      InputError: if the configuration is wider than the robot's limits, the task limits commands by where the target
        really is, or decisions are so rare that one that is missing would be a fault.
    """
    if task.command_limit == "los-2deg":
        raise InputError("los-2deg limits commands by where the target really is, as no robot knows; take gate or box")
    config, period = config or GateConfig(), task.period_s
    late = max(STALE_S, _LATE_PERIODS * period)
    if late > LOST_S * (1.0 + 1e-9):
        most = f"at most {1e3 * LOST_S / _LATE_PERIODS:g} ms between decisions, got {1e3 * period:g} ms"
        raise InputError(f"task {task.name}: period_s: the gate needs {most}; choose a shorter period")
    rules = Rules(
        limits=robot.replace(limits=narrowed_limits(robot.limits, config)).command_limits(task),
        period=period,
        stale=STALE_S,
        late=late,
        lost=LOST_S,
        steady=STEADY_S,
        unseen=UNSEEN_S,
        settling=max(SETTLING_S, _SETTLING_PERIODS * period),
        interval=1.0 / config.shots_per_s if config.shots_per_s else 0.0,
        near=np.radians(config.near_deg) if config.near_deg else NEVER,
    )
    return single_precision(rules)


def narrowed_limits(limits: LimitsRecord, config: GateConfig) -> LimitsRecord:
    """Return limits with those of a configuration in their place.

    Args:
      limits: of the robot.
      config: what is narrowed.

    Raises:
      InputError: if it is wider.
    """
    for axis, own, given in (("pitch", limits.pitch, config.pitch), ("yaw", limits.yaw, config.yaw)):
        if given is None:
            continue
        is_within = own.ends[0] <= given.ends[0] and given.ends[1] <= own.ends[1]
        if not (is_within and given.max_rate <= own.max_rate and given.max_acceleration <= own.max_acceleration):
            raise InputError(f"gate.{axis}: expected limits within {own}, got {given}; narrow them, or remove them")
        limits = limits.replace(**{axis: given})
    return limits
