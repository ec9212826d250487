"""The blocks that observations are made of: from a policy's view of a decision to numbers of order one.

A block is a function of the observer and the view that returns an array, shape B + (k,). A block of a user's own is
such a function in a file. Some numbers come twice, coarse and fine: small values decide whether a target moves at all.
"""

from collections.abc import Mapping

from archerfish.arrays import Array, lift, namespace, without_gradient
from archerfish.controllers.policy.observer import Block, Observer, View
from archerfish.dynamics.aiming import intercept
from archerfish.tracking.interacting_models import ONWARD, STILL, TURNED
from archerfish.tracking.kalman_filter import position_after
from archerfish.tracking.legendre_memory import constant_history

_FINE, _METRES, _TYPICAL_AGE_S = 100.0, 20.0, 0.05
_RARE = 1e-4
"""Smallest probability that its logarithm shows."""
_LEAD_S = 0.06
"""From a decision until its pellet leaves the muzzle, about, for the slow tracker's intercept [s]."""


def paper(_: Observer, view: View) -> Array:
    """Return the paper's six numbers: the gimbal's angles at two moments, the target's yaw and range."""
    angles = _flat(view, view.memory.decisions.angle)
    return namespace(angles).concat([2.0 * angles, 2.0 * view.aim[..., 1:], 0.5 * (view.distance - 3.0)], axis=-1)


def error(_: Observer, view: View) -> Array:
    """Return the aim less the gimbal's angles, coarse and fine."""
    return _coarse_and_fine(view.aim - view.memory.decisions.angle[..., -1, :])


def rest(observer: Observer, view: View) -> Array:
    """Return the aim less where the command would come to rest if it braked now, coarse and fine.

    On which side of the aim that lies decides between pushing on and braking, the switching rule of a time-optimal
    slew: from a move d per decision, which may change by b, it takes another d |d| / (2 b).
    """
    command = view.memory.decisions.command
    move = command[..., -1, :] - command[..., -2, :]
    further = move * namespace(move).abs(move) / (2.0 * lift(observer.braking, move))
    return _coarse_and_fine(view.aim - command[..., -1, :] - further)


def aimed(_: Observer, view: View) -> Array:
    """Return pitch and yaw of the aim."""
    return 2.0 * view.aim


def aim_yaw(_: Observer, view: View) -> Array:
    """Return the yaw of the aim."""
    return 2.0 * view.aim[..., 1:]


def distance(_: Observer, view: View) -> Array:
    """Return the distance of the target."""
    return 0.5 * (view.distance - 3.0)


def nearness(_: Observer, view: View) -> Array:
    """Return the inverse of the distance."""
    return 0.3 / view.distance


def lag(_: Observer, view: View) -> Array:
    """Return the command less the gimbal's angles, a decision ago and now."""
    memory = view.memory.decisions
    return _flat(view, 2.0 * (memory.command - memory.angle)[..., -2:, :])


def gimbal_moves(_: Observer, view: View) -> Array:
    """Return the gimbal's moves from decision to decision, oldest first."""
    return _flat(view, 10.0 * _differences(view.memory.decisions.angle))


def command_moves(_: Observer, view: View) -> Array:
    """Return the command's moves from decision to decision, oldest first."""
    return _flat(view, 2.0 * _differences(view.memory.decisions.command))


def aim_moves(_: Observer, view: View) -> Array:
    """Return the moves of the aims at the detections, oldest first, those of the distance after those of the angles."""
    moves = _FINE * _differences(view.memory.decisions.aim)
    return namespace(moves).concat([_flat(view, moves[..., :2]), moves[..., 2]], axis=-1)


def ages(_: Observer, view: View) -> Array:
    """Return the ages of the latest detection and of the gimbal's feedback."""
    memory = view.memory
    return namespace(memory.clock).stack([memory.tracks.age, memory.gimbal_age], axis=-1) / _TYPICAL_AGE_S


def clock(_: Observer, view: View) -> Array:
    """Return the time since the first decision, coarse and fine."""
    xp, time = namespace(view.aim), view.memory.clock[..., None]
    return xp.concat([time, xp.tanh(4.0 * time)], axis=-1)


def across(_: Observer, view: View) -> Array:
    """Return the target's speed across the line of sight."""
    return 5.0 * view.across(view.fast.mean[..., 2:])


def away(_: Observer, view: View) -> Array:
    """Return the target's speed along the line of sight."""
    return 5.0 * view.away(view.fast.mean[..., 2:])


def speeds(_: Observer, view: View) -> Array:
    """Return the target's speeds across and along the line of sight, on three scales each."""
    xp, velocity = namespace(view.aim), view.fast.mean[..., 2:]
    scaled = []
    for speed in (view.across(velocity), view.away(velocity)):
        scaled += [5.0 * speed, xp.tanh(3.0 * speed), xp.tanh(10.0 * speed)]
    return xp.concat(scaled, axis=-1)


