"""Camera and link from two short recordings: a plate at rest under a yaw sweep, then steps of command and target.

What these can't separate is reported as a sum, or left out with the measurement that it takes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from archerfish.errors import InputError, checked_arguments, file_error
from archerfish.identification import statistics
from archerfish.identification.sensing import stamp_faults, timing
from archerfish.identification.sensing.alignment import Alignment, GimbalTrack, align, gimbal_track, rough_offset
from archerfish.logs import timing as logs
from archerfish.logs.recording import Finding
from archerfish.provenance import provenance
from archerfish.records.sensing import SensingRecord
from archerfish.reports.report import Report, Result
from archerfish.reports.style import Figure, new_figure, plot_style
from archerfish.reports.table import Entry, Estimate, Table, entry_texts, number

_EXPLAINED = 0.02  # share of the bearing's residual that the gimbal's motion may explain
_FARTHEST_M = 100.0  # that a plate is seen
_SHOWN = {"s": ("ms", 1e3), "rad": ("mrad", 1e3), "m": ("mm", 1e3), "Hz": ("Hz", 1.0), "": ("%", 100.0)}
"""Unit and factor in which estimates are shown."""
_ROWS = (
    ("exposure of a frame to receipt", "camera.latency", "camera.latency_jitter"),
    ("stamp of a frame to its exposure", "camera.time_offset", "camera.stamp_jitter"),
    ("command to logged motion", "link.command_delay", "link.command_jitter"),
    ("  of it: motion to its stamp", "link.feedback_delay", ""),
    ("command sent to received", "link.command_latency", "link.command_latency_jitter"),
    ("feedback sent to received", "link.feedback_latency", "link.feedback_latency_jitter"),
    ("plate's direction, to the side", "", "camera.bearing_sd"),
    ("plate's direction, in height", "", "camera.elevation_sd"),
    ("plate's distance", "", "camera.range_sd"),
    ("frames a second", "camera.rate_hz", ""),
    ("frames without the plate [%]", "camera.miss_probability", ""),
    ("detections of something else [%]", "camera.outlier_share", ""),
    ("logged angles a second", "link.feedback_rate_hz", ""),
    ("step of the logged angle", "link.feedback_quantum", ""),
)
"""What a quantity is, and the record's names of its mean and its standard deviation."""


