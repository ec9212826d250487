"""A camera and a link as a program meets them: what is seen is old, noisy, and sometimes missing.

Frames are exposed at a fixed rate and reach the program after a latency with jitter. A plate's place is measured in the
camera's frame, and turned into the base frame by the gimbal's angles at the moment that the program takes for the
exposure: an error of that moment shows where the gimbal turns.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.records.sensing import SensingRecord
from archerfish.targets.motion import TargetMotion

DRAWS = 8
"""Standard normals per decision: command latency, camera latency, miss, stamp, three of the position, feedback."""

_LARGEST = 2.0
"""Jitter is cut off at so many standard deviations: latencies are bounded."""


class Sensing(NamedTuple):
    """Camera and link; each field has shape (k,), one entry per draw of what is not known exactly."""

    frame_period: Array
    """Time between two exposures [s]."""
    latency: Array
    """Mean time from exposure to receipt [s]."""
    latency_jitter: Array
    """Its standard deviation [s]."""
    moment_error: Array
    """Error of the time offset between camera and gimbal [s]."""
    moment_jitter: Array
    """Standard deviation of the moment taken for an exposure [s]."""
    across: Array
    """Standard deviation of the azimuth and elevation at `noise_range` [rad], shape (k, 2)."""
    noise_range: Array
    """Distance at which they were measured [m]."""
    nearness: Array
    """How they grow towards the camera, as a power of the inverse distance: zero for the same angle at every distance,
    one for the same way across the line of sight."""
    along: Array
    """Standard deviation of the distance, relative to it."""
    miss: Array
    """Share of the decisions that bring no new frame, as the standard normal below which one is missed."""
    command_latency: Array
    """Mean time until a command reaches the gimbal [s]."""
    command_jitter: Array
    """Its standard deviation [s]."""
    feedback_period: Array
    """Time between two feedbacks [s]."""
    feedback_latency: Array
    """Mean time from the moment that a feedback shows to its receipt [s]."""
    feedback_jitter: Array
    """Its standard deviation [s]."""
    feedback_quantum: Array
    """Step of the angles in it [rad]; zero for none."""


class Sight(NamedTuple):
    """The latest frame that reached the program."""

    plate: Array
    """The plate in the base frame, as the program reckons [m], shape B + (3,)."""
    exposed: Array
    """Moment of its exposure since the engagement began [s], shape B."""
    fresh: Array
    """Whether it came since the last decision, shape B."""


def jittered(mean: Array, spread: Array, normal: Array) -> Array:
    """Return times ≥ 0 about a mean [s], for standard normals of the same shape."""
    xp = namespace(mean, normal)
    return xp.maximum(mean + spread * xp.clip(normal, -_LARGEST, _LARGEST), 0.0)


def phase(normal: Array) -> Array:
    """Turn a standard normal into a phase, as good as uniform in [0, 1), shape B."""
    return namespace(normal).remainder(16.0 * normal, 1.0)


def first_sight(
    sensing: Sensing, draw: Array, phases: Array, motion: TargetMotion, reported: Array, normals: Array
) -> Sight:
    """Return the latest frame when an engagement begins; cameras were running before.

    Args:
      sensing: camera and link.
      draw: which of the k draws, shape B.
      phases: of the camera, 0…1, shape B.
      motion: the target's path.
      reported: age of the latest feedback [s], shape B.
      normals: standard normals, shape B + (DRAWS,).
    """
    exposed = _latest_exposure(sensing, draw, phases, 0.0 * phases, normals, reported)
    still = namespace(normals).zeros((*exposed.shape, 2), dtype=exposed.dtype)
    return Sight(_measured(sensing, draw, motion.position(exposed), still, normals), exposed, exposed <= 0.0)


def next_sight(
    sensing: Sensing,
    draw: Array,
    phases: Array,
    sight: Sight,
    time: Array,
    motion: TargetMotion,
    rate: Array,
    reported: Array,
    normals: Array,
) -> Sight:
    """Return the latest frame at a later decision.

    A frame counts once the gimbal has reported from after its exposure, as it is then known where the camera pointed.

    Args:
      sensing: camera and link.
      draw: which of the k draws, shape B.
      phases: of the camera, 0…1, shape B.
      sight: at the decision before.
      time: of the decision [s], shape B.
      motion: the target's path.
      rate: pitch and yaw rate of the gimbal about the exposure [rad/s], shape B + (2,).
      reported: age of the latest feedback at the decision [s], shape B.
      normals: standard normals, shape B + (DRAWS,).
    """
    xp = namespace(time, normals)
    exposed = _latest_exposure(sensing, draw, phases, time, normals, reported)
    fresh = (exposed > sight.exposed + 1e-6) & (normals[..., 2] > sensing.miss[draw])
    plate = _measured(sensing, draw, motion.position(exposed), rate, normals)
    return Sight(xp.where(fresh[..., None], plate, sight.plate), xp.where(fresh, exposed, sight.exposed), fresh)


def _latest_exposure(
    sensing: Sensing, draw: Array, phases: Array, time: Array, normals: Array, reported: Array
) -> Array:
    xp = namespace(time, normals)
    period = sensing.frame_period[draw]
    latency = jittered(sensing.latency[draw], sensing.latency_jitter[draw], normals[..., 1])
    latency = xp.maximum(latency, reported)
    return (xp.floor((time - latency) / period - phases) + phases) * period


def _measured(sensing: Sensing, draw: Array, place: Array, rate: Array, normals: Array) -> Array:
    """Return a place as measured: noise along and across the line of sight, and what the gimbal turned meanwhile."""
    xp = namespace(place, normals)
    late = sensing.moment_error[draw] + sensing.moment_jitter[draw] * normals[..., 3]
    level = xp.sqrt(place[..., 0] ** 2 + place[..., 1] ** 2)
    nearer = (sensing.noise_range[draw] / level) ** sensing.nearness[draw]
    turned = rate * late[..., None] + nearer[..., None] * sensing.across[draw] * normals[..., 4:6]
    distance = 1.0 + sensing.along[draw] * normals[..., 6]
    x = place[..., 0] - turned[..., 1] * place[..., 1] - turned[..., 0] * place[..., 2] * place[..., 0] / level
    y = place[..., 1] + turned[..., 1] * place[..., 0] - turned[..., 0] * place[..., 2] * place[..., 1] / level
    z = place[..., 2] + turned[..., 0] * level
    return xp.stack([x, y, z], axis=-1) * distance[..., None]


def feedback_age(sensing: Sensing, draw: Array, phases: Array, time: Array, normals: Array) -> Array:
    """Return how old the latest feedback is at a decision [s], shape B.

    Args:
      sensing: camera and link.
      draw: which of the k draws, shape B.
      phases: of the feedback, 0…1, shape B.
      time: of the decision [s], shape B.
      normals: standard normals, shape B + (DRAWS,).
    """
    xp = namespace(time, normals)
    period = sensing.feedback_period[draw]
    latency = jittered(sensing.feedback_latency[draw], sensing.feedback_jitter[draw], normals[..., 7])
    newest = (xp.floor((time - latency) / period - phases) + phases) * period
    return time - newest


def quantised(sensing: Sensing, draw: Array, angle: Array) -> Array:
    """Round angles to the feedback's step, shape B + (2,)."""
    xp = namespace(angle)
    quantum = sensing.feedback_quantum[draw][..., None]
    step = xp.maximum(quantum, 1e-9)
    return xp.where(lift(quantum, angle) > 0.0, xp.round(angle / step) * step, angle)


