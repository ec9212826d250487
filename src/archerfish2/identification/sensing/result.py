"""An identified sensing and its report: what is known of camera and link, what is in doubt, what to record next."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from archerfish2.identification.sensing.alignment import Alignment
from archerfish2.identification.sensing.track import GimbalTrack
from archerfish2.records.sensing import SensingRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import new_figure, plot_style
from archerfish2.reports.table import Estimate, Table, entry_texts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = {"s": ("ms", 1e3), "rad": ("mrad", 1e3), "m": ("mm", 1e3), "Hz": ("Hz", 1.0), "": ("%", 100.0)}
"""Unit and factor in which estimates are shown."""


@dataclass(frozen=True, eq=False)
class SensingResult:
    """An identified sensing and how it came about; times of arrays count from the gimbal log's first stamp."""

    sensing: SensingRecord
    estimates: dict[str, Estimate]  # by the record's names, such as "camera.latency", in SI units
    alignment: Alignment
    track: GimbalTrack
    counts: dict[str, tuple[int, int]]  # of detections and steps: used, logged

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
        time, yaw = moments[near], self.track.angles(moments[near])[:, 0]
        with plot_style():
            figure, ((axes,),) = new_figure()
            axes.plot(time, np.degrees(yaw), time, np.degrees(yaw - residual[near, 0]), ".")
            axes.set(title="Gimbal (line) and camera (dots)", xlabel="Time in the gimbal log [s]", ylabel="Yaw [°]")
        return figure

    @property
    def report(self) -> Report:
        """What is known, what is in doubt, and what to record next."""
        camera, link, alignment, shown = self.sensing.camera, self.sensing.link, self.alignment, dict[str, Estimate]()
        for name, (value, low, high, unit) in sorted(self.estimates.items()):
            unit, factor = _SHOWN[unit]
            shown[name] = Estimate(factor * value, factor * low, factor * high, unit)
        text = {name: "{} ({})".format(*entry_texts(each)) for name, each in shown.items()}
        rate, offset = text["camera.rate_hz"], text["camera.time_offset"]
        latency, delay = (text.get(name, "not known") for name in ("camera.latency", "link.command_delay"))
        rows = tuple((name.replace(".", " ").replace("_", " ").removesuffix(" hz"), shown[name]) for name in shown)
        known = {f"Add {offset} to a frame's stamp to get its time of exposure on the gimbal log's clock.": True}
        known |= {f"{used} of {logged} {name} used.": used < logged for name, (used, logged) in self.counts.items()}
        across = 1e3 * camera.noise_range * max(camera.bearing_sd, camera.elevation_sd)
        moving, drift = alignment.motion_share, 1e6 * alignment.drift
        other, missed = camera.outlier_share, camera.miss_probability
        uneven = 2**0.5 * camera.stamp_jitter * camera.rate_hz
        doubts = {
            f"The gimbal's motion explains {moving:.0%} of the bearing's residual, which intervals do not include: a "
            f"lens out of calibration, something that moved, clocks that drift ({drift:.0f} ppm).": moving > 0.02,
            f"Intervals of stamps scatter by {uneven:.0%}, so misses are miscounted: stamp exposures.": uneven > 0.15,
            f"{other:.0%} of the detections are not the plate: cover what looks like one.": other > 0.1,
            f"Detections scatter by {across:.0f} mm across the line of sight: was it one plate, at rest?": across > 50,
            f"The plate was missed in {missed:.0%} of the frames: bring it nearer, or light it better.": missed > 0.3,
            "The feedback's delay is below zero: stamp all by one clock.": (link.feedback_delay or 0.0) < -0.003,
        }
        remedy = "record a target that steps at known moments."
        missing = {
            f"The latency is not known: log receive_s by the gimbal log's clock, or {remedy}": camera.latency is None,
            f"The latency is too short by the feedback's delay: {remedy}": camera.latency_basis == "feedback",
            "The command delay is not known: log 20 steps of the command of 5 to 10°.": link.command_delay is None,
            "The command latency is not known: log sent_s and received_s of commands.": link.command_latency is None,
        }
        note = "sd, jitter: standard deviation; share, probability: in %"
        return Report(
            "Sensing",
            f"camera {rate}, latency {latency}, time offset {offset}, noise {across:.2g} mm across at "
            f"{camera.noise_range:.2g} m; command to motion {delay}, with the feedback's delay",
            known=_those(known),
            doubts=_those(doubts),
            next_steps=_those(missing),
            tables=(Table("Camera and link", ("quantity", "estimate"), rows, note),),
            figures=(("Alignment of camera and gimbal", self.plot),),
            provenance=dict(self.sensing.provenance),
        )


def _those(sentences: dict[str, bool]) -> tuple[str, ...]:
    return tuple(sentence for sentence, holds in sentences.items() if holds)
