"""What `archerfish excite` says of its commands and of what their logs will tell: facts for --json, and tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.cli.summary_end import print_end
from archerfish.identification.excitation.experiment_design import Expected, ExperimentPrediction
from archerfish.identification.excitation.plan import PlannedLog
from archerfish.records.limits import AxisLimits

Summary = dict[str, Any]

_LOWEST_NEEDED_HZ = 0.5
"""Above it the steady gain is read off the model, not off the log."""


def excite_summary(
    axis: str,
    logs: Sequence[PlannedLog],
    prediction: ExperimentPrediction,
    limits: AxisLimits,
    *,
    assumed: str,
    noise_sd: float,
    sample_period_s: float,
    band_hz: tuple[float, float],
    files: Sequence[Path],
) -> Summary:
    """Return the facts of a plan that --json writes.

    Args:
      axis: name of the axis.
      logs: the planned commands.
      prediction: what those that are fitted will tell.
      limits: of the axis.
      assumed: what the prediction takes the axis to be, in words.
      noise_sd: assumed noise of the measured angle [rad].
      sample_period_s: sampling period of the commands [s].
      band_hz: frequencies that are to be known [Hz].
      files: what was written.
    """
    return {
        "axis": axis,
        "sample_period_s": sample_period_s,
        "band_hz": list(band_hz),
        "limits": {"max_rate": limits.max_rate, "max_acceleration": limits.max_acceleration},
        "commands": [_command(log, sample_period_s) for log in logs],
        "assumed": {"plant": assumed, "noise_sd": noise_sd},
        "expected": {
            "dc_gain": _expected(prediction.dc_gain),
            "modes": [
                {
                    "frequency_hz": _expected(mode.frequency),
                    "damping": _expected(mode.damping),
                    "identifiable": mode.identifiable,
                }
                for mode in prediction.modes
            ],
            "gains": {each.name: _expected(each) for each in prediction.gains},
            "delay_s": _expected(prediction.delay),
            "known_band_hz": list(prediction.known_band_hz),
            "bode": {name: array.tolist() for name, array in prediction.bode._asdict().items()},
        },
        "remarks": [*_blind(logs, prediction, band_hz), *_jumps(logs)],
        "files": [str(path) for path in files],
    }


def _command(log: PlannedLog, sample_period_s: float) -> Summary:
    return {
        "kind": log.name,
        "samples": len(log.command),
        "duration_s": len(log.command) * sample_period_s,
        "held_back": log.held_back,
        "jumps": log.jumps,
        "low": log.demand.low,
        "high": log.demand.high,
        "rate": log.demand.rate,
        "acceleration": log.demand.acceleration,
    }


def _expected(each: Expected) -> Summary:
    return {"value": each.value, "half_width_95": each.half_width}


def _blind(logs: Sequence[PlannedLog], prediction: ExperimentPrediction, band_hz: tuple[float, float]) -> list[str]:
    """Say what these logs won't tell, and what to add."""
    low, high = prediction.known_band_hz
    remarks = []
    if low > _LOWEST_NEEDED_HZ and not any(log.name == "step" for log in logs):
        remarks.append(f"Nothing will be known below {low:.2g} Hz but what the model extrapolates: add a step.")
    if high == 0:
        remarks.append("Noise hides the motion at every frequency: a larger amplitude or a better encoder is needed.")
    elif high < 0.9 * band_hz[1]:
        remarks.append(
            f"Above {high:.2g} Hz noise hides the motion (coherence below a half): within these limits only a longer "
            "log or a better encoder shows more."
        )
    for mode in prediction.modes:
        if not mode.identifiable:
            remarks.append(
                f"The mode at {mode.frequency.value:.3g} Hz will not be identifiable: no log shows it well enough."
            )
    return remarks


def _jumps(logs: Sequence[PlannedLog]) -> list[str]:
    if not any(log.jumps for log in logs):
        return []
    remark = (
        "Steps jump, whatever the limits of rate and acceleration are: the motor saturates for their first "
        "milliseconds. --slew-steps keeps them within the limits."
    )
    return [remark]


def print_excite(console: Console, summary: Summary) -> None:
    """Print the commands, what is expected of their logs, and what to do about it."""
    console.print(_command_table(summary))
    console.print(_expected_table(summary))
    print_end(console, summary["remarks"], summary["files"])


def _command_table(summary: Summary) -> Table:
    title = f"{summary['axis']}: commands (largest rate and acceleration of the samples)"
    table = Table("command", "length", "angle", "rate", "acceleration", title=title, title_justify="left")
    for row in summary["commands"]:
        low, high = np.degrees([row["low"], row["high"]])
        asked = ("jump", "jump") if row["jumps"] else (f"{row['rate']:.3g} rad/s", f"{row['acceleration']:.3g} rad/s²")
        name = row["kind"] + (" (held back)" if row["held_back"] else "")
        table.add_row(name, f"{row['duration_s']:.4g} s", f"{low:.3g}…{high:.3g}°", *asked)
    limits = summary["limits"]
    table.add_row("limit", "", "", f"{limits['max_rate']:.3g} rad/s", f"{limits['max_acceleration']:.3g} rad/s²")
    return table


def _expected_table(summary: Summary) -> Table:
    assumed, expected = summary["assumed"], summary["expected"]
    noise = f"noise {np.degrees(assumed['noise_sd']):.2g}°"
    table = Table("expected", "value", "± 95 %", title=f"if it is {assumed['plant']}, {noise}", title_justify="left")
    table.add_row("DC gain", *_cells(expected["dc_gain"]))
    for mode in expected["modes"]:
        known = mode["identifiable"]
        table.add_row("mode, Hz", *_cells(mode["frequency_hz"], known=known))
        if mode["damping"]["value"] < 1:
            table.add_row("  its damping", *_cells(mode["damping"], known=known))
    for name, each in expected["gains"].items():
        table.add_row(name, *_cells(each))
    table.add_row("delay, ms", *_cells(expected["delay_s"], scale=1e3))
    return table


def _cells(each: Summary, *, scale: float = 1.0, known: bool = True) -> tuple[str, str]:
    half_width = each["half_width_95"]
    hopeless = not known or (each["value"] != 0 and half_width > abs(each["value"]) and scale == 1.0)
    return f"{scale * each['value']:.4g}", "unknown" if hopeless else f"{scale * half_width:.2g}"