def _feedback_share(record: SensingRecord) -> float:
    """Return what a latency that counts from the feedback lacks to one from the exposure: the feedback's delay [s]."""
    link = record.link
    late = link.feedback_latency if link.feedback_delay is None else link.feedback_delay
    return (late or 0.0) if record.camera.latency_basis == "feedback" else 0.0


def sensing_from_record(record: SensingRecord, draws: int = 1, seed: int = 0) -> Sensing:
    """Build camera and link from a record, and draw what it leaves open within its intervals.

    Bearing noise is taken to be the same angle at every distance, range noise the same share of it: one distance does
    not tell (`with_open_nearness` draws what it leaves open). What was not measured is taken to be zero.

    Args:
      record: as `identify sensing` writes it.
      draws: k; the first one is the best estimate where there is one only.
      seed: of the draws.
    """
    generator = np.random.default_rng([seed, 57])
    camera, link = record.camera, record.link

    def drawn(name: str, value: float | None, low: float = 0.0) -> Array:
        half = np.diff(record.intervals.get(name, (0.0, 0.0))).item() / (2 * 1.96)
        normals = generator.standard_normal(draws) if draws > 1 else np.zeros(1)
        return np.maximum((value or 0.0) + half * normals, low)

    across = np.stack([drawn(f"camera.{name}", getattr(camera, name)) for name in ("elevation_sd", "bearing_sd")], -1)
    return Sensing(
        frame_period=1.0 / drawn("camera.rate_hz", camera.rate_hz, 1e-3),
        latency=drawn("camera.latency", camera.latency) + _feedback_share(record),
        latency_jitter=drawn("camera.latency_jitter", camera.latency_jitter),
        moment_error=drawn("camera.time_offset", 0.0, -np.inf),
        moment_jitter=drawn("camera.stamp_jitter", camera.stamp_jitter),
        across=across,
        noise_range=np.full(draws, camera.noise_range),
        nearness=np.zeros(draws),
        along=drawn("camera.range_sd", camera.range_sd) / camera.noise_range,
        miss=np.full(draws, ndtri(np.clip(camera.miss_probability, 1e-9, 1 - 1e-9))),
        command_latency=drawn("link.command_latency", link.command_latency),
        command_jitter=drawn("link.command_latency_jitter", link.command_latency_jitter),
        feedback_period=1.0 / drawn("link.feedback_rate_hz", link.feedback_rate_hz, 1e-3),
        feedback_latency=drawn("link.feedback_latency", link.feedback_latency),
        feedback_jitter=drawn("link.feedback_latency_jitter", link.feedback_latency_jitter),
        feedback_quantum=np.full(draws, link.feedback_quantum or 0.0),
    )


def with_open_nearness(sensing: Sensing) -> Sensing:
    """Return camera and link whose noise grows towards the camera by another power in each draw, evenly from 0 to 1.

    The noise across the line of sight was measured at one distance. Whether it is the same angle nearer by, as of a
    detector's pixels, or the same way, as of a plate's blurred edges, the record does not tell: a policy should do
    well in either case. A single draw stays as it is.
    """
    count = len(sensing.nearness)
    drawn = np.random.default_rng(58).permutation(np.linspace(0.0, 1.0, count)) if count > 1 else sensing.nearness
    return sensing._replace(nearness=drawn.astype(sensing.across.dtype))
