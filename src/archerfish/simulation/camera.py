"""Camera, link and delayed axes of an identified robot: commands come late, what is seen is old, noisy and incomplete.

Frames are exposed at a fixed rate and reach the program after a latency with jitter. A plate's place is measured in the
camera's frame, and turned into the base frame by the gimbal's angles at the moment that the program takes for the
exposure: an error of that moment shows where the gimbal turns. Every engagement has its own draw of what the logs
leave open: axes, delays of link and camera, error of the camera's time offset.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace, select, tree
from archerfish.dynamics.delayed_axis import DelayedGimbal, DelayedState, angle_and_rate, rest_under, run, send
from archerfish.dynamics.muzzle import NORMALS as PELLET_NORMALS
from archerfish.protocols import Engagement, Frames, GimbalFeedback
from archerfish.records.sensing import SensingRecord

LARGEST_JITTER = 2.0
"""Jitter is cut off at so many standard deviations: latencies are bounded."""
SENDING, LATENCY, MISSED, STAMP, PLACE, FEEDBACK = (PELLET_NORMALS + place for place in (0, 1, 2, 3, 4, 7))
"""Index of the normals of a decision: command latency, camera latency, missed frame, stamp, place (3), feedback."""


class Sensing(NamedTuple):
    """Camera and link; each field has shape (k,), one entry per draw of what is not known exactly."""

    frame_period: Array  # time between two exposures [s]
    latency: Array  # mean time from exposure to receipt [s]
    latency_jitter: Array  # its standard deviation [s]
    moment_error: Array  # error of the time offset between camera and gimbal [s]
    moment_jitter: Array  # standard deviation of the moment taken for an exposure [s]
    across: Array  # standard deviation of elevation and azimuth at `noise_range` [rad], (k, 2)
    noise_range: Array  # distance at which they were measured [m]
    nearness: Array  # how they grow towards the camera, as a power of the inverse distance: 0 the same angle at every
    #                  distance, 1 the same length across the line of sight
    along: Array  # standard deviation of the distance, relative to it
    miss: Array  # share of the decisions that bring no new frame, as the standard normal below which one is missed
    command_latency: Array  # mean time until a command reaches the gimbal [s]
    command_jitter: Array  # its standard deviation [s]
    feedback_period: Array  # time between two feedbacks [s]
    feedback_latency: Array  # mean time from the moment that a feedback shows to its receipt [s]
    feedback_jitter: Array  # its standard deviation [s]
    feedback_quantum: Array  # step of the angles in it [rad]; zero for none


class LinkedState(NamedTuple):
    """What axes, camera and link of running engagements remember."""

    axes: DelayedState  # now
    before: tuple[DelayedState, ...]  # just after each of the last decisions, oldest first
    feedback: GimbalFeedback  # latest
    place: Array  # of the plate in the latest frame, as measured [m], B + (3,)
    exposed: Array  # moment of its exposure since the engagement began [s], B
    fresh: Array  # whether it came since the last decision, bool, B
    phases: Array  # of camera and feedback against the decisions, 0…1, B + (2,)


@tree(static=("queue", "past"))
class LinkedHardware:
    """Delayed axes, a camera and a link."""

    gimbal: DelayedGimbal  # k draws
    sensing: Sensing  # k draws
    low: Array  # mechanical stops [rad], (2,)
    high: Array  # mechanical stops [rad], (2,)
    queue: int  # commands that may be in force or on their way
    past: int  # periods that feedback may reach back

    normals = PELLET_NORMALS + 8

    @property
    def plants(self) -> int:
        """Number of posterior draws."""
        return int(self.gimbal.rest.shape[0])

    def begin(self, engagement: Engagement, time: Array, normals: Array) -> LinkedState:
        """Begin with the gimbal at rest and the camera running, shape B."""
        draw = engagement.plant
        phases = namespace(normals).remainder(16.0 * normals[..., :2], 1.0)  # as good as uniform
        axes = rest_under(self.gimbal, draw, engagement.start, self.queue)
        angle, rate = angle_and_rate(self.gimbal, draw, axes)
        age = feedback_age(self.sensing, draw, phases[..., 1], time, normals)
        exposed = latest_exposure(self.sensing, draw, phases[..., 0], time, age, normals)
        place = measured_place(self.sensing, draw, plate_place(engagement, exposed), 0.0 * angle, normals)
        feedback = GimbalFeedback(quantised(self.sensing, draw, angle), rate, age)
        return LinkedState(axes, (axes,) * (self.past - 1), feedback, place, exposed, exposed <= 0.0, phases)

    def step(
        self, state: LinkedState, engagement: Engagement, command: Array, time: Array, normals: Array
    ) -> LinkedState:
        """Send a command and let a period pass, until `time`; shape B."""
        sensing, draw = self.sensing, engagement.plant
        latency = jittered(sensing.command_latency[draw], sensing.command_jitter[draw], normals[..., SENDING])
        sent = send(self.gimbal, draw, state.axes, command, latency)
        axes = run(self.gimbal, draw, sent, 0.0 * latency + self._ticks)
        feedback = self._feedback(state, sent, draw, time, normals)
        exposed = latest_exposure(sensing, draw, state.phases[..., 0], time, feedback.age, normals)
        fresh = (exposed > state.exposed + 1e-6) & (normals[..., MISSED] > sensing.miss[draw])
        place = measured_place(sensing, draw, plate_place(engagement, exposed), state.feedback.rate, normals)
        place, exposed = select(fresh, (place, exposed), (state.place, state.exposed))
        return LinkedState(axes, (*state.before, sent)[1:], feedback, place, exposed, fresh, state.phases)

    def frames(self, state: LinkedState, time: Array) -> Frames:
        """Return the latest frame, F = S = 1, with the age that its exposure has now, shape B."""
        xp = namespace(time)
        fresh = state.fresh[..., None]
        place = xp.where(fresh, state.place, 0.0 * state.place)
        age = xp.where(fresh, (time - state.exposed)[..., None], 0.0 * time[..., None])
        yaw = xp.where(fresh, 0.0 * age + xp.pi, 0.0 * age)
        return Frames(fresh, age, fresh[..., None], place[..., None, None, :], yaw[..., None])

    def angle_and_rate(self, state: LinkedState, engagement: Engagement) -> tuple[Array, Array]:
        """Return true pitch and yaw within the stops [rad] and their rates [rad/s], shape B + (2,) each."""
        angle, rate = angle_and_rate(self.gimbal, engagement.plant, state.axes)
        return self._within_stops(angle), rate

    def feedback(self, state: LinkedState, engagement: Engagement) -> GimbalFeedback:  # noqa: ARG002
        """Return the latest feedback, shape B."""
        return state.feedback

    @property
    def _ticks(self) -> int:
        return int(self.gimbal.transition.shape[1]) - 1

    def _feedback(
        self, state: LinkedState, sent: DelayedState, draw: Array, time: Array, normals: Array
    ) -> GimbalFeedback:
        """Return the latest feedback, of the axes as they were at its sampling."""
        xp = namespace(time)
        age = feedback_age(self.sensing, draw, state.phases[..., 1], time, normals)
        states, ticks = (*state.before, sent), self._ticks
        since = xp.clip(len(states) * ticks - xp.round(age / self.gimbal.tick), 0.0, len(states) * ticks)
        begin = states[0]
        for state_after in states[1:]:
            later = since >= ticks
            since = xp.where(later, since - ticks, since)
            begin = select(later, state_after, begin)
        angle, rate = angle_and_rate(self.gimbal, draw, run(self.gimbal, draw, begin, since))
        return GimbalFeedback(quantised(self.sensing, draw, self._within_stops(angle)), rate, age)

    def _within_stops(self, angle: Array) -> Array:
        return namespace(angle).clip(angle, lift(self.low, angle), lift(self.high, angle))


def plate_place(engagement: Engagement, time: Array) -> Array:
    """Return where the target's first plate is at a time [s] of shape B, in O [m], shape B + (3,)."""
    return engagement.target.at(time).position[..., 0, :]


