"""Camera and link from two short recordings: a plate at rest under a yaw sweep, then steps of command and target.

What these can't separate is reported as a sum, or left out with the measurement that it takes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification import statistics
from archerfish2.identification.sensing.alignment import Alignment, align, alignment_plot, scan_offsets, spherical
from archerfish2.identification.sensing.delays import EARLIEST_S, LONGEST_S, command_delays, step_latency
from archerfish2.identification.sensing.report import sensing_report
from archerfish2.identification.sensing.timing import FrameTiming, frame_timing, latency_jitter, message_latency
from archerfish2.identification.sensing.track import GimbalTrack, gimbal_track
from archerfish2.identification.statistics import Array
from archerfish2.logs import timing as logs
from archerfish2.provenance import provenance
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish2.reports.report import Report
from archerfish2.reports.table import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

File: TypeAlias = str | Path


@dataclass(frozen=True, eq=False)
class SensingResult:
    """An identified sensing and how it came about; times of arrays count from the first stamp on each clock."""

    sensing: SensingRecord
    estimates: dict[str, Estimate]  # by the record's names, such as "camera.latency", in SI units
    alignment: Alignment
    scan: Array  # offsets [s] and the misfit at each [rad], (2, M)
    track: GimbalTrack
    frames: FrameTiming
    counts: dict[str, tuple[int, int]]  # of detections and steps: used, logged
    missing: tuple[str, ...]  # what was not estimated, and the measurement that it takes

    @property
    def report(self) -> Report:
        """What is known, what is in doubt, and what to record next."""
        return sensing_report(self)

    def save(self, folder: File) -> list[Path]:
        """Write sensing.json and sensing.html, and return their paths."""
        paths = [Path(folder) / "sensing.json", Path(folder) / "sensing.html"]
        self.sensing.save(paths[0])
        self.report.write_page(paths[1])
        return paths

    def plot(self) -> "Figure":
        """Draw how camera and gimbal are aligned."""
        return alignment_plot(self.scan, self.track, self.alignment)


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

    def read(reader: Any, given: Any) -> Any:
        return reader(given) if isinstance(given, File) else given

    log, seen = read(logs.read_gimbal_log, sweep), read(logs.read_detections, detections)
    if (target is None) != (target_steps is None):
        raise InputError("target and target_steps: got one without the other; pass both, or neither", "target-steps")
    host, origin = log.time[0], seen.time[0]  # of the clocks: far from it, numbers have no room for microseconds
    track, stamps = gimbal_track(log._replace(time=log.time - host)), seen.time - origin
    frames = frame_timing(stamps, seen.source)
    scan = scan_offsets(track, stamps, spherical(seen.position)[:, 0], max_offset_s, origin - host)
    start = scan[0, np.argmin(scan[1])]
    kept = track.covers(stamps + start)
    if kept.sum() < 20:
        problem = f"{kept.sum()} detections lie inside the gimbal log, expected at least 20"
        raise InputError(f"{seen.source}: {problem}; log both at once, for longer", "no-overlap")
    alignment = align(track, stamps[kept], seen.position[kept], start)
    offset, used, basis = alignment.estimates["camera.time_offset"], int(alignment.inlier.sum()), ""
    found = alignment.estimates | {
        "camera.time_offset": statistics.converted(offset, lambda value: value - float(origin - host)),
        "camera.rate_hz": statistics.converted(frames.period, lambda period: 1 / period, "Hz"),
        "camera.miss_probability": statistics.share_estimate(frames.missed, frames.seen + frames.missed),
        "camera.outlier_share": statistics.share_estimate(alignment.inlier.size - used, alignment.inlier.size),
        "link.feedback_rate_hz": Estimate(track.rate_hz, np.nan, np.nan, "Hz"),
    }
    if track.quantum is not None:
        found["link.feedback_quantum"] = Estimate(track.quantum, np.nan, np.nan, "rad")
    if seen.receive is not None:
        delay = seen.receive[kept] - (host if gimbal_clock == "receipt" else seen.receive[0]) - stamps[kept]
        found["camera.latency_jitter"] = latency_jitter(delay, found["camera.stamp_jitter"])
        if gimbal_clock == "receipt":
            basis, latency = "feedback", statistics.difference(statistics.mean_estimate(delay), offset)
            found["camera.latency"] = latency
            if not EARLIEST_S <= latency.value <= LONGEST_S:
                problem = f"received {latency.value:.3g} s after exposure, expected {EARLIEST_S:g} to {LONGEST_S:g} s"
                remedy = 'stamp receipts and gimbal log by one clock, or pass gimbal_clock="own"'
                raise InputError(f"{seen.source}: {problem}; {remedy}", "two-clocks")
    counts = {"detections": (used, seen.time.size)}
    if target is not None:
        moments = np.asarray(read(logs.read_moments, target_steps))
        exposed, used = step_latency(read(logs.read_detections, target), moments, frames.period.value)
        if basis:  # a log stamped on receipt is late by the feedback's delay, and so are exposures aligned to it
            found["link.feedback_delay"] = statistics.difference(exposed, found["camera.latency"])
        counts["target steps"], found["camera.latency"], basis = (used, moments.size), exposed, "exposure"
    delays, logged = command_delays([log, *(read(logs.read_gimbal_log, each) for each in steps)])
    counts["command steps"] = delays.size, logged
    if delays.size >= 4:
        found["link.command_delay"] = statistics.sample_estimates(delays, "s")[0]
        found["link.command_jitter"] = statistics.scatter_estimate(delays)
    for name, times in (("link.command_latency", commands), ("link.feedback_latency", feedback)):
        if times is not None:
            found |= message_latency(name, read(logs.read_message_times, times))
    camera, link = (
        {name.removeprefix(part): float(each.value) for name, each in found.items() if name.startswith(part)}
        for part in ("camera.", "link.")
    )
    camera["noise_range"] = float(np.median(np.linalg.norm(seen.position[kept][alignment.inlier], axis=1)))
    given = (sweep, detections, *steps, target, target_steps, commands, feedback)
    sources = [getattr(each, "source", each) for each in given]
    record = SensingRecord(
        camera=CameraRecord(**camera, latency_basis=basis),  # type: ignore[arg-type]
        link=LinkRecord(**link),
        intervals={name: (each.low, each.high) for name, each in found.items() if np.isfinite(each.low)},
        provenance=provenance(
            seed, [Path(each) for each in sources if isinstance(each, File) and Path(each).is_file()]
        ),
    )
    cause = "no receipts are logged" if seen.receive is None else "the gimbal log has a clock of its own"
    unknown = {
        f"The camera's latency is not known, {cause}: record a target that steps at known moments.": not basis,
        "The latency is less the feedback's delay: record a target that steps at known moments.": basis == "feedback",
        "The command delay is not known: log 20 steps of the command of 5 to 10°.": "command_delay" not in link,
        "The command latency is not known: log sent_s and received_s of commands.": "command_latency" not in link,
    }
    missing = tuple(each for each, holds in unknown.items() if holds)
    return SensingResult(record, found, alignment, scan, track, frames, counts, missing)