@dataclass(frozen=True, eq=False, repr=False)
class SensingResult(Result):
    """An identified sensing and how it came about; times of arrays count from the gimbal log's first stamp."""

    record: SensingRecord
    estimates: dict[str, Estimate]  # by the record's names, such as "camera.latency", in SI units
    alignment: Alignment
    track: GimbalTrack
    counts: dict[str, tuple[int, int]]  # of detections and steps: used, logged
    findings: tuple[Finding, ...]  # what was left out of files
    stamp_faults: tuple[str, ...] = ()  # what is wrong with stamps and receipts

    part = "sensing"

    def plot(self) -> Figure:
        """Draw the yaw by gimbal and camera in the second of fastest motion."""
        moments, residual = self.alignment.moments, self.alignment.residual
        rates = np.abs(self.track.angles(moments, 1)[:, 0])
        near = np.abs(moments - moments[np.argmax(rates)]) < 0.5
        time, yaw = moments[near], np.degrees(self.track.angles(moments[near])[:, 0])
        with plot_style():
            figure, ((axes,),) = new_figure()
            axes.plot(time, yaw, time, yaw - np.degrees(residual[near, 0]), ".")
            axes.set(xlabel="time since the gimbal log began [s]", ylabel="yaw [°]")
        return figure

    @cached_property
    def report(self) -> Report:
        """Verdict, what is known, what is in doubt, and what to record next."""
        camera, link, shown = self.record.camera, self.record.link, dict[str, Entry]()
        for name, (value, low, high, unit) in self.estimates.items():
            unit, factor = _SHOWN[unit]
            estimate = Estimate(factor * value, factor * low, factor * high, unit)
            shown[name] = value if unit == "Hz" else estimate  # the interval of a rate is some parts in a million
        words = {name: "{} ({})".format(*entry_texts(entry)) for name, entry in shown.items()}
        latency, delay = (words.get(name, "not known") for name in ("camera.latency", "link.command_delay"))
        across = 1e3 * camera.noise_range * max(camera.bearing_sd, camera.elevation_sd)
        place = f"{number(across, 2)} mm at {camera.noise_range:.2g} m"
        less = ", less the delay of the gimbal's feedback" * (camera.latency_basis == "feedback")
        known = {
            f"A detection is received {latency} after its frame was exposed{less}.": camera.latency is not None,
            f"A plate at rest scatters by {place} across the line of sight (standard deviation).": True,
            f"The angle moves {delay} after a command, which plants include.": link.command_delay is not None,
            **{f"{used} of {logged} {name} used.": used < logged for name, (used, logged) in self.counts.items()},
            "Figures in brackets are 95 % intervals.": True,
        }
        early, uneven = 1e3 * (link.feedback_delay or 0.0), 2**0.5 * camera.stamp_jitter * camera.rate_hz
        moving, drift = self.alignment.motion_share, 1e6 * self.alignment.drift
        unsteady = moving > _EXPLAINED
        other, missed = camera.outlier_share, camera.miss_probability
        spoiling = {
            f"Detections scatter by {across:.0f} mm: show one plate at rest, with positions in metres.": across > 50,
            f"The feedback's delay is below zero ({early:.1f} ms): stamp all logs by one clock.": early < -3,
        }
        doubtful = {
            "The latency is unknown, and taken as 0: log receive_s by the gimbal log's clock.": camera.latency is None,
            f"The gimbal's motion explains {moving:.0%} of the bearing's residual, which intervals do not include: "
            f"calibrate the lens, hold plate and robot still, avoid clock drift ({drift:.0f} ppm).": moving
            > _EXPLAINED,
            "Without receive_s nothing shows whether frames were dropped, or the clock was set: log it.": unsteady
            and camera.latency_jitter is None,
            f"Intervals of stamps scatter by {uneven:.0%}, so misses are miscounted: stamp exposures.": uneven > 0.15
            and not self.stamp_faults,
            f"{other:.0%} of the detections are not the plate: cover what looks like one.": other > 0.1,
            f"The plate was missed in {missed:.0%} of the frames: bring it nearer, or light it better.": missed > 0.3,
        }
        reasons, doubts = _those(spoiling), self.stamp_faults + _those(doubtful)
        missing = {
            "Mend what is wrong or in doubt, and sweep again (archerfish excite yaw --kinds sweep).": reasons + doubts,
            "For the latency from exposure, record 20 jumps of a target by 0.3 m, a second apart, and when it jumps: "
            "timing_target.csv and timing_moments.csv.": camera.latency_basis != "exposure",
            "For the delay of commands, record 20 steps of the yaw by 5 to 10°, held for half a second: "
            "timing_steps.csv.": link.command_delay is None,
            "For the latency of commands, log when the gimbal receives them, if it stamps: "
            "timing_commands.csv.": link.command_latency is None,
        }
        commands = "archerfish identify LOGS finds files of these names, archerfish identify sensing takes them."
        missing[commands] = any(missing.values())
        rows = tuple((label, *(shown.get(name) if name else "" for name in names)) for label, *names in _ROWS)
        care = "with care, see what is in doubt; " if doubts and not reasons else ""
        return Report(
            "Camera and link: what the logs say",
            f"{care}camera {camera.rate_hz:.4g} Hz, latency {latency}, noise {place}; command to motion {delay}",
            usable=not reasons,
            reasons=reasons,
            known=_those(known),
            doubts=doubts,
            next_steps=_those(missing),
            tables=(Table("Camera and link", ("quantity", "mean (95 % interval)", "standard deviation"), rows),),
            figures=(("Yaw by gimbal (line) and camera (dots), which should lie on the line.", self.plot),),
            findings=self.findings,
            provenance=dict(self.record.provenance),
        )


def _those(sentences: Mapping[str, object]) -> tuple[str, ...]:
    return tuple(sentence for sentence, holds in sentences.items() if holds)


_FEWEST_RECEIPTS = 20  # from which a latency is estimated


def _wider(estimate: Estimate, low: Any, high: Any) -> Estimate:
    return estimate._replace(low=estimate.low + float(low), high=estimate.high + float(high))


