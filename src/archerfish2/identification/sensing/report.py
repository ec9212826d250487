"""The report of an identified sensing: what is known of camera and link, what is in doubt, what to record next."""

from typing import TYPE_CHECKING

import numpy as np

from archerfish2.reports.report import Report
from archerfish2.reports.table import Estimate, Table, entry_texts

if TYPE_CHECKING:
    from archerfish2.identification.sensing.identify import SensingResult

_SHOWN = {"s": ("ms", 1e3), "rad": ("mrad", 1e3), "m": ("mm", 1e3), "Hz": ("Hz", 1.0), "": ("%", 100.0)}
"""Unit and factor in which estimates are shown."""
_LOOSE_S = 4e-3
"""Width of a time's interval beyond which recording more pays: a target at 3 m/s moves 12 mm in it [s]."""


def sensing_report(result: "SensingResult") -> Report:
    """Report what is known of camera and link, what is in doubt, and what to record next."""
    camera, link, alignment, frames = result.sensing.camera, result.sensing.link, result.alignment, result.frames
    shown = dict[str, Estimate]()
    for name, (value, low, high, unit) in result.estimates.items():
        unit, factor = _SHOWN[unit]
        shown[name] = Estimate(factor * value, factor * low, factor * high, unit)
    text = {name: "{} ({})".format(*entry_texts(each)) for name, each in shown.items()}
    loose = {name for name, each in result.estimates.items() if each.unit == "s" and each[2] - each[1] > _LOOSE_S}
    latency, delay = (text.get(name, "not known") for name in ("camera.latency", "link.command_delay"))
    offset, since = text["camera.time_offset"], "" if camera.latency_basis == "exposure" else " and feedback"
    across = 1e3 * camera.noise_range * max(camera.bearing_sd, camera.elevation_sd)
    uneven, drift = frames.jitter / frames.period.value, 1e6 * alignment.drift
    pitch = np.ptp(result.track.angles(alignment.moments)[:, 1])
    other, missed = camera.outlier_share, camera.miss_probability
    known = {
        f"Add {offset} to a frame's stamp to get the moment of its exposure by the gimbal log's clock.": True,
        f"A detection arrives {latency} after its exposure{since}.": camera.latency is not None,
        f"Noise was measured at {camera.noise_range:.1f} m; how it grows takes another distance.": True,
        "The log repeats each yaw until it is refreshed; times are those of the refreshed values.": result.track.held,
        f"From command to motion {delay}: the sum of command and feedback delay.": link.command_delay is not None,
        "A plant that was identified from such a log has that delay already.": link.command_delay is not None,
        f"The plate was out of view {frames.out_of_view} times, which are not counted.": frames.out_of_view > 0,
    }
    known |= {f"{used} of {logged} {name} used.": used < logged for name, (used, logged) in result.counts.items()}
    moving, threshold = alignment.motion_share, 0.02 if alignment.motion_p < 0.01 else np.inf
    doubts = {
        f"The gimbal's motion explains {moving:.0%} of the bearing's residual, which intervals do not include: a lens "
        f"out of calibration, something that moved, clocks that drift ({drift:.0f} ppm).": moving > threshold,
        f"Intervals of stamps scatter by {uneven:.0%}, so misses are miscounted: stamp exposures.": uneven > 0.15,
        f"{other:.0%} of the detections are not the plate: cover what looks like one.": other > 0.1,
        f"Detections scatter by {across:.0f} mm across the line of sight: was it one plate, at rest?": across > 50,
        f"The plate was missed in {missed:.0%} of the frames: bring it nearer, or light it better.": missed > 0.3,
        "The pitch moved by more than 3° during the sweep: hold it still.": pitch > np.radians(3),
        "The feedback's delay is below zero: stamp all by one clock.": (link.feedback_delay or 0.0) < -0.003,
    }
    more = dict.fromkeys(result.missing, True) | {
        f"The {name.replace('_', ' ')} is {text[name]}: sweep faster and longer, record more steps.": name in loose
        for name in text.keys() & {"camera.time_offset", "camera.latency", "link.command_delay"}
    }
    rows = tuple((name.replace(".", " ").replace("_", " ").removesuffix(" hz"), shown[name]) for name in sorted(shown))
    return Report(
        "Sensing",
        f"camera {text['camera.rate_hz']}, latency {latency}, time offset {offset}, noise {across:.2g} mm across at "
        f"{camera.noise_range:.2g} m; command to motion {delay}",
        known=_those(known),
        doubts=_those(doubts),
        next_steps=_those(more),
        tables=(Table("Camera and link", ("quantity", "estimate"), rows, "sd, jitter: standard deviation"),),
        figures=(("Alignment of camera and gimbal", result.plot),),
        provenance=dict(result.sensing.provenance),
    )


def _those(sentences: dict[str, bool]) -> tuple[str, ...]:
    return tuple(sentence for sentence, holds in sentences.items() if holds)
