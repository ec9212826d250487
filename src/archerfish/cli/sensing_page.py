"""The page of an identified sensing: one self-contained HTML file, the verdict first."""

from typing import Any

import numpy as np

from archerfish.cli.interval_words import ends, with_digits
from archerfish.cli.sensing_verdict import LABELS, SensingVerdict, latency_label
from archerfish.figures.page import render_page
from archerfish.figures.sensing import AlignmentData, alignment_figure
from archerfish.figures.sensing_timing import (
    Noise,
    Overlay,
    Spread,
    noise_figure,
    overlay_figure,
    times_figure,
)
from archerfish.figures.style import svg_text
from archerfish.identification.sensing.estimate import SensingIdentification
from archerfish.records.sensing import SensingRecord, sensing_values

_MEANINGS = {
    "camera.rate_hz": "frames per second",
    "camera.time_offset": "added to a frame's stamp it gives the exposure on the gimbal log's clock",
    "camera.stamp_jitter": "how far single stamps lie beside that, standard deviation",
    "camera.latency": "from exposure to receipt, on average",
    "camera.latency_jitter": "from frame to frame, standard deviation",
    "camera.bearing_sd": "standard deviation to the side",
    "camera.elevation_sd": "standard deviation up and down",
    "camera.range_sd": "standard deviation of the distance",
    "camera.miss_probability": "share of the frames without a detection",
    "camera.outlier_share": "share of the detections that are something else",
    "link.command_delay": "from a logged command to the logged motion, on average: both delays together",
    "link.command_jitter": "from step to step, standard deviation",
    "link.feedback_delay": "how old a logged angle is",
    "link.command_latency": "from sending a command to its receipt by the gimbal, on average",
    "link.command_latency_jitter": "from command to command, standard deviation",
    "link.feedback_latency": "from the gimbal's stamp of a report to its receipt, on average",
    "link.feedback_latency_jitter": "from report to report, standard deviation",
    "link.feedback_rate_hz": "how often the logged angle is refreshed",
    "link.feedback_quantum": "what the logged angle changes by at least",
}


def alignment_data(result: SensingIdentification) -> AlignmentData:
    """Gather the search for the time offset, and what the alignment leaves."""
    alignment, camera = result.alignment, result.sensing.camera
    return AlignmentData(
        offset=result.scan.offset,
        misfit=result.scan.misfit,
        best=alignment.offset,
        moment=alignment.moments,
        bearing=alignment.residual[:, 0],
        distance=alignment.residual[:, 2],
        inlier=alignment.inlier,
        bearing_sd=camera.bearing_sd,
        range_sd=camera.range_sd,
    )


def sensing_page(result: SensingIdentification, record: SensingRecord, verdict: SensingVerdict, name: str) -> str:
    """Return the page of an identified sensing.

    Args:
      result: the identification.
      record: the record, with its provenance.
      verdict: what follows.
      name: of the written files.
    """
    return render_page(
        "sensing.html",
        title=f"{name.capitalize()}: what the recordings say",
        verdict=verdict,
        rows=_rows(result),
        noise_range=record.camera.noise_range,
        used=_used(result),
        misfit=result.misfit,
        remarks=result.remarks,
        record=f"{name}.json",
        provenance=record.provenance,
        **_pictures(result),
    )


def _rows(result: SensingIdentification) -> list[dict[str, str]]:
    values, intervals = sensing_values(result.sensing), result.sensing.intervals
    rows = []
    for name, (label, unit, scale) in LABELS.items():
        value, interval = values.get(name), intervals.get(name)
        shown = "not known" if value is None else f"{with_digits(value, interval, scale)} {unit}"
        rows.append(
            {
                "label": latency_label(result) if name == "camera.latency" else label,
                "value": shown,
                "interval": f"{ends(interval, scale)} {unit}" if interval else "",
                "meaning": _MEANINGS[name],
            }
        )
    return rows


def _used(result: SensingIdentification) -> list[dict[str, str]]:
    """Return what the recordings held, what of it was used, and why the rest was not."""
    frames, inlier = result.frames, result.alignment.inlier
    commands, targets = result.command_steps, result.target_steps
    more_commands, more_targets = result.command_steps_logged - commands, result.target_steps_logged - targets
    return [
        _row("detections used", int(inlier.sum()), ""),
        _row("detections left out", int((~inlier).sum()), "off by more than five standard deviations: not the plate"),
        _row("detections left out", result.outside, "outside the gimbal's log, or in a gap of it"),
        _row("frames without a detection", frames.missed, "count as missed"),
        _row("times out of view", frames.out_of_view, "longer than 0.25 s, so not counted as missed"),
        _row("steps of the command used", commands, "each held still before and after"),
        _row("steps of the command left out", more_commands, "no clear beginning of the motion"),
        _row("steps of the target used", targets, "six times the noise and more"),
        _row("steps of the target left out", more_targets, "not seen in the detections"),
    ]


def _row(what: str, count: int, why: str) -> dict[str, str]:
    return {"what": what, "count": str(count), "why": why}


def _pictures(result: SensingIdentification) -> dict[str, Any]:
    times = _times(result)
    return {
        "overlay": svg_text(overlay_figure(_overlay(result)), prefix="overlay", label="Yaw and detections"),
        "alignment": svg_text(alignment_figure(alignment_data(result)), prefix="align", label="Offset and residuals"),
        "times": svg_text(times_figure(times), prefix="times", label="Histograms of delays") if times else None,
        "noise": svg_text(noise_figure(_noises(result)), prefix="noise", label="Histograms of the noise"),
    }


def _overlay(result: SensingIdentification) -> Overlay:
    alignment, track = result.alignment, result.track
    moments = alignment.moments
    seen = (track.time >= moments.min()) & (track.time <= moments.max())
    # The bearing mirrors the yaw: what it lies beside the model, the yaw would have to be off the other way.
    mirrored = track.angles(moments)[:, 0] - alignment.residual[:, 0]
    return Overlay(track.time[seen], track.yaw[seen], moments, mirrored, alignment.inlier)


def _times(result: SensingIdentification) -> list[Spread]:
    camera, link, intervals = result.sensing.camera, result.sensing.link, result.sensing.intervals
    found = []
    if result.receipt_delay is not None and camera.latency is not None:
        # The stamps are aligned to the feedback; where its delay is known, it belongs to the latency.
        shift = camera.latency - float(result.receipt_delay.mean())
        delays = result.receipt_delay + shift
        title = latency_label(result).capitalize()
        found.append(Spread(delays, camera.latency, intervals.get("camera.latency"), title, "Exposure to receipt [ms]"))
    if result.command_delays and link.command_delay is not None:
        delays = np.array(result.command_delays)
        interval = intervals.get("link.command_delay")
        found.append(Spread(delays, link.command_delay, interval, "Command to motion", "Delay of a step [ms]"))
    return found


def _noises(result: SensingIdentification) -> list[Noise]:
    left = 1e3 * result.alignment.residual[result.alignment.inlier]
    camera = result.sensing.camera
    sds = 1e3 * np.array([camera.bearing_sd, camera.elevation_sd, camera.range_sd])
    titles = ("To the side", "Up and down", "Distance")
    return [
        Noise(values, float(sd), title, f"Residual [{unit}]")
        for values, sd, title, unit in zip(left.T, sds, titles, ("mrad", "mrad", "mm"), strict=True)
    ]