def jittered(mean: Array, spread: Array, normal: Array) -> Array:
    """Return times ≥ 0 about a mean [s], for standard normals of the same shape."""
    xp = namespace(mean, normal)
    return xp.maximum(mean + spread * xp.clip(normal, -LARGEST_JITTER, LARGEST_JITTER), 0.0)


def latest_exposure(
    sensing: Sensing, draw: Array, phases: Array, time: Array, reported: Array, normals: Array
) -> Array:
    """Return the moment of exposure of the latest frame that counts [s], shape B.

    A frame counts once the gimbal has reported from after its exposure, as only then the camera's direction is known.

    Args:
      sensing: camera and link.
      draw: which of the k draws, shape B.
      phases: of the camera, 0…1, shape B.
      time: of the decision [s], shape B.
      reported: age of the latest feedback [s], shape B.
      normals: of the decision, shape B + (n,).
    """
    xp = namespace(time, normals)
    period = sensing.frame_period[draw]
    latency = jittered(sensing.latency[draw], sensing.latency_jitter[draw], normals[..., LATENCY])
    latency = xp.maximum(latency, reported)
    return (xp.floor((time - latency) / period - phases) + phases) * period


def measured_place(sensing: Sensing, draw: Array, place: Array, rate: Array, normals: Array) -> Array:
    """Return a place as measured: noise along and across the line of sight, and what the gimbal turned meanwhile.

    Args:
      sensing: camera and link.
      draw: which of the k draws, shape B.
      place: at the exposure [m], shape B + (3,).
      rate: pitch and yaw rate of the gimbal about then [rad/s], shape B + (2,).
      normals: of the decision, shape B + (n,).
    """
    xp = namespace(place, normals)
    late = sensing.moment_error[draw] + sensing.moment_jitter[draw] * normals[..., STAMP]
    level = xp.sqrt(place[..., 0] ** 2 + place[..., 1] ** 2)
    nearer = (sensing.noise_range[draw] / level) ** sensing.nearness[draw]
    noise = nearer[..., None] * sensing.across[draw] * normals[..., PLACE : PLACE + 2]
    turned = rate * late[..., None] + noise
    distance = 1.0 + sensing.along[draw] * normals[..., PLACE + 2]
    x = place[..., 0] - turned[..., 1] * place[..., 1] - turned[..., 0] * place[..., 2] * place[..., 0] / level
    y = place[..., 1] + turned[..., 1] * place[..., 0] - turned[..., 0] * place[..., 2] * place[..., 1] / level
    z = place[..., 2] + turned[..., 0] * level
    return xp.stack([x, y, z], axis=-1) * distance[..., None]


