"""Worlds and scenarios from records: who shoots at what, where, with which gimbal."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.delayed_gimbal import delayed_gimbal, longest_wait
from archerfish.dynamics.linear_axis import gimbal_draws, gimbal_model
from archerfish.dynamics.muzzle import Muzzle, muzzle_from_record
from archerfish.paper.conditions import Conditions
from archerfish.records.errors import InputError
from archerfish.records.limits import LimitsRecord
from archerfish.records.muzzle import MuzzleRecord
from archerfish.records.plant import PlantRecord
from archerfish.records.sensing import SensingRecord
from archerfish.sensing.camera import Sensing, jittered, sensing_from_record
from archerfish.simulation.environment import PureWorld
from archerfish.simulation.identified import IdentifiedWorld
from archerfish.simulation.scenario import Scenario
from archerfish.simulation.shooting import ShootingWorld

OLDEST_FEEDBACK_S = 0.25
"""Age beyond which feedback is of no use to anybody [s]."""


def make_world(
    pitch: PlantRecord,
    yaw: PlantRecord,
    muzzle: MuzzleRecord,
    limits: LimitsRecord,
    command_limit: str,
    conditions: Conditions,
    position_noise: tuple[float, float] | None = None,
    sensing: SensingRecord | None = None,
) -> PureWorld:
    """Build a shooting world in float32.

    Args:
      pitch: plant of the pitch axis; its posterior draws are used where both axes have them.
      yaw: plant of the yaw axis, likewise.
      muzzle: speed, dispersion and drag.
      limits: ranges, rates and accelerations.
      command_limit: "box", "gate" or "los-2deg".
      conditions: control period and the lead that `los-2deg` allows.
      position_noise: standard deviation of the seen position along and across the line of sight [m].
      sensing: camera and link; immediate and perfect but for the position noise where none is given.

    Raises:
      InputError: if the command limit is unknown, a plant does not fit the control period, or feedback is older than
        a robot's program remembers it.
    """
    period = conditions.control_period_s
    if sensing is not None:
        return _identified_world(pitch, yaw, muzzle, limits, command_limit, conditions, sensing)
    model = gimbal_draws(pitch, yaw, period) or gimbal_model(pitch, yaw, period)
    world = ShootingWorld(
        period=np.asarray(period),
        gimbal=model,
        muzzle=muzzle_from_record(muzzle),
        limits=named_limits(command_limit, limits, conditions.line_of_sight_lead),
        angle_low=np.array([limits.pitch.low, limits.yaw.low]),
        angle_high=np.array([limits.pitch.high, limits.yaw.high]),
        position_noise=np.array(position_noise or (conditions.position_noise,) * 2),
    )
    built: ShootingWorld = single_precision(world)
    return built


def _identified_world(
    pitch: PlantRecord,
    yaw: PlantRecord,
    muzzle: MuzzleRecord,
    limits: LimitsRecord,
    command_limit: str,
    conditions: Conditions,
    sensing: SensingRecord,
) -> IdentifiedWorld:
    period = conditions.control_period_s
    gimbal = delayed_gimbal(pitch, yaw, period)
    count = len(gimbal.rest)
    drawn = sensing_from_record(sensing, count)
    # Of all draws: a command that finds no place would act at once.
    longest = np.max(jittered(drawn.command_latency, drawn.command_jitter, np.full(count, np.inf)))
    world = IdentifiedWorld(
        period=np.asarray(period),
        gimbal=gimbal,
        sensing=drawn,
        muzzles=muzzle_draws(muzzle, count),
        muzzle=muzzle_from_record(muzzle),
        model=gimbal_model(pitch, yaw, period, sensing.link.command_latency or 0.0),
        limits=named_limits(command_limit, limits, conditions.line_of_sight_lead),
        angle_low=np.array([limits.pitch.low, limits.yaw.low]),
        angle_high=np.array([limits.pitch.high, limits.yaw.high]),
        queue=np.ones(longest_wait(gimbal, longest / float(gimbal.tick))),
        past=np.ones(_periods_back(drawn, period)),
    )
    built: IdentifiedWorld = single_precision(world)
    return built


def _periods_back(drawn: Sensing, period: float) -> int:
    """Return how many periods back the world must remember the axes for the oldest feedback.

    Raises:
      InputError: if that is more than can be meant.
    """
    latency = jittered(drawn.feedback_latency, drawn.feedback_jitter, np.full(len(drawn.feedback_latency), np.inf))
    oldest = float(np.max(latency + drawn.feedback_period))
    if oldest > OLDEST_FEEDBACK_S:
        raise InputError(
            f"feedback is up to {oldest:.3g} s old by the sensing record, expected at most {OLDEST_FEEDBACK_S} s; have "
            "the gimbal report more often, or mend its link"
        )
    return max(2, int(np.ceil(oldest / period - 1e-6)))


def muzzle_draws(record: MuzzleRecord, count: int, seed: int = 0) -> Muzzle:
    """Draw muzzles from the intervals of a record, or repeat its best estimate where it has none.

    Args:
      record: the muzzle.
      count: k draws; with one, it is the best estimate.
      seed: of the draws.

    Returns:
      Fields of shape (k,) and (k, 2).
    """
    generator = np.random.default_rng([seed, 58])

    def drawn(name: str) -> NDArray[np.float64]:
        low, high = record.intervals.get(name, (0.0, 0.0))
        normals = generator.standard_normal(count) if count > 1 else np.zeros(count)
        # Only the offsets may be negative.
        values = getattr(record, name) + (high - low) / (2 * 1.96) * normals
        return np.asarray(values if name.endswith("_offset") else np.maximum(values, 0.0))

    pairs = {each: np.stack([drawn(f"{axis}_{each}") for axis in ("pitch", "yaw")], -1) for each in ("offset", "sd")}
    return Muzzle(**{name: drawn(name) for name in ("speed", "speed_sd", "drag", "length")}, **pairs)


def make_scenario(
    conditions: Conditions,
    range_m: tuple[float, float] | None = None,
    static_share: float = 0.0,
    plants: int = 1,
    motion: Any = (),
    short: tuple[float, float] | None = None,
) -> Scenario:
    """Build the distribution of engagements of Tables II–V in float32.

    Args:
      conditions: offsets, speeds and the shape of the path.
      range_m: smallest and largest distance [m]; all the tables' ranges where none is given.
      static_share: share of the targets that stand still, 0…1.
      plants: number of posterior draws of the world's plant.
      motion: how targets move, as in `Scenario`.
      short: share of the engagements that are shorter than the conditions', and their length [s]; none if not given.
    """
    bins = conditions.range_bins
    low, high = range_m or (min(low for low, _ in bins), max(high for _, high in bins))
    scenario = Scenario(
        range_low=low,
        range_high=high,
        lateral=conditions.max_lateral_offset,
        height=conditions.armor_height,
        max_speed=conditions.max_lateral_speed,
        half_width=conditions.reversal_half_width,
        curvature=conditions.parabola_curvature,
        static_share=static_share,
        start=np.array([conditions.start_pitch, conditions.start_yaw]),
        plants=float(plants),
        lengths=np.array([short[1] if short else conditions.engagement_s, conditions.engagement_s]),
        short_share=np.asarray(short[0] if short else 0.0),
        motion=motion,
    )
    built: Scenario = single_precision(scenario)
    return built


def paper_muzzle(conditions: Conditions) -> MuzzleRecord:
    """Return the muzzle that the paper's conditions assume; its pellets start at the pivot."""
    return MuzzleRecord(
        speed=conditions.muzzle_speed,
        speed_sd=conditions.muzzle_speed_sd,
        pitch_offset=0.0,
        pitch_sd=conditions.dispersion,
        yaw_offset=0.0,
        yaw_sd=conditions.dispersion,
        drag=conditions.drag,
    )
