"""What bounds on hit rates are about: the chance that a shot hits, and which aims the commands allow.

    f(m) = P(|m + N(0, diag(s_y², s_z²))| ≤ R)

m is the mean offset in the plane of the plate. No controller knows the dispersion of a shot beforehand, so no bound
needs to: it uses this probability and never the realised draw. The aim is linear in the commands, since the axes are
linear and the limits act on the commands alone:

    η_t = rest_t + Σ_s M_ts (u_s − start),   η_t the angle at shot t and what the gimbal's rate adds to the pellet

Where commands come late, each by a latency of its own, M is that of the latencies as they were: a bound may know them.
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from archerfish.arrays import map_arrays
from archerfish.dynamics.aiming import intercept, line_of_sight
from archerfish.dynamics.command_limits import NEVER
from archerfish.dynamics.delayed_axis import DelayedGimbal
from archerfish.dynamics.linear_axis import GimbalModel
from archerfish.dynamics.muzzle import Muzzle
from archerfish.protocols import Engagement
from archerfish.simulation.camera import (
    SENDING,
    LinkedHardware,
    jittered,
    plate_place,
)
from archerfish.simulation.world import SimulatedWorld

Array = NDArray[np.float64]

SLACK = 3e-4
"""Every aim is taken to be this much nearer to the armor than it is [rad]. What `ShotGeometry` leaves out, the coupling
of the axes above all, would else make the chance of one shot in some tens of thousands a hundredth too small."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_TAILS = 8.0
"""Standard deviations beyond which nothing is integrated."""


class ShotGeometry(NamedTuple):
    """Aims, scales and dispersion of the shots of E engagements, T each; index 0 is pitch or z, 1 is yaw or y."""

    aim: Array  # aim of the gimbal whose mean pellet meets the armor's centre [rad], shape (E, T, 2)
    bearing: Array  # azimuth of the armor when the pellet crosses its x [rad], shape (E, T)
    x: Array  # x of the armor then [m], shape (E, T)
    height_per_pitch: Array  # change of the height in the armor's plane per change of the pitch [m/rad], shape (E, T)
    sd: Array  # standard deviation of the pellet in z and y in that plane [m], shape (E, T, 2)
    rate_share: Array  # how far the gimbal's rate turns the pellet [s], shape (E, T): the aim is angle + share · rate
    crossing: Array  # when the pellet crosses the armor's x, since the engagement began [s], shape (E, T)
    drop: Array  # drop of the pellet until then [m], shape (E, T)

    def lateral(self, yaw: Array) -> Array:
        """Return the mean offset in y [m] of an aim that is off by a yaw [rad], shape (E, T)."""
        # A bearing beyond a right angle crosses no plane of constant x; next to it the offset is metres already.
        return np.asarray(self.x * (np.tan(np.clip(self.bearing + yaw, -1.55, 1.55)) - np.tan(self.bearing)))


def hit_chance(offset: Array, sd: Array, radius: float) -> Array:
    """Return the chance to hit.

    Args:
      offset: mean offset in z and y [m], shape B + (2,).
      sd: standard deviations in z and y [m], shape B + (2,).
      radius: R, largest miss that hits [m].
    """
    offset, sd = np.broadcast_arrays(offset, np.maximum(sd, 1e-9))
    (z, y), (sd_z, sd_y) = np.moveaxis(offset, -1, 0), np.moveaxis(sd, -1, 0)
    # The height is integrated over as R sin θ: smooth where the disc ends.
    low, high = (np.arcsin(np.clip((z + side * _TAILS * sd_z) / radius, -1.0, 1.0)) for side in (-1, 1))
    angle = (low + high)[..., None] / 2 + (high - low)[..., None] / 2 * _NODES
    height, half_width = radius * np.sin(angle), radius * np.cos(angle)
    deviation = (height - z[..., None]) / sd_z[..., None]
    density = np.exp(-0.5 * deviation**2) / (np.sqrt(2 * np.pi) * sd_z[..., None])
    within = ndtr((half_width - y[..., None]) / sd_y[..., None]) - ndtr((-half_width - y[..., None]) / sd_y[..., None])
    return np.asarray((high - low) / 2 * np.sum(_WEIGHTS * density * within * half_width, axis=-1))


