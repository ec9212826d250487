"""An identified sensing and its report: whether it is usable, what is known, what is in doubt, what to record next."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from archerfish2.identification.sensing.alignment import Alignment
from archerfish2.identification.sensing.track import GimbalTrack
from archerfish2.records.sensing import SensingRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import new_figure, plot_style
from archerfish2.reports.table import Entry, Estimate, Table, entry_texts, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


@dataclass(frozen=True, eq=False)
class SensingResult:
    """An identified sensing and how it came about; times of arrays count from the gimbal log's first stamp."""

    sensing: SensingRecord
    estimates: dict[str, Estimate]  # by the record's names, such as "camera.latency", in SI units
    alignment: Alignment
    track: GimbalTrack
    counts: dict[str, tuple[int, int]]  # of detections and steps: used, logged

    def __repr__(self) -> str:
        return str(self.report)

    def save(self, folder: str | Path) -> None:
        """Write sensing.json and sensing.html.

        Raises:
          InputError: if they can't be written.
        """
        self.sensing.save(Path(folder) / "sensing.json")
        self.report.write_page(Path(folder) / "sensing.html")

    def plot(self) -> "Figure":
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

    @property
    def report(self) -> Report:
        """Verdict, what is known, what is in doubt, and what to record next."""
        camera, link, shown = self.sensing.camera, self.sensing.link, dict[str, Entry]()
        for name, (value, low, high, unit) in self.estimates.items():
            unit, factor = _SHOWN[unit]
            estimate = Estimate(factor * value, factor * low, factor * high, unit)
            shown[name] = value if unit == "Hz" else estimate  # the interval of a rate is some parts in a million
        words = {name: "{} ({})".format(*entry_texts(each)) for name, each in shown.items()}
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
        other, missed = camera.outlier_share, camera.miss_probability
        spoiling = {
            f"Detections scatter by {across:.0f} mm: show one plate at rest, with positions in metres.": across > 50,
            f"The feedback's delay is below zero ({early:.1f} ms): stamp all logs by one clock.": early < -3,
        }
        doubtful = {
            "The latency is unknown, and taken as 0: log receive_s by the gimbal log's clock.": camera.latency is None,
            f"The gimbal's motion explains {moving:.0%} of the bearing's residual, which intervals do not include: "
            f"calibrate the lens, hold plate and robot still, avoid clock drift ({drift:.0f} ppm).": moving > 0.02,
            f"Intervals of stamps scatter by {uneven:.0%}, so misses are miscounted: stamp exposures.": uneven > 0.15,
            f"{other:.0%} of the detections are not the plate: cover what looks like one.": other > 0.1,
            f"The plate was missed in {missed:.0%} of the frames: bring it nearer, or light it better.": missed > 0.3,
        }
        reasons, doubts = _those(spoiling), _those(doubtful)
        missing = {
            "Mend what is wrong or in doubt, and sweep again (archerfish2 excite yaw --kinds sweep).": reasons + doubts,
            "For the latency from exposure, record 20 jumps of a target by 0.3 m, a second apart, and when it jumps: "
            "--target timing_target.csv --target-steps timing_moments.csv": camera.latency_basis != "exposure",
            "For the delay of commands, record 20 steps of the yaw by 5 to 10°, held for half a second: --steps "
            "timing_steps.csv": link.command_delay is None,
            "For the latency of commands, log when the gimbal receives them, if it stamps: --commands "
            "timing_commands.csv": link.command_latency is None,
        }
        again = "Then give the same command with these options; archerfish2 identify LOGS finds files of these names."
        done = "Nothing more to record: archerfish2 train FOLDER takes sensing.json with pitch.json and yaw.json there."
        rows = tuple((label, *(shown.get(name) if name else "" for name in names)) for label, *names in _ROWS)
        care = "with care, see what is in doubt; " if doubts and not reasons else ""
        return Report(
            "Camera and link: what the logs say",
            f"{care}camera {camera.rate_hz:.4g} Hz, latency {latency}, noise {place}; command to motion {delay}",
            usable=not reasons,
            reasons=reasons,
            known=_those(known),
            doubts=doubts,
            next_steps=(*_those(missing), again if any(missing.values()) else done),
            tables=(Table("Camera and link", ("quantity", "mean (95 % interval)", "standard deviation"), rows),),
            figures=(("Yaw by gimbal (line) and camera (dots), which should lie on the line.", self.plot),),
            provenance=dict(self.sensing.provenance),
        )


def _those(sentences: Mapping[str, object]) -> tuple[str, ...]:
    return tuple(sentence for sentence, holds in sentences.items() if holds)
