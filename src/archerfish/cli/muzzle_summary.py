"""What `archerfish identify muzzle` says about a muzzle: as facts for --json, and as a table for a person."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.cli.interval_words import ends, with_digits
from archerfish.cli.muzzle_verdict import LABELS, MuzzleVerdict
from archerfish.cli.summary_end import print_end
from archerfish.identification.muzzle.likelihood import MuzzleIdentification
from archerfish.records.shots import Shots, vertical_measurement

Summary = dict[str, Any]


def muzzle_summary(
    shots: Shots, result: MuzzleIdentification, verdict: MuzzleVerdict, files: Sequence[Path]
) -> Summary:
    """Return the facts of an identified muzzle that --json writes.

    Args:
      shots: what it was identified from.
      result: the identification.
      verdict: what follows.
      files: what was written.
    """
    muzzle, fit = result.muzzle, result.lack_of_fit
    names = ("speed", "speed_sd", "pitch_offset", "pitch_sd", "yaw_offset", "yaw_sd", "height", "drag", "length")
    return {
        "headline": verdict.headline,
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
        "next_steps": list(verdict.next_steps),
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


def print_muzzle(console: Console, summary: Summary) -> None:
    """Print the verdict in a line, the table of numbers, whether the flight model fits, and what to do."""
    console.print(summary["headline"], style="bold", markup=False, highlight=False)
    table = Table("parameter", "estimate", "95 % interval")
    for name, (label, unit, scale) in LABELS.items():
        interval = summary["intervals_95"].get(name)
        if interval is None and summary["parameters"][name] == 0.0:
            continue
        shown = f"{with_digits(summary['parameters'][name], interval, scale)} {unit}"
        table.add_row(label, shown, "given" if interval is None else ends(interval, scale))
    console.print(table)
    remarks = [summary["lack_of_fit"]["statement"], *summary["remarks"], *summary["next_steps"]]
    print_end(console, remarks, summary["files"])