def shot_geometry(engagements: Engagement, muzzle: Muzzle, fired: Array) -> ShotGeometry:
    """Work out the geometry of every shot, in float64.

    Args:
      engagements: E of them.
      muzzle: the true one, shape () or (E,).
      fired: times of the shots [s], shape (T,).
    """
    muzzle = Muzzle(*(_per_shot(each, name in ("offset", "sd")) for name, each in muzzle._asdict().items()))
    time = np.zeros((len(engagements.start), 1)) + fired
    aim = intercept(partial(target_at, engagements), time, muzzle)
    place = target_at(engagements, time + aim.flight_time)
    level, bearing = np.hypot(place[..., 0], place[..., 1]), np.arctan2(place[..., 1], place[..., 0])
    slant = level / np.cos(aim.angle[..., 0])
    departure = aim.angle[..., 0] + (1.0 - muzzle.length / slant) * muzzle.offset[..., 0]
    drop = level * np.tan(departure) - place[..., 2]
    # A steeper pellet flies farther, and the drop grows with the square of the distance.
    falling = 2.0 * drop * np.tan(departure)
    rise = np.cos(departure) ** -2
    sd_z = np.hypot(
        ((level - muzzle.length) * rise - falling) * muzzle.sd[..., 0], 2.0 * drop / muzzle.speed * muzzle.speed_sd
    )
    sd_y = (level - muzzle.length) / np.cos(bearing) * muzzle.sd[..., 1]
    rate_share = (1.0 - muzzle.length / slant) * muzzle.length / muzzle.speed
    return ShotGeometry(
        aim=aim.angle,
        bearing=bearing,
        x=place[..., 0],
        height_per_pitch=level * rise - falling,
        sd=np.stack([sd_z, sd_y], axis=-1),
        rate_share=rate_share,
        crossing=time + aim.flight_time,
        drop=drop,
    )


def _per_shot(parameter: Array, vector: bool) -> Array:
    array = np.asarray(parameter, np.float64)
    return array[:, None] if array.ndim > vector else array


def target_at(engagements: Engagement, time: Array) -> Array:
    """Return where the plates of E engagements are at times of shape (E, T) [m], shape (E, T, 3), in float64."""
    target = map_arrays(lambda field: np.asarray(field, np.float64)[:, None], engagements.target)
    return np.asarray(plate_place(engagements._replace(target=target), time))


_ROUNDING = 2e-5
"""The limits act in float32 on differences of commands; this share more than they allow is taken to be allowed."""


class AimProblem(NamedTuple):
    """E engagements of T shots; index 0 is pitch, 1 is yaw."""

    geometry: ShotGeometry  # aims, scales and dispersion
    response: Array  # M, shape (E, 2, T, T), or (1, 2, T, T) where it is the same for all
    rest: Array  # aim under the command at the start [rad], shape (E, 2)
    start: Array  # command at the start [rad], shape (E, 2)
    low: Array  # smallest command less that at the start [rad], shape (E, 2, T)
    high: Array  # largest command less that at the start [rad], shape (E, 2, T)
    step: Array  # largest change of a command between two decisions [rad], infinite for no limit, shape (2,)
    bend: Array  # largest change of that change [rad], likewise, shape (2,)
    radius: float  # largest miss that hits [m]

    def pick(self, chosen: NDArray[np.int64] | slice) -> "AimProblem":
        """Return some of the engagements.

        Args:
          chosen: which of them, indices of shape (n,) or a slice.
        """
        parts = {name: getattr(self, name)[chosen] for name in ("rest", "start", "low", "high")}
        return self._replace(
            geometry=ShotGeometry(*(each[chosen] for each in self.geometry)),
            response=self.response if len(self.response) == 1 else self.response[chosen],
            **parts,
        )

    @property
    def wanted(self) -> Array:
        """Change of the aim against the start that meets the armor's centre [rad], shape (E, 2, T)."""
        return np.asarray(np.moveaxis(self.geometry.aim, -1, 1) - self.rest[..., None])


def aim_problem(
    world: SimulatedWorld, engagements: Engagement, draws: NDArray[np.float32], radius: float
) -> AimProblem:
    """Work out what engagements take.

    Args:
      world: the simulator.
      engagements: E of them.
      draws: standard normals, shape (E, T, normals); the latencies of the commands are among them.
      radius: largest miss that hits [m].
    """
    shots, period, hardware = draws.shape[1], world.period_s, world.hardware
    if isinstance(hardware, LinkedHardware):
        angle, rate, gain = _late(hardware, engagements, draws)
    else:
        angle, rate, gain = _immediate(hardware, engagements, shots)
    muzzle = world.muzzle_of(engagements)
    geometry = shot_geometry(engagements, muzzle, period * np.arange(1, shots + 1))
    response = angle if np.all(geometry.rate_share == 0.0) else angle + geometry.rate_share[:, None, :, None] * rate
    start = np.asarray(engagements.start, np.float64)
    low, high = _range(world, engagements, shots)
    return AimProblem(
        geometry=geometry,
        response=response,
        rest=gain * start,
        start=start,
        low=low - start[..., None],
        high=high - start[..., None],
        step=_limit(world.limits.max_rate) * period,
        bend=_limit(world.limits.max_acceleration) * period**2,
        radius=radius,
    )


