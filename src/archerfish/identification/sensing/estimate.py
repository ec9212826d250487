"""Identification of a robot's sensing: two short recordings in, sensing record out.

What two recordings can't separate is reported as a sum, or left out with the measurement that is missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.sensing.command_delay import (
    FEWEST,
    CommandDelay,
    command_delay,
    held_steps,
    scatter_interval,
)
from archerfish.identification.sensing.gimbal_track import (
    Feedback,
    GimbalTrack,
    examine_feedback,
    gimbal_track,
    is_logged,
)
from archerfish.identification.sensing.link_timing import link_timing
from archerfish.identification.sensing.motion_misfit import MotionMisfit, motion_misfit
from archerfish.identification.sensing.offset_search import OffsetScan, search_offset
from archerfish.identification.sensing.plate_alignment import PlateAlignment, align_plate, deviation_interval
from archerfish.identification.sensing.remarks import Doubts, doubts
from archerfish.identification.sensing.stamp_timing import (
    FrameTiming,
    Interval,
    around,
    frame_timing,
    share_interval,
    standard_error,
)
from archerfish.identification.sensing.target_steps import EARLIEST, LONGEST, StepLatency, step_latency
from archerfish.records.errors import InputError
from archerfish.records.message_times import MessageTimes
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.records.sensing_logs import Detections, GimbalLog

Array = NDArray[np.float64]
GimbalClock = Literal["receipt", "own"]
"""Who stamped the gimbal log: the program that also logs receipts of detections, when the feedback reached it; or the
gimbal, by a clock of its own."""


@dataclass(frozen=True)
class SensingIdentification:
    """An identified sensing and how it came about."""

    sensing: SensingRecord
    """The record."""
    scan: OffsetScan
    """Misfit over offset, from the search."""
    alignment: PlateAlignment
    """Residuals and geometry of the plate at rest."""
    frames: FrameTiming
    """Frames of the plate at rest."""
    misfit: MotionMisfit
    """What the gimbal's motion still explains of the residual."""
    track: GimbalTrack
    """The gimbal during the sweep."""
    receipt_delay: Array | None
    """Time from aligned exposure to receipt, by detection [s], shape (K,); None without receipts on the gimbal log's
    clock."""
    outside: int
    """Detections that were left out because the gimbal's angle at their moment is not logged."""
    command_steps: int
    """Command steps from which the delay was estimated."""
    command_steps_logged: int
    """Command steps in the logs, the command still before and after each."""
    command_delays: tuple[float, ...]
    """Delay of each of them [s]."""
    target_steps: int
    """Target steps from which the latency was estimated."""
    target_steps_logged: int
    """Target steps whose moments were given."""
    missing: tuple[str, ...]
    """What was not estimated, each a sentence that names the measurement that it takes."""
    remarks: tuple[str, ...]
    """What the numbers mean and what may spoil them, each a sentence."""


class _Camera(NamedTuple):
    """The camera's part of the record."""

    record: CameraRecord
    intervals: dict[str, Interval]
    feedback_delay: float | None
    feedback_delay_interval: Interval | None


def identify_sensing(
    gimbal: Sequence[GimbalLog],
    detections: Sequence[Detections],
    target_steps: Array | None = None,
    *,
    commands: MessageTimes | None = None,
    feedback: MessageTimes | None = None,
    gimbal_clock: GimbalClock = "receipt",
    max_offset: float | None = None,
) -> SensingIdentification:
    """Identify camera and link from a plate at rest under a yaw sweep, and from command and target steps.

    Args:
      gimbal: the log of the sweep first; command steps are looked for in all.
      detections: those of the sweep first; second, if target steps are given, those of the stepping target.
      target_steps: moments of the target's steps, on the clock of receipts [s], shape (S,).
      commands: when commands were sent and received, if the gimbal stamps them.
      feedback: when the gimbal's feedback was sent and received, if the gimbal stamps it.
      gimbal_clock: who stamped the gimbal logs.
      max_offset: largest time offset that is tried [s]; by default 1 s where the clocks overlap, else any.

    Returns:
      The record with its diagnostics.

    Raises:
      InputError: if logs are missing or too short, don't belong together, or can't bear the estimate.
    """
    _check_logs(gimbal, detections, target_steps)
    sweep, seen = gimbal[0], detections[0]
    reported = examine_feedback(sweep)
    track, frames = gimbal_track(sweep, reported.fresh), frame_timing(seen.time, seen.source)
    start, scan = search_offset(track, seen.time, np.arctan2(seen.position[:, 1], seen.position[:, 0]), max_offset)
    detected = seen.time.size
    seen = _covered(sweep, track, seen, start)
    alignment = align_plate(track, seen.time, seen.position, start)
    by_steps = None if target_steps is None else step_latency(detections[1], target_steps, frames.period)
    camera = _camera(frames, seen, alignment, by_steps, gimbal_clock)
    delay = command_delay(list(gimbal))
    link, link_intervals = _link(reported, delay, camera)
    link, link_intervals = _with_messages(link, link_intervals, commands, feedback)
    return SensingIdentification(
        sensing=SensingRecord(camera.record, link, {**camera.intervals, **link_intervals}),
        scan=scan,
        alignment=alignment,
        frames=frames,
        misfit=motion_misfit(track, alignment),
        track=track,
        receipt_delay=_receipt_delay(seen, alignment, gimbal_clock),
        outside=detected - seen.time.size,
        command_steps=0 if delay is None else delay.steps,
        command_steps_logged=sum(held_steps(each) for each in gimbal),
        command_delays=() if delay is None else delay.each,
        target_steps=0 if by_steps is None else by_steps.steps,
        target_steps_logged=0 if target_steps is None else int(target_steps.size),
        missing=(*_missing(camera.record, delay, gimbal_clock, seen.receive is not None), *_unstamped(link)),
        remarks=tuple(doubts(Doubts(sweep, reported, track, frames, alignment, camera.record, link))),
    )