def detection(_: Observer, view: View) -> Array:
    """Return the azimuth of the latest detection, less the estimate's."""
    return _FINE * (view.memory.detections.azimuth[..., -1:] - view.azimuth)


def bearings(_: Observer, view: View) -> Array:
    """Return how far the latest detections lie to the left of the estimate, oldest first."""
    return _METRES * view.distance * (view.memory.detections.azimuth - view.azimuth)


def fine_bearings(observer: Observer, view: View) -> Array:
    """Return the same on a fine scale."""
    return namespace(view.aim).tanh(2.5 * bearings(observer, view))


def distances(_: Observer, view: View) -> Array:
    """Return the distances of the latest detections, less the estimate's, oldest first."""
    return 4.0 * (view.memory.detections.distance - view.distance)


def histories(observer: Observer, view: View) -> Array:
    """Return the Legendre coefficients of the azimuth, the distance and the azimuth for long, less the estimate's."""
    scales = (0.5 * _METRES * view.distance, 2.0, 0.5 * _METRES * view.distance)
    now = (view.azimuth[..., 0], view.distance[..., 0], view.azimuth[..., 0])
    kept = zip(scales, now, observer.windows, view.memory.histories, strict=False)
    parts = [scale * (history - constant_history(window, here)) for scale, here, window, history in kept]
    return namespace(view.aim).concat(parts, axis=-1)


def models(_: Observer, view: View) -> Array:
    """Return the estimates of the interacting models: their probabilities and log odds, speeds, and places.

    The speeds are those of a target that drives on, and of one that has turned back; the place is that of one that
    stands.
    """
    xp, (track, probability) = namespace(view.aim), view.memory.tracks.models
    velocity = track.mean[..., 2:] - view.memory.base.velocity[..., None, :2]
    still, drives, turns = (probability[..., index, None] for index in (STILL, ONWARD, TURNED))
    onward, turned = velocity[..., ONWARD, :], velocity[..., TURNED, :]
    off = track.mean[..., STILL, :2] - (view.relative[..., :2] + view.memory.base.position[..., :2])
    left = view.across(onward)
    odds = 0.3 * xp.log((still + _RARE) / (1.0 - still + _RARE)), 0.3 * xp.log((turns + _RARE) / (drives + _RARE))
    speed = 2.0 * left, xp.tanh(3.0 * left), xp.tanh(10.0 * left), 2.0 * view.away(onward)
    others = 2.0 * view.across(turned), 2.0 * view.away(turned), 10.0 * view.across(off), 10.0 * view.away(off)
    return xp.concat((probability, *odds, *speed, *others), axis=-1)


def slow(observer: Observer, view: View) -> Array:
    """Compare the tracker that averages for long with the fast one: estimates, its intercept, innovations by axis."""
    xp, track, memory = namespace(view.aim), view.slow, view.memory
    off = position_after(track, memory.tracks.age)[..., :2] - position_after(view.fast, memory.tracks.age)[..., :2]
    faster = track.mean[..., 2:] - view.fast.mean[..., 2:]
    lead = _LEAD_S + 0.0 * memory.tracks.age
    point = intercept(lambda time: position_after(track, memory.tracks.age + time), lead, observer.muzzle).angle
    ahead = view.unwrapped(without_gradient(point)) - view.aim
    left, innovation = _METRES * view.across(off), memory.tracks.innovation
    speed = 5.0 * view.across(faster), 5.0 * view.away(faster), 5.0 * view.across(track.mean[..., 2:])
    others = 10.0 * ahead, 10.0 * view.distance * ahead[..., 1:], xp.log(innovation), xp.tanh(0.25 * innovation)
    return xp.concat((left, xp.tanh(2.0 * left), *speed, *others), axis=-1)


def _coarse_and_fine(angle: Array) -> Array:
    xp = namespace(angle)
    return xp.concat([2.0 * angle, xp.tanh(_FINE / 3.0 * angle)], axis=-1)


def _flat(view: View, series: Array) -> Array:
    return namespace(series).reshape(series, (*view.memory.clock.shape, -1))


def _differences(series: Array) -> Array:
    return series[..., 1:, :] - series[..., :-1, :]


# fmt: off
_SLEW = (lag, gimbal_moves, command_moves)
OBSERVATIONS: Mapping[str, tuple[Block, ...]] = {
    "paper": (paper,),
    "history": (error, aim_yaw, distance, lag, gimbal_moves, aim_moves, command_moves, rest),
    "tracked": (error, aimed, distance, across, rest, *_SLEW, away, ages, clock, nearness, detection, bearings,
                histories),
    "multimodel": (error, aimed, distance, nearness, rest, *_SLEW, ages, clock, speeds, detection, bearings,
                   fine_bearings, distances, histories, models, slow),
}
# fmt: on
"""Kind of observation → its blocks."""
