"""Camera and link from two short recordings: a plate at rest under a yaw sweep, then steps of command and target.

What these can't separate is reported as a sum, or left out with the measurement that it takes.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification import statistics
from archerfish2.identification.sensing import timing
from archerfish2.identification.sensing.alignment import align, rough_offset, spherical
from archerfish2.identification.sensing.result import SensingResult
from archerfish2.identification.sensing.track import gimbal_track
from archerfish2.logs import timing as logs
from archerfish2.provenance import provenance
from archerfish2.records.sensing import SensingRecord
from archerfish2.reports.table import Estimate

_FARTHEST_M = 100.0  # that a plate is seen


def identify_sensing(
    sweep: logs.GimbalLog | str | Path,
    detections: logs.DetectionLog | str | Path,
    *,
    steps: Sequence[logs.GimbalLog | str | Path] = (),
    target: logs.DetectionLog | str | Path | None = None,
    target_steps: statistics.Array | str | Path | None = None,
    commands: logs.MessageTimes | str | Path | None = None,
    feedback: logs.MessageTimes | str | Path | None = None,
    frame: logs.Frame = "camera",
    degrees: bool = False,
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
      frame: of the positions in files, see `read_detections`.
      degrees: whether angles in files are in degrees instead of radians.
      gimbal_clock: who stamped the gimbal logs: the program on receipt, or the gimbal by a clock of its own.
      max_offset_s: largest time offset of the search [s]; if 0 it is 1 s where the clocks overlap, else any.
      seed: written into the record; nothing here is random.

    Raises:
      InputError: if a log can't be read or is too short, logs don't belong together, or they don't support the
        estimate.
    """
    if (target is None) != (target_steps is None):
        raise InputError("target and target_steps: got one without the other; pass both, or neither", "target-steps")
    allowed = {"frame": (frame, get_args(logs.Frame)), "gimbal_clock": (gimbal_clock, ("receipt", "own"))}
    for name, (value, values) in allowed.items():
        if value not in values:
            raise InputError(f"{name}: expected {' or '.join(values)}, got {value}; correct it")
    read_gimbal = partial(logs.read_gimbal_log, degrees=degrees)
    read_detections = partial(logs.read_detections, frame=frame, degrees=degrees)
    log, *more = (_read(read_gimbal, each) for each in (sweep, *steps))
    plate, stepping = (_read(read_detections, each) for each in (detections, target))
    if (far := float(np.median(np.linalg.norm(plate.position, axis=1)))) > _FARTHEST_M:
        raise InputError(f"{plate.source}: the plate is {far:.4g} m away; give positions in metres", "millimetres")
    start = log.time[0]  # far from it, numbers have no room for microseconds
    track, stamps = gimbal_track(log._replace(time=log.time - start)), plate.time - start
    period, missed = timing.frame_timing(stamps, plate.source)
    azimuth = spherical(plate.position)[:, 0]
    offset = rough_offset(track, stamps, azimuth, max_offset_s, plate.source)
    alignment = align(track, stamps, plate.position, offset)
    found = alignment.estimates | {
        "camera.rate_hz": statistics.converted(period, lambda value: 1 / value, "Hz"),
        "camera.miss_probability": missed,
        "link.feedback_rate_hz": Estimate(track.rate_hz, np.nan, np.nan, "Hz"),
    }
    if track.quantum is not None:
        found["link.feedback_quantum"] = Estimate(track.quantum, np.nan, np.nan, "rad")
    counts, basis = {"detections": (int(alignment.inlier.sum()), stamps.size)}, ""
    if plate.receive is not None:
        delay = plate.receive - plate.time
        found["camera.latency_jitter"] = timing.latency_jitter(delay, found["camera.stamp_jitter"])
        if gimbal_clock == "receipt":
            found["camera.latency"] = timing.sweep_latency(delay, found["camera.time_offset"], plate.source)
            basis = "feedback"
    if stepping is not None:
        moments = np.asarray(_read(logs.read_moments, target_steps))
        exposed, used = timing.step_latency(stepping, moments, period.value)
        if basis:  # a log stamped on receipt is late by the feedback's delay, and so are exposures aligned to it
            found["link.feedback_delay"] = statistics.difference(exposed, found["camera.latency"])
        found["camera.latency"], basis, counts["target steps"] = exposed, "exposure", (used, moments.size)
    delays, logged = timing.command_delays([log, *more])
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
    files = [Path(each) for each in sources if isinstance(each, str | Path) and Path(each).is_file()]
    parts: dict[str, Any] = {"camera": {"latency_basis": basis}, "link": {}}
    for name, each in found.items():
        part, field = name.split(".")
        parts[part][field] = float(each.value)
    intervals = {name: (each.low, each.high) for name, each in found.items() if np.isfinite(each.low)}
    record = SensingRecord(**parts, intervals=intervals, provenance=provenance(seed, files))
    return SensingResult(record, found, alignment, track, counts)


def _read(reader: Callable[[str | Path], Any], given: Any) -> Any:
    return reader(given) if isinstance(given, str | Path) else given
