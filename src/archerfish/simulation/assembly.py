"""A shooting environment put together by names, from records or from the paper's gimbal."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.paper.conditions import Conditions, assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.errors import InputError, file_error
from archerfish.records.extensions import is_extension
from archerfish.records.limits import LimitsRecord
from archerfish.records.muzzle import MuzzleRecord
from archerfish.records.own_plant import find_plant
from archerfish.records.plant import PlantRecord, read_plant
from archerfish.records.sensing import SensingRecord
from archerfish.sensing.camera import with_open_nearness
from archerfish.sensing.kalman_filter import TrackerNoise, noise_from_record
from archerfish.sensing.multimodel_observation import EXACT_SIGHT_SD, FAST_ACCELERATION, multimodel_observer
from archerfish.sensing.observation import ACTION_SCALES, make_observer
from archerfish.sensing.observers import AnyObserver
from archerfish.sensing.tracked_observation import TRACKER_ACCELERATION, tracked_observer
from archerfish.simulation.environment import HIDDEN, PureWorld, ShootingEnvironment
from archerfish.simulation.identified import IdentifiedWorld
from archerfish.simulation.reward import EQ_8, Reward
from archerfish.simulation.scenario import LONG_S, SHORT, TARGETS, draw_engagement
from archerfish.simulation.setting import make_scenario, make_world, paper_muzzle
from archerfish.targets.drawn import DRAWN, drawn_motion
from archerfish.targets.own_motion import OwnMotion, check_paths, find_motion

PAPER = "paper"
"""The plant that needs no file."""
_CHECKED = 400
"""Targets of a user's own motion that are looked at before anything is trained on them."""
Plants = str | Path | tuple[PlantRecord, PlantRecord]
"""The paper's gimbal, a folder with pitch.json and yaw.json, or the records of pitch and yaw."""


def make_environment(
    plant: Plants = PAPER,
    target: str = "paper",
    command_limit: str = "gate",
    observation: str = "",
    frames: int = 4,
    decisions: int | None = None,
    hit_bonus: float = 0.0,
    muzzle: MuzzleRecord | None = None,
    sensing: SensingRecord | None = None,
    limits: LimitsRecord | None = None,
    motion: str = "",
) -> ShootingEnvironment:
    """Put an environment together.

    Args:
      plant: "paper", a folder as `archerfish identify gimbal` writes it, one of your own as `own_plant.find_plant`
        takes it, or two records.
      target: "paper", or only its "static" or its "dynamic" targets; or one of `targets.drawn`.
      command_limit: "box", "gate" or "los-2deg".
      observation: "history", "paper" or "tracked"; the last where there is a sensing record, else the first.
      frames: that the history observation remembers.
      decisions: length of an engagement; that of the paper's conditions if not given.
      hit_bonus: what a hit adds to the reward of eq (8) [m].
      muzzle: the muzzle; that of the paper's conditions if not given.
      sensing: camera and link; immediate and perfect if not given.
      limits: ranges, rates and accelerations; the paper's ranges with GM6020 motors if not given.
      motion: how targets move, one of your own as `own_motion.find_motion` takes it; as eq (7) says if not given.

    Raises:
      InputError: if a name is unknown, or a record can't be used.
    """
    if target not in (*TARGETS, *DRAWN):
        raise InputError(f"target must be one of {', '.join((*TARGETS, *DRAWN))}, got {target!r}")
    conditions = assumed_conditions()
    usual = round(LONG_S / conditions.control_period_s) if target in DRAWN else conditions.decisions
    if motion and target in DRAWN:
        raise InputError(
            f"motion takes the place of eq (7), by which target {target!r} does not move; leave one of the two out"
        )
    length = usual if decisions is None else decisions
    if length < 1:
        raise InputError(f"decisions must be at least 1, got {length}")
    muzzle, limits = muzzle or paper_muzzle(conditions), limits or gate_limits()
    pitch, yaw = _plants(plant)
    world = make_world(pitch, yaw, muzzle, limits, command_limit, conditions, sensing=sensing)
    kind = observation or ("history" if sensing is None else "tracked")
    observer = observer_in(world, kind, frames, muzzle, sensing, command_limit)
    own = find_motion(motion) if motion else None
    environment = environment_in(
        world,
        conditions,
        observer,
        TARGETS.get(target, 0.0),
        Reward(hit=np.float32(hit_bonus)),
        motion=own,
        target=target if target in DRAWN else "",
    )
    return environment._replace(length=np.asarray(length, np.int32))


