"""What `archerfish identify rigid` says about an axis: as facts for --json, and as a table for a person."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.cli.sample_count import SampleCount, sample_facts, used_sentence
from archerfish.cli.summary_end import print_end
from archerfish.identification.rigid.fit import RigidIdentification
from archerfish.records.findings import Finding
from archerfish.records.recording import Recording

Summary = dict[str, Any]

_LABELS = {
    "inertia": "inertia m l²",
    "damping": "damping b",
    "gravity_moment": "gravity m g l",
    "gravity_phase": "hangs down at",
    "torque_offset": "torque offset",
    "friction": "Coulomb friction",
}


def rigid_summary(
    result: RigidIdentification,
    recordings: Sequence[Recording],
    findings: Sequence[Finding],
    samples: SampleCount,
    files: Sequence[Path],
) -> Summary:
    """Return the facts of a rigid axis that --json writes.

    Args:
      result: the axis.
      recordings: what was fitted.
      findings: what was repaired in the logs.
      samples: that the logs hold, and that were left out.
      files: what was written.
    """
    record = result.record
    return {
        "axis": record.axis,
        "axis_kind": record.axis_kind,
        "parameters": {name: getattr(record, name) for name in record.intervals},
        "intervals_95": {name: list(ends) for name, ends in record.intervals.items()},
        "units": {name: record.units[name] for name in record.intervals},
        "residual_sd": list(result.residual_sd),
        "fits": [
            {"file": recording.source, "fit_percent": fit}
            for recording, fit in zip(recordings, result.fit_percent, strict=True)
        ],
        "samples": sample_facts(samples),
        "remarks": [
            used_sentence(samples),
            *(f"{each.place}: {each.message} ({each.code}); {each.remedy}." for each in findings),
            *result.remarks,
        ],
        "files": [str(path) for path in files],
    }


def _digits(value: float, half_width: float) -> int:
    """Return how many digits show the interval's half-width to two of them."""
    ratio = abs(value) / max(half_width, 1e-300)
    return int(np.clip(np.ceil(np.log10(max(ratio, 1.0))) + 2, 3, 9))


def print_rigid(console: Console, summary: Summary) -> None:
    """Print the summary of a rigid axis as a table, and what to do about it."""
    title = f"{summary['axis']}: rigid {summary['axis_kind']} axis"
    table = Table("parameter", "estimate", "95 % interval", title=title, title_justify="left")
    for name, value in summary["parameters"].items():
        angle = summary["units"][name] == "rad"
        scale, unit = (180 / np.pi, "°") if angle else (1.0, summary["units"][name])
        low, high = (scale * end for end in summary["intervals_95"][name])
        digits = _digits(scale * value, 0.5 * (high - low))
        table.add_row(_LABELS[name], f"{scale * value:.{digits}g} {unit}", f"{low:.{digits}g} … {high:.{digits}g}")
    for row in summary["fits"]:
        table.add_row("fit", f"{row['fit_percent']:.2f} %", row["file"])
    console.print(table)
    print_end(console, summary["remarks"], summary["files"])
