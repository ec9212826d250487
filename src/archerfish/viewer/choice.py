"""What a person chooses on the page, and the world that follows from it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from archerfish.controllers.guarded_policy import controller_from_record
from archerfish.controllers.own_decision import WatchedController
from archerfish.controllers.roster import CONTROLLERS, Listed, Tuning, Workbench, build_controller
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.tuning import starting_point
from archerfish.paper.conditions import Conditions
from archerfish.paper.tuning import paper_settings
from archerfish.records.errors import InputError
from archerfish.records.limits import LimitsRecord
from archerfish.records.muzzle import MuzzleRecord
from archerfish.records.plant import PlantRecord
from archerfish.records.policy import PolicyRecord
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.sensing.kalman_filter import noise_from_record
from archerfish.simulation.environment import PureWorld
from archerfish.simulation.setting import make_world
from archerfish.targets.own_motion import OwnMotion
from archerfish.viewer.motions import HAND, MOTIONS

SHORTEST_SHOWN_S = 1e-4
"""Latencies below this are none [s]."""
FEEDBACK_RATE_HZ = 1000.0
"""Of the link that stands in where no sensing record is given and a latency is asked for [Hz]."""


@dataclass(frozen=True)
class Subject:
    """The robot on the page, and the policies that may steer it."""

    name: str
    """"paper" or "identified-<robot>"."""
    pitch: PlantRecord
    """Pitch axis."""
    yaw: PlantRecord
    """Yaw axis."""
    muzzle: MuzzleRecord
    """Muzzle."""
    sensing: SensingRecord | None
    """Camera and link; None where they are immediate and perfect."""
    limits: LimitsRecord
    """Ranges, rates and accelerations."""
    conditions: Conditions
    """Period, hit radius, length of an engagement, and the paper's target."""
    command_limit: str
    """"box", "gate" or "los-2deg"."""
    policies: Mapping[str, PolicyRecord] = field(default_factory=dict)
    """Name on the page → policy."""
    own_controllers: Mapping[str, Listed] = field(default_factory=dict)
    """Name on the page → controller of the user's own, found before the page opens."""
    own_motions: Mapping[str, OwnMotion] = field(default_factory=dict)
    """Name on the page → target motion of the user's own, found before the page opens."""


@dataclass(frozen=True)
class Choice:
    """Everything that makes one trial; equal choices give equal trials. `RANGES` has the bounds of the numbers."""

    controller: str
    """A policy's name, one of the classical controllers, or one of the user's own."""
    motion: str
    """One of `motions.MOTIONS`, of the user's own, or `motions.HAND`."""
    distance: float = 3.0
    """From the pivot to the middle of the target's way [m]."""
    speed: float = 0.35
    """Of the target [m/s]."""
    dispersion: float = 1.0
    """Scale of the muzzle's dispersion angles."""
    camera_latency: float = 0.0
    """Added to that of the camera [s]."""
    command_latency: float = 0.0
    """Added to that of the commands [s]."""
    engagements: int = 12
    """Meetings with a target that one trial is made of."""
    seed: int = 0
    """Of the targets and the dispersion."""


RANGES = {
    "distance": (1.0, 8.0),
    "speed": (0.0, 3.0),
    "dispersion": (0.0, 4.0),
    "camera_latency": (0.0, 0.1),
    "command_latency": (0.0, 0.1),
}
"""Field of `Choice` → smallest and largest value: m, m/s, 1, s, s."""
_ROUNDING = 1e-9


def controller_names(subject: Subject) -> tuple[str, ...]:
    """Return who may steer: the policies, the user's own controllers, then the classical ones."""
    return tuple(dict.fromkeys((*subject.policies, *subject.own_controllers, *CONTROLLERS)))


def motion_names(subject: Subject) -> tuple[str, ...]:
    """Return how the target may move."""
    return tuple(dict.fromkeys((*MOTIONS, *subject.own_motions, HAND)))


def check_choice(subject: Subject, choice: Choice) -> None:
    """Refuse a choice that makes no trial; it may come from a stranger at the page, whom nothing else holds to it.

    Raises:
      InputError: naming what is out of range.
    """
    if choice.controller not in controller_names(subject):
        raise InputError(f"controller must be one of {', '.join(controller_names(subject))}, got {choice.controller!r}")
    if choice.motion not in motion_names(subject):
        raise InputError(f"motion must be one of {', '.join(motion_names(subject))}, got {choice.motion!r}")
    for name, (low, high) in RANGES.items():
        value = getattr(choice, name)
        # A slider's step may end a rounding beyond its range; NaN is in none.
        if not low - _ROUNDING <= value <= high + _ROUNDING:
            raise InputError(f"{name.replace('_', ' ')} must be within {low:g}…{high:g}, got {value:g}")
    if choice.engagements < 2:
        raise InputError(f"engagements must be at least 2, got {choice.engagements}; intervals need several")