def environment_in(
    world: PureWorld,
    conditions: Conditions,
    observer: AnyObserver,
    static_share: float,
    reward: Reward = EQ_8,
    asymmetric: bool = False,
    motion: OwnMotion | None = None,
    target: str = "",
) -> ShootingEnvironment:
    """Build the environment of a world in float32.

    Args:
      world: where.
      conditions: offsets, speeds, length of an engagement, and what counts as a hit.
      observer: seen how.
      static_share: share of the targets that stand still.
      reward: what a decision is worth.
      asymmetric: whether a critic gets to see where the target really is and will be.
      motion: how targets move, if not as eq (7) says.
      target: one of `targets.drawn`, met for two lengths, in the place of the paper's targets and of `motion`.

    Raises:
      InputError: if targets of that motion are nowhere, or behind the gimbal.
    """
    drawer = motion.drawer if motion else ()
    scenario = make_scenario(conditions, static_share=static_share, plants=world.plants, motion=drawer)
    if target:
        conditions = replace(conditions, engagement_s=LONG_S)
        if isinstance(world, IdentifiedWorld):
            world = world._replace(sensing=with_open_nearness(world.sensing))
        scenario = make_scenario(conditions, plants=world.plants, motion=drawn_motion(target), short=SHORT)
    if motion:
        uniforms = np.random.default_rng(0).random((_CHECKED, scenario.uniforms), dtype=np.float32)
        check_paths(motion, draw_engagement(scenario, uniforms).motion, conditions.engagement_s)
    return ShootingEnvironment(
        world,
        scenario,
        single_precision(observer),
        np.asarray(conditions.decisions, np.int32),
        reward=single_precision(reward),
        hit_radius=np.float32(conditions.hit_radius),
        hidden=np.ones(HIDDEN if asymmetric else 0, np.float32),
    )


def observer_in(
    world: PureWorld, kind: str, frames: int, muzzle: MuzzleRecord, sensing: SensingRecord | None, command_limit: str
) -> AnyObserver:
    """Build what a policy sees of a world.

    Args:
      world: where.
      kind: "history", "paper", "tracked" or "multimodel".
      frames: that the history observation remembers.
      muzzle: to aim with.
      sensing: camera and link, for the tracked observation.
      command_limit: "box", "gate" or "los-2deg"; sets the scale of the actions.

    Raises:
      InputError: if the kind is unknown, or lacks its sensing record.
    """
    scale, aimed = ACTION_SCALES[command_limit], muzzle_from_record(muzzle)
    braking = np.asarray(world.limits.max_acceleration) * world.period_s**2
    if kind == "multimodel":
        exact = TrackerNoise(*(np.asarray(each) for each in (FAST_ACCELERATION, EXACT_SIGHT_SD, EXACT_SIGHT_SD)))
        noise = exact if sensing is None else noise_from_record(sensing, FAST_ACCELERATION)
        return multimodel_observer(aimed, noise, world.period_s, scale, braking)
    if kind != "tracked":
        return make_observer(kind, aimed, frames, scale, braking)
    if sensing is None:
        raise InputError(
            "the tracked observation needs a sensing record; give one (--sensing), or take the history observation"
        )
    return tracked_observer(aimed, noise_from_record(sensing, TRACKER_ACCELERATION), world.period_s, scale, braking)


def _plants(plant: Plants) -> tuple[PlantRecord, PlantRecord]:
    if isinstance(plant, tuple):
        return plant
    if plant == PAPER:
        printed = printed_plants()
        return printed["pitch"], printed["yaw"]
    if not Path(plant).exists() and is_extension(str(plant), "plant"):
        return find_plant(str(plant), "pitch")[0], find_plant(str(plant), "yaw")[0]
    return _read_axis(Path(plant), "pitch"), _read_axis(Path(plant), "yaw")


def _read_axis(folder: Path, axis: str) -> PlantRecord:
    path = folder / f"{axis}.json"
    record = read_plant(path)
    if record.quality is not None and not record.quality.usable:
        raise file_error(
            path, f"the plant fits {record.quality.log} to {record.quality.fit_percent:.1f} % only", "identify it anew"
        )
    return record
