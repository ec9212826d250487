"""What `archerfish identify sensing` says about camera and link: as facts for --json, and as a table for a person."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.cli.interval_words import ends, with_digits
from archerfish.cli.sensing_verdict import LABELS, SensingVerdict, detections_used, left_out
from archerfish.cli.summary_end import print_end
from archerfish.identification.sensing.estimate import SensingIdentification

Summary = dict[str, Any]


def sensing_summary(result: SensingIdentification, verdict: SensingVerdict, files: Sequence[Path]) -> Summary:
    """Return the facts of an identified sensing that --json writes.

    Args:
      result: the identification.
      verdict: what follows.
      files: what was written.
    """
    alignment, frames = result.alignment, result.frames
    used, logged = detections_used(result)
    return {
        "headline": verdict.headline,
        "camera": asdict(result.sensing.camera),
        "link": asdict(result.sensing.link),
        "intervals_95": {name: list(ends) for name, ends in result.sensing.intervals.items()},
        "frames": {"seen": frames.seen, "missed": frames.missed, "out_of_view": frames.out_of_view},
        "detections": {"logged": logged, "used": used, "angle_not_logged": result.outside},
        "outliers": int(np.sum(~alignment.inlier)),
        "left_by_motion": {"share": result.misfit.share, "p_value": result.misfit.p_value},
        "clock_drift_ppm": 1e6 * alignment.drift,
        "command_steps": result.command_steps,
        "command_steps_logged": result.command_steps_logged,
        "target_steps": result.target_steps,
        "target_steps_logged": result.target_steps_logged,
        "missing": list(result.missing),
        "remarks": [*verdict.doubts, *left_out(result), *result.remarks],
        "next_steps": list(verdict.next_steps),
        "files": [str(path) for path in files],
    }


_ACROSS = ("camera.bearing_sd", "camera.elevation_sd")


def print_sensing(console: Console, summary: Summary) -> None:
    """Print the verdict in a line, the table of numbers, the remarks, and what to record next."""
    console.print(summary["headline"], style="bold", markup=False, highlight=False)
    table = Table("quantity", "estimate", "95 % interval")
    for name, (label, unit, scale) in LABELS.items():
        part, _, field = name.partition(".")
        value, interval = summary[part][field], summary["intervals_95"].get(name)
        if name == "camera.latency" and summary["camera"]["latency_basis"] == "feedback":
            label += " less feedback delay"
        shown = "not known" if value is None else f"{with_digits(value, interval, scale)} {unit}"
        if name in _ACROSS:
            distance = summary["camera"]["noise_range"]
            shown += f" ({1e3 * value * distance:.3g} mm at {distance:.3g} m)"
        table.add_row(label, shown, "" if interval is None else ends(interval, scale))
    console.print(table)
    print_end(console, [*summary["remarks"], *summary["next_steps"]], summary["files"])