def chosen_sensing(subject: Subject, choice: Choice) -> SensingRecord | None:
    """Return the camera and link that a choice asks for: None where they are immediate and perfect.

    Where the robot has no sensing record, a latency brings a link and a camera with no fault but that.
    """
    late = max(choice.camera_latency, choice.command_latency) >= SHORTEST_SHOWN_S
    if not late:
        return subject.sensing
    sensing = subject.sensing or _plain_sensing(subject.conditions)
    camera, link = sensing.camera, sensing.link
    return replace(
        sensing,
        camera=replace(
            camera,
            latency=(camera.latency or 0.0) + choice.camera_latency,
            latency_basis=camera.latency_basis or "exposure",
        ),
        link=replace(link, command_latency=(link.command_latency or 0.0) + choice.command_latency),
    )


def _plain_sensing(conditions: Conditions) -> SensingRecord:
    noise = conditions.position_noise
    camera = CameraRecord(
        rate_hz=1.0 / conditions.control_period_s,
        time_offset=0.0,
        stamp_jitter=0.0,
        bearing_sd=noise,
        elevation_sd=noise,
        range_sd=noise,
        noise_range=1.0,
        miss_probability=0.0,
        outlier_share=0.0,
        latency=0.0,
        latency_basis="exposure",
    )
    return SensingRecord(camera, LinkRecord(feedback_rate_hz=FEEDBACK_RATE_HZ, command_latency=0.0))


def chosen_muzzle(subject: Subject, choice: Choice) -> MuzzleRecord:
    """Return the muzzle with its dispersion scaled."""
    scale, muzzle = choice.dispersion, subject.muzzle
    return replace(muzzle, pitch_sd=scale * muzzle.pitch_sd, yaw_sd=scale * muzzle.yaw_sd, intervals=_kept(muzzle))


def _kept(muzzle: MuzzleRecord) -> dict[str, tuple[float, float]]:
    # The interval of a dispersion is that of the unscaled one.
    return {name: ends for name, ends in muzzle.intervals.items() if not name.endswith("_sd")}


def chosen_world(subject: Subject, choice: Choice) -> PureWorld:
    """Build the world of a choice; it runs in NumPy, so a new one compiles nothing."""
    return make_world(
        subject.pitch,
        subject.yaw,
        chosen_muzzle(subject, choice),
        subject.limits,
        subject.command_limit,
        subject.conditions,
        sensing=chosen_sensing(subject, choice),
    )


def chosen_controller(subject: Subject, choice: Choice) -> Any:
    """Build the controller of a choice, which knows the latency of the commands as the robot's own program would."""
    if choice.controller in subject.policies:
        return controller_from_record(subject.policies[choice.controller])
    sensing, conditions = chosen_sensing(subject, choice), subject.conditions
    latency = (sensing.link.command_latency or 0.0) if sensing else 0.0
    bench = Workbench(
        model=gimbal_model(subject.pitch, subject.yaw, conditions.control_period_s, latency),
        muzzle=muzzle_from_record(chosen_muzzle(subject, choice)),
        limits=named_limits(subject.command_limit, subject.limits, conditions.line_of_sight_lead),
        conditions=conditions,
        # The stand-in camera has no noise; a filter that believed so would not filter.
        noise=noise_from_record(subject.sensing, 0.0) if subject.sensing else None,
    )
    bench = bench._replace(tuning=_tuning(subject, choice.controller))
    own = subject.own_controllers.get(choice.controller)
    if own is not None and own.extension is not None:
        return WatchedController(build_controller(own, bench), own.extension)
    # Never found by its name: that may be a stranger's word.
    if choice.controller not in CONTROLLERS:
        raise InputError(f"controller must be one of {', '.join(controller_names(subject))}, got {choice.controller!r}")
    return build_controller(Listed(choice.controller, CONTROLLERS[choice.controller], None), bench)


def _tuning(subject: Subject, controller: str) -> Tuning | None:
    """Return the settings of a classical controller: tuned for the printed gimbal, typical for any other robot.

    Nobody waits for a page to tune.
    """
    if subject.name != "paper":
        return starting_point(controller)
    settings = paper_settings(subject.command_limit).get(controller)
    return None if settings is None else Tuning(**settings)
