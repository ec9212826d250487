"""What the computer that aims makes of a robot's messages: the gimbal as of its latest report, plates in frame O.

A frame shows a plate in the camera's frame, at its exposure. Where the gimbal pointed then is looked up in the memory
of its reports: with the angles of another moment a turning gimbal would seem to move the plate.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.arrays import single_precision
from archerfish.messages import Detections, Feedback, Numbers
from archerfish.protocols import Barrel, Base, Frames, GimbalFeedback, Seen
from archerfish.tracking.detections import GUESS_AGE_S

REMEMBERED_S = 0.25
"""Reports and frames are kept for so long [s]; no frame arrives later than that after its exposure."""


class Reports(NamedTuple):
    """Reports of the gimbal of late, oldest first; a place without one repeats the one before, or has a time of −∞."""

    sampled_s: Numbers  # rising, (B, L)
    angle: Numbers  # pitch, and yaw without jumps of a turn [rad], (B, L, 2)
    rate: Numbers  # of the last report [rad/s], (B, 2)


class WaitingFrames(NamedTuple):
    """Frames of late that show a plate, oldest first; a place without one has a time of −∞."""

    exposed_s: Numbers  # on the clock of the reports, rising, (B, L)
    position: Numbers  # of the plate in the camera's frame [m], (B, L, 3)


class SeenPlate(NamedTuple):
    """The plate as seen last."""

    position: Numbers  # in O [m], (B, 3)
    exposed_s: Numbers  # (B,)
    is_new: NDArray[np.bool_]  # whether it came with the latest messages, (B,)


class Host(NamedTuple):
    """The memory of a host: of one plate at most in a frame."""

    reports: Reports
    frames: WaitingFrames
    plate: SeenPlate


def new_host(guess: Numbers) -> Host:
    """Return the memory of a program that has just begun.

    Args:
      guess: where a plate is assumed until a frame shows it, in O [m], shape (B, 3).
    """
    count = len(guess)
    none = np.full((count, 1), -np.inf)
    frames = WaitingFrames(none, np.zeros((count, 1, 3)))
    reports = Reports(none, np.zeros((count, 1, 2)), np.zeros((count, 2)))
    return Host(reports, frames, SeenPlate(guess, none[:, 0], np.zeros(count, bool)))


def with_messages(host: Host, feedback: Feedback, detections: Detections, offset_s: float, now_s: float) -> Host:
    """Return the memory with messages that arrived.

    Args:
      host: memory so far.
      feedback: shape (B, N).
      detections: shape (B, N), with one slot.
      offset_s: from the stamp of a frame to its exposure on the clock of the reports [s].
      now_s: the present on that clock [s].
    """
    reports = _with_reports(host.reports, feedback, now_s)
    frames = _with_frames(host.frames, detections, offset_s, now_s)
    return Host(reports, frames, _latest_plate(host.plate, reports, frames))


def seen_by(host: Host, now_s: float, elapsed_s: float, command: Numbers, barrel: Barrel) -> Seen:
    """Return what a controller sees at a decision, in float32: of the plate the latest frame, if one came.

    Args:
      host: memory with the latest messages.
      now_s: the present on the clock of the reports [s].
      elapsed_s: since the last decision [s], 0 at the first.
      command: in force [rad], shape (B, 2).
      barrel: shape (B,).
    """
    reports, plate, zero = host.reports, host.plate, np.zeros(len(command))
    origin, is_new = np.zeros((len(command), 3)), plate.is_new[:, None]
    age = np.where(is_new, np.minimum(now_s - plate.exposed_s, GUESS_AGE_S)[:, None], 0.0)
    position = np.where(is_new[..., None], plate.position[:, None], 0.0)
    seen = Seen(
        elapsed=zero + elapsed_s,
        gimbal=GimbalFeedback(reports.angle[:, -1], reports.rate, now_s - reports.sampled_s[:, -1]),
        command=command,
        frames=Frames(is_new, age, is_new[..., None], position[..., None, :], 0.0 * age[..., None]),
        base=Base(origin, origin, zero, zero),
        barrel=barrel,
    )
    return single_precision(seen)


def angle_at(reports: Reports, moment: Numbers) -> Numbers:
    """Interpolate the gimbal's angles at moments [s], shape (B, G) → (B, G, 2); before the first report they are held.

    Args:
      reports: at least one per trial.
      moment: up to the last report; may be NaN.
    """
    latest = reports.sampled_s.shape[1] - 1
    after = np.sum(reports.sampled_s[:, None, :] <= moment[..., None], axis=-1)
    first = np.argmax(np.isfinite(reports.sampled_s), axis=1)[:, None]
    low, high = np.clip(after - 1, first, latest), np.clip(after, first, latest)
    trial = np.arange(len(moment))[:, None]
    begin, end = reports.sampled_s[trial, low], reports.sampled_s[trial, high]
    gap = end - begin
    share = np.where(gap > 0.0, np.clip((moment - begin) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0), 0.0)
    here, there = reports.angle[trial, low], reports.angle[trial, high]
    return np.asarray(here + share[..., None] * (there - here))


def from_camera(position: Numbers, angle: Numbers) -> Numbers:
    """Turn a place in the camera's frame, shape B + (3,), into O by pitch and yaw [rad], shape B + (2,)."""
    (x, y, z), (pitch, yaw) = np.moveaxis(position, -1, 0), np.moveaxis(angle, -1, 0)
    level = x * np.cos(pitch) - z * np.sin(pitch)
    height = x * np.sin(pitch) + z * np.cos(pitch)
    return np.stack([level * np.cos(yaw) - y * np.sin(yaw), level * np.sin(yaw) + y * np.cos(yaw), height], axis=-1)