def _receipt_delay(seen: Detections, alignment: PlateAlignment, gimbal_clock: GimbalClock) -> Array | None:
    if seen.receive is None or gimbal_clock == "own":
        return None
    return np.asarray(seen.receive - seen.time - alignment.offset)


def _check_logs(gimbal: Sequence[GimbalLog], detections: Sequence[Detections], target_steps: Array | None) -> None:
    expected = 1 if target_steps is None else 2
    if not gimbal:
        raise InputError("sensing needs the gimbal log of a yaw sweep, got none; pass it first")
    if len(detections) != expected:
        kinds = "the plate at rest" if expected == 1 else "the plate at rest, then those of the stepping target"
        told = "" if expected == 2 or len(detections) < 2 else "; the moments of the target's steps are missing"
        raise InputError(f"got {len(detections)} logs of detections, expected {expected}: those of {kinds}{told}")


def _covered(log: GimbalLog, track: GimbalTrack, seen: Detections, start: float) -> Detections:
    """Keep the detections for which the gimbal's angle is logged."""
    kept = is_logged(log, track, seen.time + start)
    if kept.sum() < 20:
        raise InputError(f"{seen.source}: {kept.sum()} detections lie inside the gimbal log, expected at least 20")
    receive = None if seen.receive is None else seen.receive[kept]
    return Detections(seen.time[kept], seen.position[kept], receive, seen.source)


def _camera(
    frames: FrameTiming,
    seen: Detections,
    alignment: PlateAlignment,
    by_steps: StepLatency | None,
    gimbal_clock: GimbalClock,
) -> _Camera:
    variance, error = alignment.spread
    inlier = alignment.inlier
    outliers, frame_slots = int((~inlier).sum()), frames.seen + frames.missed
    names = ("bearing_sd", "elevation_sd", "range_sd", "stamp_jitter")
    intervals = {
        name: deviation_interval(*pair) for name, pair in zip(names, zip(variance, error, strict=True), strict=True)
    }
    rate = 1 / frames.period
    intervals["rate_hz"] = around(rate, rate * frames.period_sd / frames.period)
    intervals["time_offset"] = around(alignment.offset, alignment.offset_sd)
    intervals["miss_probability"] = share_interval(frames.missed, frame_slots)
    intervals["outlier_share"] = share_interval(outliers, inlier.size)
    jitter = None
    if seen.receive is not None:
        jitter, intervals["latency_jitter"] = _latency_jitter(
            seen.receive - seen.time, float(variance[3]), float(error[3]), intervals["stamp_jitter"]
        )
    latency, feedback_delay, feedback_interval = _latency(seen, alignment, by_steps, gimbal_clock, intervals)
    record = CameraRecord(
        rate_hz=rate,
        time_offset=alignment.offset,
        **{name: float(np.sqrt(each)) for name, each in zip(names, variance, strict=True)},
        noise_range=float(np.median(np.linalg.norm(seen.position[inlier], axis=1))),
        miss_probability=frames.missed / frame_slots,
        outlier_share=outliers / inlier.size,
        latency=None if latency is None else latency[0],
        latency_jitter=jitter,
        latency_basis="" if latency is None else latency[1],
    )
    return _Camera(record, {f"camera.{k}": v for k, v in intervals.items()}, feedback_delay, feedback_interval)