def feedback_age(sensing: Sensing, draw: Array, phases: Array, time: Array, normals: Array) -> Array:
    """Return how old the latest feedback is at a decision [s], shape B; arguments as of `latest_exposure`."""
    xp = namespace(time, normals)
    period = sensing.feedback_period[draw]
    latency = jittered(sensing.feedback_latency[draw], sensing.feedback_jitter[draw], normals[..., FEEDBACK])
    newest = (xp.floor((time - latency) / period - phases) + phases) * period
    return time - newest


def quantised(sensing: Sensing, draw: Array, angle: Array) -> Array:
    """Round angles to the feedback's step, shape B + (2,)."""
    xp = namespace(angle)
    quantum = sensing.feedback_quantum[draw][..., None]
    step = xp.maximum(quantum, 1e-9)
    return xp.where(lift(quantum, angle) > 0.0, xp.round(angle / step) * step, angle)


def with_open_nearness(world: Any) -> Any:
    """Return a world whose camera's noise grows towards it by another power in each draw, evenly from 0 to 1.

    The noise across the line of sight was measured at one distance. Whether it is the same angle nearer by, as of a
    detector's pixels, or the same length, as of a plate's blurred edges, the record leaves open: a policy should do
    well in either case. A world without a camera, or of a single draw, stays as it is.
    """
    sensing = getattr(world.hardware, "sensing", None)
    if sensing is None or len(sensing.nearness) == 1:
        return world
    drawn = np.random.default_rng(58).permutation(np.linspace(0.0, 1.0, len(sensing.nearness)))
    sensing = sensing._replace(nearness=drawn.astype(sensing.across.dtype))
    return replace(world, hardware=replace(world.hardware, sensing=sensing))


def sensing_from_record(record: SensingRecord, draws: int) -> Sensing:
    """Build camera and link from a record, and draw what it leaves open within its intervals.

    Bearing noise is taken to be the same angle at every distance, range noise the same share of it, for the record has
    them at one distance. What was not measured is taken to be zero.

    Args:
      record: camera and link.
      draws: k; a single one is the best estimate.
    """
    from scipy.special import ndtri

    generator = np.random.default_rng([0, 57])
    camera, link = record.camera, record.link

    def drawn(name: str, value: float | None, low: float = 0.0) -> Array:
        half = np.diff(record.intervals.get(name, (0.0, 0.0))).item() / (2 * 1.96)
        normals = generator.standard_normal(draws) if draws > 1 else np.zeros(1)
        return np.maximum((value or 0.0) + half * normals, low)

    # A latency that counts from the feedback lacks the feedback's delay to one that counts from the exposure.
    delay = link.feedback_latency if link.feedback_delay is None else link.feedback_delay
    extra = (delay or 0.0) if camera.latency_basis == "feedback" else 0.0
    elevation_sd = drawn("camera.elevation_sd", camera.elevation_sd)
    bearing_sd = drawn("camera.bearing_sd", camera.bearing_sd)
    return Sensing(
        frame_period=1.0 / drawn("camera.rate_hz", camera.rate_hz, 1e-3),
        latency=drawn("camera.latency", camera.latency) + extra,
        latency_jitter=drawn("camera.latency_jitter", camera.latency_jitter),
        moment_error=drawn("camera.time_offset", 0.0, -np.inf),
        moment_jitter=drawn("camera.stamp_jitter", camera.stamp_jitter),
        across=np.stack([elevation_sd, bearing_sd], axis=-1),
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
