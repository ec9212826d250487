"""Camera and link from two short recordings: a plate at rest under a yaw sweep, then steps of command and target.

What these can't separate is reported as a sum, or left out with the measurement that it takes.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification import statistics
from archerfish2.identification.sensing.alignment import align, rough_offset, spherical
from archerfish2.identification.sensing.delays import EARLIEST_S, LONGEST_S, command_delays, step_latency
from archerfish2.identification.sensing.result import SensingResult
from archerfish2.identification.sensing.timing import frame_timing, latency_jitter
from archerfish2.identification.sensing.track import gimbal_track
from archerfish2.identification.statistics import Array, converted, difference
from archerfish2.logs import timing as logs
from archerfish2.provenance import provenance
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish2.reports.table import Estimate

File: TypeAlias = str | Path


def identify_sensing(
    sweep: logs.GimbalLog | File,
    detections: logs.DetectionLog | File,
    *,
    steps: Sequence[logs.GimbalLog | File] = (),
    target: logs.DetectionLog | File | None = None,
    target_steps: Array | File | None = None,
    commands: logs.MessageTimes | File | None = None,
    feedback: logs.MessageTimes | File | None = None,
    gimbal_clock: Literal["receipt", "own"] = "receipt",
    max_offset_s: float = 0.0,
    seed: int = 0,
) -> SensingResult:
    """Identify camera and link from a plate at rest under a yaw sweep, and from command and target steps.

    Args:
      sweep: the gimbal's log of the sweep, or its file.
      detections: of the plate at rest.
      steps: further logs of the gimbal, with steps of the command.
      target: detections of a target that steps, the gimbal at rest.
      target_steps: moments of these steps, on the clock of receipts [s], increasing, shape (S,).
      commands: when commands were sent and received, if the gimbal stamps them.
      feedback: when the gimbal's feedback was sent and received, if the gimbal stamps it.
      gimbal_clock: who stamped the gimbal logs: the program on receipt, or the gimbal by a clock of its own.
      max_offset_s: largest time offset of the search [s]; if 0 it is 1 s where the clocks overlap, else any.
      seed: written into the record; nothing here is random.

    Raises:
      InputError: if a log can't be read or is too short, logs don't belong together, or they don't support the
        estimate.
    """
    if (target is None) != (target_steps is None):
        raise InputError("target and target_steps: got one without the other; pass both, or neither", "target-steps")
    log, *more = (_read(logs.read_gimbal_log, each) for each in (sweep, *steps))
    plate, stepping = (_read(logs.read_detections, each) for each in (detections, target))
    start = log.time[0]  # far from it, numbers have no room for microseconds
    track, stamps = gimbal_track(log._replace(time=log.time - start)), plate.time - start
    period, missed = frame_timing(stamps, plate.source)
    offset = rough_offset(track, stamps, spherical(plate.position)[:, 0], max_offset_s)
    alignment = align(track, stamps, plate.position, offset)
    found = alignment.estimates | {
        "camera.rate_hz": converted(period, lambda value: 1 / value, "Hz"),
        "camera.miss_probability": missed,
        "link.feedback_rate_hz": Estimate(track.rate_hz, np.nan, np.nan, "Hz"),
    }
    if track.quantum is not None:
        found["link.feedback_quantum"] = Estimate(track.quantum, np.nan, np.nan, "rad")
    counts = {"detections": (int(alignment.inlier.sum()), stamps.size)}
    basis = ""
    if plate.receive is not None:
        delay = plate.receive - plate.time
        found["camera.latency_jitter"] = latency_jitter(delay, found["camera.stamp_jitter"])
        if gimbal_clock == "receipt":
            basis, found["camera.latency"] = "feedback", _latency(delay, found["camera.time_offset"], plate.source)
    if stepping is not None:
        moments = np.asarray(_read(logs.read_moments, target_steps))
        exposed, used = step_latency(stepping, moments, period.value)
        if basis:  # a log stamped on receipt is late by the feedback's delay, and so are exposures aligned to it
            found["link.feedback_delay"] = difference(exposed, found["camera.latency"])
        found["camera.latency"], basis, counts["target steps"] = exposed, "exposure", (used, moments.size)
    delays, logged = command_delays([log, *more])
    counts["command steps"] = delays.size, logged
    if delays.size >= 4:
        found["link.command_delay"] = statistics.sample_mean(delays)
        found["link.command_jitter"] = statistics.scatter_estimate(delays)
    for name, times in (("link.command_latency", commands), ("link.feedback_latency", feedback)):
        if times is not None:
            sent, received = _read(logs.read_message_times, times)
            found[name] = statistics.mean_estimate(received - sent)
            found[f"{name}_jitter"] = statistics.scatter_estimate(received - sent)
    given = (sweep, detections, *steps, target, target_steps, commands, feedback)
    sources = [getattr(each, "source", each) for each in given]
    files = [Path(each) for each in sources if isinstance(each, File) and Path(each).is_file()]
    record = _record(found, basis, provenance(seed, files))
    return SensingResult(record, found, alignment, track, counts)


def _read(reader: Callable[[File], Any], given: Any) -> Any:
    return reader(given) if isinstance(given, File) else given


def _latency(delay: Array, offset: Estimate, source: str) -> Estimate:
    """Return the latency less the feedback's delay, from the times between stamps and receipts, shape (K,)."""
    latency = difference(statistics.mean_estimate(delay), offset)
    if not EARLIEST_S <= latency.value <= LONGEST_S:
        problem = f"received {latency.value:.3g} s after exposure, expected {EARLIEST_S:g} to {LONGEST_S:g} s"
        remedy = 'stamp receipts and gimbal log by one clock, or pass gimbal_clock="own"'
        raise InputError(f"{source}: {problem}; {remedy}", "two-clocks")
    return latency


def _record(found: dict[str, Estimate], basis: Any, origin: dict[str, Any]) -> SensingRecord:
    camera, link = (
        {name.removeprefix(part): float(each.value) for name, each in found.items() if name.startswith(part)}
        for part in ("camera.", "link.")
    )
    intervals = {name: (each.low, each.high) for name, each in found.items() if np.isfinite(each.low)}
    camera_record = CameraRecord(**camera, latency_basis=basis)
    return SensingRecord(camera=camera_record, link=LinkRecord(**link), intervals=intervals, provenance=origin)
