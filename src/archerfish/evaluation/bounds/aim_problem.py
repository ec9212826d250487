"""What a bound is about: the shots of some engagements, how commands move the aim, and what may be commanded.

The aim is linear in the commands, since the axes are linear and the limits act on the commands alone:

    η_t = rest_t + Σ_s M_ts (u_s − start),   η_t the angle at shot t and what the gimbal's rate adds to the pellet's way

Where commands come late, each by a latency of its own, M is that of the latencies as they were: a bound may know them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.command_limits import NEVER
from archerfish.dynamics.delayed_gimbal import DelayedGimbal
from archerfish.dynamics.muzzle import DRAWS as MUZZLE_DRAWS
from archerfish.evaluation.bounds.hit_chance import ShotGeometry, shot_geometry
from archerfish.evaluation.suites import Trials
from archerfish.sensing.camera import jittered
from archerfish.sensing.interfaces import Engagement
from archerfish.simulation.environment import PureWorld
from archerfish.simulation.identified import IdentifiedWorld
from archerfish.simulation.shooting import ShootingWorld, plant_of

Array = NDArray[np.float64]

_ROUNDING = 2e-5
"""The limits act in float32 on differences of commands; this share more than they allow is taken to be allowed."""


class AimProblem(NamedTuple):
    """E engagements of T shots; index 0 is pitch, 1 is yaw."""

    geometry: ShotGeometry
    """Aims, scales and dispersion."""
    response: Array
    """M, shape (E, 2, T, T), or (1, 2, T, T) where it is the same for all."""
    rest: Array
    """Aim under the command at the start [rad], shape (E, 2)."""
    start: Array
    """Command at the start [rad], shape (E, 2)."""
    low: Array
    """Smallest command less that at the start [rad], shape (E, 2, T)."""
    high: Array
    """Largest command less that at the start [rad], shape (E, 2, T)."""
    step: Array
    """Largest change of a command between two decisions [rad], infinite for no limit, shape (2,)."""
    bend: Array
    """Largest change of that change [rad], likewise, shape (2,)."""
    radius: float
    """Largest miss that hits [m]."""

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


def suite_parts(trials: Trials, index: int) -> tuple[Engagement, NDArray[np.float32]]:
    """Return engagements and draws of one suite."""
    count = len(trials.draws) // len(trials.suites)
    own = slice(index * count, (index + 1) * count)
    return map_arrays(lambda each: each[own], trials.engagements), trials.draws[own]


def aim_problem(world: PureWorld, engagements: Engagement, draws: NDArray[np.float32], radius: float) -> AimProblem:
    """Work out what engagements take.

    Args:
      world: the simulator.
      engagements: E of them.
      draws: standard normals, shape (E, T, normals); the latencies of the commands are among them.
      radius: largest miss that hits [m].

    Raises:
      TypeError: if the world is of a kind whose axes are not known to be linear.
    """
    if not isinstance(world, IdentifiedWorld | ShootingWorld):
        raise TypeError(f"bounds are proven for worlds with linear axes, got {type(world).__name__}")
    shots, period = draws.shape[1], world.period_s
    if isinstance(world, IdentifiedWorld):
        muzzle, (angle, rate, gain) = world.muzzle_of(engagements), _late(world, engagements, draws)
    else:
        muzzle, (angle, rate, gain) = world.muzzle, _immediate(world, engagements, shots)
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


def _range(world: PureWorld, engagements: Engagement, shots: int) -> tuple[Array, Array]:
    """Bounds of every command by itself [rad], shape (E, 2, T) each."""
    limits = world.limits
    shape = (len(engagements.start), 2, shots)
    low, high = (np.broadcast_to(np.asarray(each, np.float64)[:, None], shape) for each in (limits.low, limits.high))
    lead = np.asarray(limits.max_lead, np.float64)[:, None]
    # Where sight is noisy, what bounds the command is not the line of sight: then the range alone counts.
    if not isinstance(world, ShootingWorld) or np.any(world.position_noise > 0.0) or np.all(lead >= NEVER):
        return low, high
    motion = map_arrays(lambda each: np.asarray(each, np.float64)[:, None], engagements.motion)
    decided = np.zeros((shape[0], 1)) + world.period_s * np.arange(shots)
    sight = np.moveaxis(line_of_sight(motion.position(decided)), -1, 1)
    lead = (1.0 + _ROUNDING) * lead
    return np.clip(sight - lead, low, high), np.clip(sight + lead, low, high)


def _immediate(world: ShootingWorld, engagements: Engagement, shots: int) -> tuple[Array, Array, Array]:
    """Commands to angles and to rates, shape (1 or E, 2, T, T) each, and angles at rest per command, (1 or E, 2)."""
    plant = map_arrays(lambda each: np.asarray(each, np.float64), plant_of(world, engagements))
    plant = plant if plant.input.ndim == 3 else map_arrays(lambda each: each[None], plant)
    state, impulse = plant.input, []
    for _ in range(shots):
        impulse.append([np.sum(row * state, axis=-1) for row in (plant.angle, plant.rate)])
        state = np.einsum("...ij,...j->...i", plant.transition, state)
    lag = np.arange(shots)[:, None] - np.arange(shots)
    angle, rate = np.moveaxis(np.array(impulse), 0, -1)
    responses = (np.where(lag >= 0, each[..., np.maximum(lag, 0)], 0.0) for each in (angle, rate))
    return *responses, np.sum(plant.angle * plant.rest, axis=-1)


def _late(world: IdentifiedWorld, engagements: Engagement, draws: NDArray[np.float32]) -> tuple[Array, Array, Array]:
    """Return the same where every command takes effect at a tick of its own."""
    gimbal, plant = world.gimbal, engagements.plant
    shots, ticks = draws.shape[1], gimbal.transition.shape[1] - 1
    sensing, normals = world.sensing, draws[..., MUZZLE_DRAWS]
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
