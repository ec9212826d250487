"""What `archerfish identify muzzle` says about a muzzle: as facts for --json, and as a table for a person."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.cli.summary_end import print_end
from archerfish.identification.muzzle.likelihood import MuzzleIdentification
from archerfish.records.shots import Shots, vertical_measurement

Summary = dict[str, Any]


def muzzle_summary(shots: Shots, result: MuzzleIdentification, files: Sequence[Path]) -> Summary:
    """Return the facts of an identified muzzle that --json writes; `files` is what was written."""
    muzzle, fit = result.muzzle, result.lack_of_fit
    names = ("speed", "speed_sd", "pitch_offset", "pitch_sd", "yaw_offset", "yaw_sd", "height", "drag")
    return {
        "parameters": {name: getattr(muzzle, name) for name in names},
        "estimated": list(result.estimated),
        "intervals_95": {name: list(ends) for name, ends in muzzle.intervals.items()},
        "lack_of_fit": {
            "rms_percent": fit.rms_percent,
            "worst_percent": fit.worst_percent,
            "worst_setting": fit.worst_setting,
            "replicate_percent": fit.replicate_percent,
            "p_value": fit.p_value,
            "statement": fit.statement,
        },
        "shots": _shots(shots, result),
        "findings": [{"code": finding.code, "message": finding.text} for finding in result.findings],
        "remarks": list(result.remarks),
        "files": [str(path) for path in files],
    }


def _shots(shots: Shots, result: MuzzleIdentification) -> list[dict[str, Any]]:
    """Facts of each shot; `measured_m` is the landing distance, or the height of the hit on a plane."""
    return [
        {
            "place": shots.place(index),
            "pitch_deg": float(np.degrees(shots.pitch[index])),
            "yaw_deg": float(np.degrees(shots.yaw[index])),
            "distance_m": float(shots.distance[index]),
            "measured_m": float(measured),
            "model_m": float(result.expected[index]),
            "model_sd_m": float(result.expected_sd[index]),
            "used": bool(result.kept[index]),
        }
        for index, measured in enumerate(vertical_measurement(shots))
    ]


_UNITS = {
    "speed": ("muzzle speed", "m/s", 1.0),
    "speed_sd": ("its standard deviation", "m/s", 1.0),
    "pitch_offset": ("pitch offset", "°", 180 / np.pi),
    "pitch_sd": ("its standard deviation", "°", 180 / np.pi),
    "yaw_offset": ("yaw offset", "°", 180 / np.pi),
    "yaw_sd": ("its standard deviation", "°", 180 / np.pi),
    "height": ("muzzle height", "m", 1.0),
    "drag": ("drag", "1/m", 1.0),
}


def print_muzzle(console: Console, summary: Summary) -> None:
    """Print the summary of a muzzle as a table, and whether the flight model fits."""
    table = Table("parameter", "estimate", "95 % interval", title="muzzle", title_justify="left")
    for name, (label, unit, scale) in _UNITS.items():
        interval = summary["intervals_95"].get(name)
        if interval is None and summary["parameters"][name] == 0.0:
            continue
        ends = "given" if interval is None else f"{scale * interval[0]:.4g} … {scale * interval[1]:.4g}"
        table.add_row(label, f"{scale * summary['parameters'][name]:.4g} {unit}", ends)
    console.print(table)
    print_end(console, [summary["lack_of_fit"]["statement"], *summary["remarks"]], summary["files"])