def _limit(values: Array) -> Array:
    values = np.asarray(values, np.float64)
    return np.where(values < NEVER, (1.0 + _ROUNDING) * values, np.inf)


def _range(world: SimulatedWorld, engagements: Engagement, shots: int) -> tuple[Array, Array]:
    """Bounds of every command by itself [rad], shape (E, 2, T) each."""
    limits = world.limits
    shape = (len(engagements.start), 2, shots)
    low, high = (np.broadcast_to(np.asarray(each, np.float64)[:, None], shape) for each in (limits.low, limits.high))
    lead = np.asarray(limits.max_lead, np.float64)[:, None]
    # Where detection is noisy, what bounds the command is not the line of sight: then the range alone counts.
    if isinstance(world.hardware, LinkedHardware) or np.all(lead >= NEVER):
        return low, high
    decided = np.zeros((shape[0], 1)) + world.period_s * np.arange(shots)
    sight = np.moveaxis(line_of_sight(target_at(engagements, decided)), -1, 1)
    lead = (1.0 + _ROUNDING) * lead
    return np.clip(sight - lead, low, high), np.clip(sight + lead, low, high)


def _immediate(hardware: Any, engagements: Engagement, shots: int) -> tuple[Array, Array, Array]:
    """Commands to angles and to rates, shape (1 or E, 2, T, T) each, and angles at rest per command, (1 or E, 2)."""
    draws = hardware.gimbal.input.ndim == 3
    fields = (field[engagements.plant] if draws else field[None] for field in hardware.gimbal)
    plant = GimbalModel(*(np.asarray(field, np.float64) for field in fields))
    state, impulse = plant.input, []
    for _ in range(shots):
        impulse.append([np.sum(row * state, axis=-1) for row in (plant.angle, plant.rate)])
        state = np.einsum("...ij,...j->...i", plant.transition, state)
    lag = np.arange(shots)[:, None] - np.arange(shots)
    angle, rate = np.moveaxis(np.array(impulse), 0, -1)
    responses = (np.where(lag >= 0, each[..., np.maximum(lag, 0)], 0.0) for each in (angle, rate))
    return *responses, np.sum(plant.angle * plant.rest, axis=-1)


def _late(hardware: LinkedHardware, engagements: Engagement, draws: NDArray[np.float32]) -> tuple[Array, Array, Array]:
    """Return the same where every command takes effect at a tick of its own."""
    gimbal, plant = hardware.gimbal, engagements.plant
    shots, ticks = draws.shape[1], gimbal.transition.shape[1] - 1
    sensing, normals = hardware.sensing, draws[..., SENDING]
    latency = jittered(sensing.command_latency[plant][:, None], sensing.command_jitter[plant][:, None], normals)
    # In the float32 of the world, or a tick may be rounded the other way.
    due = np.round(latency / gimbal.tick).astype(np.int64)[:, None, :] + gimbal.delay[plant][..., None]
    due = np.maximum.accumulate(due + ticks * np.arange(shots), axis=-1)
    since = ticks * np.arange(1, shots + 1)[:, None] - due[..., None, :]
    # A command acts until the next one does, if that one is sent by then.
    until = np.where(np.arange(shots)[:, None] > np.arange(shots), np.roll(since, -1, axis=-1), -1)
    steps = _step_responses(gimbal, shots * ticks)
    angle, rate = (_at(each, plant, since) - _at(each, plant, until) for each in steps)
    gain = np.sum(gimbal.angle[plant] * gimbal.rest[plant], axis=-1) + gimbal.feedthrough[plant]
    return angle, rate, np.asarray(gain, np.float64)


def _step_responses(gimbal: DelayedGimbal, ticks: int) -> tuple[Array, Array]:
    """Angles and rates 0…N ticks after a unit step takes effect, shape (k, 2, N + 1) each."""
    gimbal = map_arrays(lambda each: np.asarray(each, np.float64), gimbal)
    state, found = 0.0 * gimbal.input[:, 0], []
    for _ in range(ticks + 1):
        angle = np.sum(gimbal.angle * state, axis=-1) + gimbal.feedthrough
        found.append((angle, np.sum(gimbal.rate * state, axis=-1) + gimbal.rate_feedthrough))
        state = np.einsum("...ij,...j->...i", gimbal.transition[:, 1], state) + gimbal.input[:, 1]
    angles, rates = np.moveaxis(np.array(found), 0, -1)
    return angles, rates


def _at(steps: Array, plant: NDArray[np.int32], since: NDArray[np.int64]) -> Array:
    """Look step responses up, shape (E, 2, T, T); nothing happens before a command takes effect."""
    draw, axis = plant[:, None, None, None], np.arange(2)[:, None, None]
    return np.where(since >= 0, steps[draw, axis, np.maximum(since, 0)], 0.0)
