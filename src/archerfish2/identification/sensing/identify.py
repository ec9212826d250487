"""Camera and link from two short recordings: a plate at rest under a yaw sweep, then steps of command and target.

What these can't separate is reported as a sum, or left out with the measurement that it takes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification.sensing import delays, timing
from archerfish2.identification.sensing.alignment import Alignment, OffsetScan, align, scan_offsets
from archerfish2.identification.sensing.plots import alignment_plot
from archerfish2.identification.sensing.report import sensing_report
from archerfish2.identification.sensing.track import GimbalTrack, gimbal_track
from archerfish2.identification.statistics import Array, sample_estimates
from archerfish2.logs import timing as logs
from archerfish2.provenance import provenance
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish2.reports.report import Report
from archerfish2.reports.table import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

File: TypeAlias = str | Path
FEWEST_COMMANDS = 4
"""Command steps that a mean delay takes."""


@dataclass(frozen=True, eq=False)
class SensingResult:
    """An identified sensing and how it came about; times of its arrays count from the first stamp of each clock."""

    sensing: SensingRecord
    estimates: dict[str, Estimate]  # by the record's names, such as "camera.latency", in SI units
    alignment: Alignment
    scan: OffsetScan
    track: GimbalTrack
    receipt_delay: Array | None  # from aligned exposure to receipt [s], (K,); None without receipts on that clock
    command_delays: Array  # of the command steps that were used [s], (S,)
    counts: dict[str, int]  # of what was logged and used
    missing: tuple[str, ...]  # what was not estimated, and the measurement that it takes
    report: Report

    def save(self, folder: File) -> list[Path]:
        """Write sensing.json and sensing.html, and return their paths."""
        paths = [Path(folder) / "sensing.json", Path(folder) / "sensing.html"]
        self.sensing.save(paths[0])
        self.report.write_page(paths[1])
        return paths

    def plot(self) -> "Figure":
        """Draw the alignment of camera and gimbal."""


def identify_sensing(
    sweep: logs.GimbalLog | File,
    detections: logs.Detections | File,
    *,
    steps: Sequence[logs.GimbalLog | File] = (),
    target: logs.Detections | File | None = None,
    target_steps: Array | File | None = None,
    commands: logs.MessageTimes | File | None = None,
    feedback: logs.MessageTimes | File | None = None,
    gimbal_clock: Literal["receipt", "own"] = "receipt",
    max_offset_s: float | None = None,
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
      max_offset_s: largest time offset of the search [s]; 1 s if not given and the clocks overlap, else any.
      seed: written into the record; nothing here is random.

    Raises:
      InputError: if a log can't be read or is too short, logs don't belong together, or they don't support the
        estimate.
    """
    read: Callable[[Any, Any], Any] = lambda reader, given: reader(given) if isinstance(given, str | Path) else given
    log, seen = read(logs.read_gimbal_log, sweep), read(logs.read_detections, detections)
    if (target is None) != (target_steps is None):
        raise InputError("target and target_steps: got one without the other; pass both, or neither", "target-steps")
    host, camera = log.time[0], seen.time[0]  # origins of both clocks
    track, stamps = gimbal_track(log._replace(time=log.time - host)), seen.time - camera
    frames = timing.frame_timing(stamps, seen.source)
    azimuth = np.arctan2(seen.position[:, 1], seen.position[:, 0])
    scan = scan_offsets(track, stamps, azimuth, max_offset_s, camera - host)
    kept = track.covers(stamps + scan.best)
    if kept.sum() < 20:
        problem = f"{kept.sum()} detections lie inside the gimbal log, expected at least 20"
        raise InputError(f"{seen.source}: {problem}; log both at once, for longer", "no-overlap")
    alignment = align(track, stamps[kept], seen.position[kept], scan.best)
    offset, outliers = alignment.offset, int(np.sum(~alignment.inlier))
    found = {f"camera.{name}_sd": each for name, each in zip(("bearing", "elevation", "range"), alignment.noise)}
    found |= {
        "camera.rate_hz": timing.normal_estimate(1 / frames.period, frames.period_sd / frames.period**2, "Hz"),
        "camera.time_offset": Estimate(*(float(each - camera + host) for each in offset[:3]), "s"),
        "camera.stamp_jitter": alignment.noise[3],
        "camera.miss_probability": timing.share_estimate(frames.missed, frames.seen + frames.missed),
        "camera.outlier_share": timing.share_estimate(outliers, alignment.inlier.size),
        "link.feedback_rate_hz": Estimate(track.rate_hz, np.nan, np.nan, "Hz"),
    }
    if track.quantum is not None:
        found["link.feedback_quantum"] = Estimate(track.quantum, np.nan, np.nan, "rad")
    basis, receipt_delay, by_stamps = "", None, None
    if seen.receive is not None:
        delay = seen.receive[kept] - (host if gimbal_clock == "receipt" else seen.receive[0]) - stamps[kept]
        found["camera.latency_jitter"] = _latency_jitter(delay, alignment.noise[3])
        if gimbal_clock == "receipt":
            mean = timing.normal_estimate(float(delay.mean()), timing.standard_error(delay))
            receipt_delay, by_stamps, basis = delay - offset.value, timing.difference(mean, offset), "feedback"
            found["camera.latency"] = by_stamps
            if not delays.EARLIEST_S <= by_stamps.value <= delays.LONGEST_S:
                problem = f"detections are received {by_stamps.value:.3g} s after their exposure"
                remedy = 'stamp receipts and the gimbal log by one clock, or pass gimbal_clock="own"'
                raise InputError(f"{seen.source}: {problem}, expected -0.02 to 0.5 s; {remedy}", "two-clocks")
    target_used, moments = 0, np.zeros(0)
    if target is not None:
        moments, shown = np.asarray(read(logs.read_moments, target_steps)), read(logs.read_detections, target)
        receive = None if shown.receive is None else shown.receive - moments[0]
        shown = shown._replace(time=shown.time - shown.time[0], receive=receive)
        found["camera.latency"], target_used = delays.step_latency(shown, moments - moments[0], frames.period)
        basis = "exposure"
        if by_stamps is not None:
            # A gimbal log stamped on receipt is late by the feedback's delay; aligned to it, exposures seem late as well.
            found["link.feedback_delay"] = timing.difference(found["camera.latency"], by_stamps)
    each_log = [delays.command_steps(each) for each in (log, *(read(logs.read_gimbal_log, each) for each in steps))]
    command = np.array([delay for each in each_log for delay in each.delays])
    if command.size:  # less those of steps during which something else moved the axis
        apart = np.abs(command - np.median(command))
        command = command[apart <= 5 * 1.4826 * np.median(apart) + 1e-3]
    if command.size >= FEWEST_COMMANDS:
        found["link.command_delay"] = sample_estimates(command, "s")[0]
        found["link.command_jitter"] = timing.scatter_estimate(command)
    for name, given in (("command", commands), ("feedback", feedback)):
        if given is not None:
            times = read(logs.read_message_times, given)
            latency = times.received - times.sent
            mean = timing.normal_estimate(float(latency.mean()), timing.standard_error(latency))
            found |= {f"link.{name}_latency": mean, f"link.{name}_latency_jitter": timing.scatter_estimate(latency)}
    values: dict[str, dict[str, Any]] = {"camera": {}, "link": {}}
    for name, each in found.items():
        values[name.partition(".")[0]][name.partition(".")[2]] = float(each.value)
    plate = seen.position[kept][alignment.inlier]
    files = [Path(each) for each in (sweep, detections, *steps, target, target_steps, commands, feedback) if isinstance(each, str | Path)]
    record = SensingRecord(
        camera=CameraRecord(
            **values["camera"], noise_range=float(np.median(np.linalg.norm(plate, axis=1))), latency_basis=basis
        ),
        link=LinkRecord(**values["link"]),
        intervals={name: (each.low, each.high) for name, each in found.items() if np.isfinite(each.low)},
        provenance=provenance(seed, files),
    )
    counts = {}
    return SensingResult(record, found, alignment, scan, track, receipt_delay, command, counts, (), None)


def _latency_jitter(delay: Array, stamps: Estimate) -> Estimate:
    """Return the standard deviation of the latency, from the times between stamp and receipt, of shape (K,)."""
    scatter = timing.scatter_estimate(delay)
    if scatter.value < 1e-6:  # frames that are stamped on receipt carry the latency's jitter in their stamps
        return stamps
    squares = (Estimate(each.value**2, each.low**2, each.high**2) for each in (scatter, stamps))
    return Estimate(*np.sqrt(np.maximum(timing.difference(*squares)[:3], 0.0)).tolist(), "s")
