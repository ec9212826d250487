"""What `archerfish identify sensing` says about camera and link: as facts for --json, and as a table for a person."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.cli.summary_end import print_end
from archerfish.identification.sensing.estimate import SensingIdentification

Summary = dict[str, Any]


def sensing_summary(result: SensingIdentification, files: Sequence[Path]) -> Summary:
    """Return the facts of an identified sensing that --json writes; `files` is what was written."""
    alignment, frames = result.alignment, result.frames
    return {
        "camera": asdict(result.sensing.camera),
        "link": asdict(result.sensing.link),
        "intervals_95": {name: list(ends) for name, ends in result.sensing.intervals.items()},
        "frames": {"seen": frames.seen, "missed": frames.missed, "out_of_view": frames.out_of_view},
        "outliers": int(np.sum(~alignment.inlier)),
        "clock_drift_ppm": 1e6 * alignment.drift,
        "command_steps": result.command_steps,
        "target_steps": result.target_steps,
        "missing": list(result.missing),
        "remarks": list(result.remarks),
        "files": [str(path) for path in files],
    }


_ROWS = {
    "camera.rate_hz": ("camera rate", "Hz", 1.0),
    "camera.time_offset": ("time offset to gimbal", "ms", 1e3),
    "camera.stamp_jitter": ("jitter of the stamps", "ms", 1e3),
    "camera.latency": ("camera latency", "ms", 1e3),
    "camera.latency_jitter": ("its jitter", "ms", 1e3),
    "camera.bearing_sd": ("noise across, azimuth", "mrad", 1e3),
    "camera.elevation_sd": ("noise across, elevation", "mrad", 1e3),
    "camera.range_sd": ("noise along", "mm", 1e3),
    "camera.miss_probability": ("missed frames", "%", 100.0),
    "camera.outlier_share": ("not the plate", "%", 100.0),
    "link.command_delay": ("command to motion, both ways", "ms", 1e3),
    "link.command_jitter": ("its jitter", "ms", 1e3),
    "link.feedback_delay": ("of it, feedback", "ms", 1e3),
    "link.feedback_rate_hz": ("feedback rate", "Hz", 1.0),
    "link.feedback_quantum": ("step of the feedback", "mrad", 1e3),
}
_ACROSS = ("camera.bearing_sd", "camera.elevation_sd")


def print_sensing(console: Console, summary: Summary) -> None:
    """Print the summary of a sensing as a table, then what is missing and the remarks."""
    table = Table("quantity", "estimate", "95 % interval", title="sensing", title_justify="left")
    for name, (label, unit, scale) in _ROWS.items():
        part, _, field = name.partition(".")
        value, interval = summary[part][field], summary["intervals_95"].get(name)
        if name == "camera.latency" and summary["camera"]["latency_basis"] == "feedback":
            label += " less feedback delay"
        shown = "not known" if value is None else f"{_number(scale * value, interval, scale)} {unit}"
        if name in _ACROSS:
            distance = summary["camera"]["noise_range"]
            shown += f" ({1e3 * value * distance:.3g} mm at {distance:.3g} m)"
        table.add_row(label, shown, "" if interval is None else _ends(interval, scale))
    console.print(table)
    print_end(console, [*summary["missing"], *summary["remarks"]], summary["files"])


def _ends(interval: list[float], scale: float) -> str:
    return " … ".join(_number(scale * end, interval, scale) for end in interval)


def _number(value: float, interval: list[float] | None, scale: float) -> str:
    """Format a value with as many digits as tell the ends of its interval apart."""
    if interval is None:
        return f"{value:.4g}"
    width = max(scale * (interval[1] - interval[0]), 1e-9)
    return f"{value:.{max(0, 1 - int(np.floor(np.log10(width))))}f}"