def _latency(
    seen: Detections,
    alignment: PlateAlignment,
    by_steps: StepLatency | None,
    gimbal_clock: GimbalClock,
    intervals: dict[str, Interval],
) -> tuple[tuple[float, str] | None, float | None, Interval | None]:
    """Return the latency with its basis, and the feedback's delay with its interval, as far as they can be told."""
    by_stamps, error = None, 0.0
    if gimbal_clock == "receipt" and seen.receive is not None:
        delay = seen.receive - seen.time
        by_stamps = float(delay.mean()) - alignment.offset
        error = float(np.hypot(standard_error(delay), alignment.offset_sd))
        _check_receipts(by_stamps, seen.source)
    if by_steps is None:
        if by_stamps is None:
            return None, None, None
        intervals["latency"] = around(by_stamps, error)
        return (by_stamps, "feedback"), None, None
    intervals["latency"] = by_steps.interval
    if by_stamps is None:
        return (by_steps.latency, "exposure"), None, None
    # A gimbal log stamped on receipt is late by the feedback's delay; aligned to it, exposures seem late as well.
    difference = by_steps.latency - by_stamps
    half = [np.hypot(end - by_steps.latency, around(0.0, error)[1]) for end in by_steps.interval]
    return (by_steps.latency, "exposure"), difference, (difference - float(half[0]), difference + float(half[1]))


def _check_receipts(latency: float, source: str) -> None:
    if not EARLIEST <= latency <= LONGEST:
        raise InputError(
            f"{source}: detections are received {latency:.3g} s after their exposure, expected {EARLIEST:g}…"
            f"{LONGEST:g} s; stamp receipts and the gimbal log by one clock, or say --gimbal-clock own"
        )


def _latency_jitter(
    delay: Array, stamp_variance: float, stamp_error: float, stamp_interval: Interval
) -> tuple[float, Interval]:
    """Return the standard deviation of the latency with its interval, from the times between stamp and receipt."""
    scatter = float(delay.var(ddof=1))
    # Frames that are stamped on receipt carry the latency's jitter in their stamps.
    if scatter == 0:
        return float(np.sqrt(stamp_variance)), stamp_interval
    rest, half = scatter - stamp_variance, around(0.0, stamp_error)[1]
    low, high = (end**2 for end in scatter_interval(delay))
    # Both variances are estimated apart, so their errors add in squares.
    ends = rest - np.hypot(scatter - low, half), rest + np.hypot(high - scatter, half)
    return float(np.sqrt(max(rest, 0.0))), (float(np.sqrt(max(ends[0], 0.0))), float(np.sqrt(max(ends[1], 0.0))))


def _link(feedback: Feedback, delay: CommandDelay | None, camera: _Camera) -> tuple[LinkRecord, dict[str, Interval]]:
    intervals: dict[str, Interval] = {}
    if delay is not None:
        intervals = {"link.command_delay": delay.interval, "link.command_jitter": delay.jitter_interval}
    if camera.feedback_delay_interval is not None:
        intervals["link.feedback_delay"] = camera.feedback_delay_interval
    record = LinkRecord(
        feedback_rate_hz=feedback.rate_hz,
        feedback_quantum=feedback.quantum,
        command_delay=None if delay is None else delay.mean,
        command_jitter=None if delay is None else delay.jitter,
        feedback_delay=camera.feedback_delay,
    )
    return record, intervals


def _with_messages(
    link: LinkRecord, intervals: dict[str, Interval], commands: MessageTimes | None, feedback: MessageTimes | None
) -> tuple[LinkRecord, dict[str, Interval]]:
    """Add what stamps at both ends tell of each direction."""
    intervals = dict(intervals)
    for name, times in (("command_latency", commands), ("feedback_latency", feedback)):
        if times is not None:
            timing = link_timing(times)
            link = replace(link, **{name: timing.mean, f"{name}_jitter": timing.jitter})
            intervals[f"link.{name}"] = timing.mean_interval
            intervals[f"link.{name}_jitter"] = timing.jitter_interval
    return link, intervals


def _unstamped(link: LinkRecord) -> list[str]:
    """Say what follows where no stamps tell how late commands are."""
    if link.command_latency is not None:
        return []
    told = (
        "The command latency is not known, so the simulator sends commands without any (right only for plants whose "
        "logs hold it already). Give --commands and --feedback, the stamps of both ends; archerfish record timing "
        "writes them as timing_commands.csv and timing_reports.csv."
    )
    return [told]


def _missing(camera: CameraRecord, delay: CommandDelay | None, gimbal_clock: GimbalClock, received: bool) -> list[str]:
    told = []
    if camera.latency is None:
        cause = (
            "the gimbal log has a clock of its own" if gimbal_clock == "own" and received else "no receipts are logged"
        )
        told.append(
            f"The camera's latency is not known: {cause}. Record a target that steps at known moments "
            "(--target-steps), with the time of receipt of each detection."
        )
    elif camera.latency_basis == "feedback":
        told.append(
            "The latency counts from the gimbal's feedback: it is the camera's latency less the feedback's delay, "
            "which these logs can't separate. Record a target that steps at known moments (--target-steps)."
        )
    if delay is None:
        told.append(
            f"The command-to-motion delay is not known: it takes at least {FEWEST} steps of the command, each held for "
            "0.3 s, in a gimbal log with the command's column. Record some twenty steps of 5–10°."
        )
    return told