def _with_reports(reports: Reports, feedback: Feedback, now_s: float) -> Reports:
    """Add reports and forget old ones; yaw goes on without jumps where the wire's wraps."""
    latest_s, latest_angle = reports.sampled_s[:, -1:], reports.angle[:, -1:]
    sampled = np.where(np.isnan(feedback.sampled_s), -np.inf, feedback.sampled_s)
    sampled, angle, rate = _in_order(sampled, feedback.angle, feedback.rate)
    rates = np.concatenate([reports.rate[:, None], rate], axis=1)
    newest = np.argmax(np.concatenate([latest_s, sampled], axis=1), axis=1)
    # With the latest report in the place of each that is missing, those of before need not move: there are hundreds.
    missing = np.isinf(sampled)
    angle = _unwrapped(latest_angle, np.where(missing[..., None], latest_angle, angle), np.isfinite(latest_s))
    sampled = np.where(missing, latest_s, sampled)
    times = np.concatenate([reports.sampled_s, sampled], axis=1)
    angles = np.concatenate([reports.angle, angle], axis=1)
    if np.any(sampled < latest_s):
        times, angles = _in_order(times, angles)
    kept = _kept(times, now_s)
    return Reports(times[:, -kept:], angles[:, -kept:], rates[np.arange(len(rates)), newest])


def _unwrapped(before: Numbers, angle: Numbers, known: NDArray[np.bool_]) -> Numbers:
    """Return angles, shape (B, N, 2), with whole turns of yaw removed, so that it goes on from the one before.

    Args:
      before: angle of the report before, shape (B, 1, 2).
      angle: of the reports, in order.
      known: whether there was a report before, shape (B, 1).
    """
    yaw = np.concatenate([np.where(known, before[..., 1], angle[:, :1, 1]), angle[..., 1]], axis=1)
    turns = np.rint(np.diff(yaw, axis=1) / (2.0 * np.pi))
    if not turns.any():
        return angle
    whole = 2.0 * np.pi * np.cumsum(turns, axis=1)
    return np.stack([angle[..., 0], angle[..., 1] - whole], axis=-1)


def _in_order(times: Numbers, *fields: Numbers) -> list[Numbers]:
    """Return times, shape (B, N), and fields, shape (B, N, …), in the order of the times."""
    trial, order = np.arange(len(times))[:, None], np.argsort(times, axis=1, kind="stable")
    return [field[trial, order] for field in (times, *fields)]


def _with_frames(frames: WaitingFrames, detections: Detections, offset_s: float, now_s: float) -> WaitingFrames:
    """Add frames that show the plate, and forget old ones."""
    exposed = detections.exposed_s + offset_s
    missing = np.isnan(exposed) | ~detections.found[..., 0]
    times = np.concatenate([frames.exposed_s, np.where(missing, -np.inf, exposed)], axis=1)
    new = np.where(missing[..., None], 0.0, detections.position[..., 0, :])
    places = np.concatenate([frames.position, new], axis=1)
    order = np.argsort(times, axis=1, kind="stable")[:, -_kept(times, now_s) :]
    trial = np.arange(len(times))[:, None]
    return WaitingFrames(times[trial, order], places[trial, order])


def _kept(times: Numbers, now_s: float) -> int:
    """Return how many of the latest messages some trial still needs, at least one, shape (B, L)."""
    return int(np.max(np.sum(times > now_s - REMEMBERED_S, axis=1), initial=1))


def _latest_plate(plate: SeenPlate, reports: Reports, frames: WaitingFrames) -> SeenPlate:
    """Return the plate of the latest frame that the reports cover.

    A frame that is newer than the latest report waits: where the gimbal pointed then is not known yet, and a guess
    would move the plate while the gimbal turns.
    """
    exposed = frames.exposed_s
    usable = (exposed <= reports.sampled_s[:, -1:]) & (exposed > plate.exposed_s[:, None])
    trial, newest = np.arange(len(exposed))[:, None], np.argmax(np.where(usable, exposed, -np.inf), axis=1)[:, None]
    moment, seen = exposed[trial, newest], frames.position[trial, newest]
    position = from_camera(seen, angle_at(reports, moment))[:, 0]
    is_new = np.any(usable, axis=1)
    return SeenPlate(
        np.where(is_new[:, None], position, plate.position), np.where(is_new, moment[:, 0], plate.exposed_s), is_new
    )