@checked_arguments
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
      frame: of the positions in files, see `read_detections`.
      degrees: whether angles in files are in degrees instead of radians.
      gimbal_clock: who stamped the gimbal logs: the program on receipt, or the gimbal by a clock of its own.
      max_offset_s: largest time offset that is searched [s]; 1 s where the clocks overlap, else any, if None.
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
    findings = list[Finding]()

    def read(reader: Callable[..., Any], source: Any, **options: Any) -> Any:
        if isinstance(source, str | Path):
            return reader(source, findings=findings, **options)
        kind = reader.__annotations__["return"]
        if source is not None and isinstance(kind, type) and not isinstance(source, kind):
            expected = f"expected a file or a {kind.__name__}, got one of type {type(source).__name__}"
            raise InputError(f"identify_sensing: {expected}; give one of these")
        return source

    log, *more = (read(logs.read_gimbal_log, source, degrees=degrees) for source in (sweep, *steps))
    plate = read(logs.read_detections, detections, frame=frame, degrees=degrees)
    stepping = read(logs.read_detections, target, frame=frame, degrees=degrees)
    if (far := float(np.median(np.linalg.norm(plate.position, axis=1)))) > _FARTHEST_M:
        raise file_error(plate.source, f"the plate is {far:.4g} m away", "give positions in metres", "millimetres")
    start = log.time[0]  # far from it, numbers have no room for microseconds
    plate, repeated, written_s = stamp_faults.written_once(plate)
    if repeated:
        message = f"detections that repeat the one before, left out: {repeated}"
        findings.append(Finding("written-again", "repaired", plate.source, message, "log each frame once", repeated))
    track, stamps = gimbal_track(log._replace(time=log.time - start)), plate.time - start
    azimuth = np.arctan2(plate.position[:, 1], plate.position[:, 0])
    step, about = stamp_faults.coarse_stamps(stamps, written_s) or (0.0, None)
    period, _ = timing.frame_timing(stamps, plate.source, about)
    received = timing.receipts(plate) - start
    logged = ~np.isnan(received)
    stamped, received = stamps[logged], received[logged]
    changes = stamp_faults.delay_changes(stamped, received, period.value)
    if stamped.size >= _FEWEST_RECEIPTS:
        delay = received - stamped
        changes = stamp_faults.attributed(changes, track, stamped, azimuth[logged], delay, max_offset_s)
    late = changes.late()
    stamps = stamps + np.append(0.0, late)[np.cumsum(logged)]
    period, missed = timing.frame_timing(stamps, plate.source, about)
    offset = rough_offset(track, stamps, azimuth, max_offset_s, plate.source)
    alignment = align(track, stamps, np.asarray(plate.position), offset)
    found = alignment.estimates | {
        "camera.rate_hz": statistics.converted(period, lambda value: 1 / value, "Hz"),
        "camera.miss_probability": missed,
        "link.feedback_rate_hz": Estimate(track.rate_hz, np.nan, np.nan, "Hz"),
    }
    if alignment.motion_share > _EXPLAINED:
        drifted = abs(alignment.drift) * np.ptp(stamps) / 2
        found["camera.time_offset"] = _wider(found["camera.time_offset"], -drifted, drifted)
    if track.quantum is not None:
        found["link.feedback_quantum"] = Estimate(track.quantum, np.nan, np.nan, "rad")
    counts, basis = {"detections": (int(alignment.inlier.sum()), stamps.size)}, ""
    delay = received - stamped - late
    if delay.size >= _FEWEST_RECEIPTS:
        slow, quick = stamp_faults.slow_changes(delay, "latency" in changes.kinds)
        found["camera.latency_jitter"] = timing.latency_jitter(quick, found["camera.stamp_jitter"])
        if gimbal_clock == "receipt":
            found["camera.latency"] = timing.sweep_latency(delay, found["camera.time_offset"], plate.source)
            basis = "feedback"
    if stepping is not None:
        moments = np.asarray(read(logs.read_moments, target_steps))
        exposed, used = timing.step_latency(stepping, moments, period.value)
        if basis:  # a log stamped on receipt is late by the feedback's delay, and so are exposures aligned to it
            found["link.feedback_delay"] = statistics.difference(exposed, found["camera.latency"])
        found["camera.latency"], basis, counts["target steps"] = exposed, "exposure", (used, moments.size)
    latency, faults = found.get("camera.latency", Estimate(0.0, 0.0, 0.0)), list[str]()
    offset_s = found["camera.time_offset"]
    faults += changes.sentences(stamped + late, offset_s.value, latency.value)
    found["camera.time_offset"] = _wider(offset_s, changes.slew.min(initial=0.0), changes.slew.max(initial=0.0))
    if delay.size >= _FEWEST_RECEIPTS and slow.any():
        if basis:  # an engagement draws from the interval, a frame from the jitter
            low, high = latency.value + slow.min(), latency.value + slow.max()
            found["camera.latency"] = latency._replace(low=float(low), high=float(high))
        if "latency" not in changes.kinds:
            scatters = f"{1e3 * slow.std():.1f} ms for long, and by {1e3 * quick.std():.1f} ms from frame to frame"
            faults.append(f"The latency scatters by {scatters}: record under the usual load.")
    if step:
        faults.append(f"Stamps are multiples of {1e3 * step:.4g} ms, which counts as jitter: stamp by a finer clock.")
    delays, steps_logged = timing.command_delays([log, *more])
    counts["command steps"] = delays.size, steps_logged
    if delays.size >= 5:
        found["link.command_delay"] = statistics.sample_mean(delays)
        found["link.command_jitter"] = statistics.scatter_estimate(delays)
    for name, times in (("link.command_latency", commands), ("link.feedback_latency", feedback)):
        if times is not None:
            pair = read(logs.read_message_times, times)
            if not isinstance(pair, tuple | list) or len(pair) != 2:
                raise InputError(f"{name}: expected a file, or moments of sending and receipt, got {ascii(pair)[:60]}")
            sent, received = pair
            found[name] = statistics.sample_mean(received - sent)
            found[f"{name}_jitter"] = statistics.scatter_estimate(received - sent)
    given = (sweep, detections, *steps, target, target_steps, commands, feedback)
    sources = [getattr(log, "source", log) for log in given]
    files = [Path(source) for source in sources if isinstance(source, str | Path) and Path(source).is_file()]
    parts: dict[str, Any] = {"camera": {"latency_basis": basis}, "link": {}}
    for name, estimate in found.items():
        part, field = name.split(".")
        parts[part][field] = float(estimate.value)
    intervals = {name: (estimate.low, estimate.high) for name, estimate in found.items() if np.isfinite(estimate.low)}
    record = SensingRecord(**parts, intervals=intervals, provenance=provenance(seed, files))
    return SensingResult(record, found, alignment, track, counts, tuple(findings), tuple(faults))
