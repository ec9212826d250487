"""What `archerfish identify gimbal` says about an axis: as facts for --json, and as a table for a person."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.cli.summary_end import print_end
from archerfish.identification.frequency import natural_frequency_hz
from archerfish.identification.gimbal import AxisIdentification
from archerfish.records.plant import dc_gain

Summary = dict[str, Any]

_USABLE_FIT_PERCENT = 80.0
"""Below it more than a fifth of the motion is unexplained; clean logs of a gimbal give 95 % and more."""

_DEGREES = 180 / np.pi
"""Degrees in a radian: the steady gain of an axis whose angle is logged in degrees and its command in radians."""

_UNIT_TOLERANCE = 1.1
"""Factor by which a gain may miss that of mixed units and still be taken for it."""


def axis_summary(
    result: AxisIdentification, logs: Sequence[Path], validation: Sequence[tuple[str, float]], files: Sequence[Path]
) -> Summary:
    """Return the facts of an identified axis that --json writes.

    Args:
      result: the axis.
      logs: the fitted logs.
      validation: log and fit [%] of each log that was held back.
      files: what was written.
    """
    plant = result.plant
    return {
        "axis": plant.axis,
        "order": len(plant.A),
        "sample_period_s": plant.sample_period_s,
        "delay_samples": plant.delay_samples,
        "delay_s": plant.delay_samples * plant.sample_period_s,
        "feedthrough": plant.D[0].tolist(),
        "dc_gain": dc_gain(plant)[0].tolist(),
        "offset": result.offset,
        "residual_sd": result.residual_sd,
        "excited_band_hz": list(result.excited_band_hz),
        "poles": [_pole(pole, plant.sample_period_s) for pole in result.poles],
        "training": _fits(zip(map(str, logs), result.fit_percent, strict=True)),
        "validation": _fits(validation),
        "remarks": [*result.remarks, *_doubts(result, validation)],
        "files": [str(path) for path in files],
    }


def _doubts(result: AxisIdentification, validation: Sequence[tuple[str, float]]) -> list[str]:
    """Say what about the plant itself suggests that it is of no use, and what to check."""
    plant = result.plant
    gains = zip(plant.input_names, np.abs(dc_gain(plant)[0]).tolist(), strict=True)
    return [
        *_poor_fit(result, validation),
        *_delay_at_limit(plant.delay_samples, max(result.delay_scan)),
        *(remark for name, gain in gains for remark in _angle_units(name, gain)),
    ]


def _poor_fit(result: AxisIdentification, validation: Sequence[tuple[str, float]]) -> list[str]:
    kind = "validation" if validation else "training"
    worst = min((fit for _, fit in validation), default=min(result.fit_percent))
    if worst >= _USABLE_FIT_PERCENT:
        return []
    remark = (
        f"The plant is not to be trusted: the {kind} fit of {worst:.1f} % is below {_USABLE_FIT_PERCENT:g} %, so it "
        f"misses {100 - worst:.0f} % of the motion. Check that --input and --output are not swapped, that the time "
        "column is in seconds (not milliseconds), that all logs use the same unit and zero, and that the input moves "
        "the axis well above its noise and backlash; else record a longer or richer sweep."
    )
    return [remark]


def _delay_at_limit(delay: int, longest: int) -> list[str]:
    if delay < longest:
        return []
    remark = (
        f"The delay found, {delay} samples, is the longest that was tried: the true one may be longer; raise "
        "--max-delay (a tenth of the shortest log is tried at most)."
    )
    return [remark]


def _angle_units(name: str, gain: float) -> list[str]:
    for factor, output, command in ((_DEGREES, "degrees", "radians"), (1 / _DEGREES, "radians", "degrees")):
        if factor / _UNIT_TOLERANCE <= gain <= factor * _UNIT_TOLERANCE:
            remark = (
                f"The steady gain from {name}, {gain:.3g}, is about {factor:.3g}: the output seems to be in {output} "
                f"and the input in {command}; log both in radians."
            )
            return [remark]
    return []


def _fits(rows: Iterable[tuple[str, float]]) -> list[Summary]:
    return [{"file": file, "fit_percent": fit} for file, fit in rows]


def _pole(pole: complex, sample_period_s: float) -> Summary:
    """Describe a pole by its equivalent in continuous time; a pole at 0 is a delay and has none."""
    frequency = natural_frequency_hz(pole, sample_period_s)
    return {
        "real": pole.real,
        "imag": pole.imag,
        "modulus": abs(pole),
        "frequency_hz": frequency if pole != 0 else None,
        "damping": -float(np.log(abs(pole))) / (2 * np.pi * frequency * sample_period_s) if pole != 0 else None,
    }


def print_axis(console: Console, summary: Summary) -> None:
    """Print the summary of an axis as a table, and what to do about it."""
    table = Table(title=f"{summary['axis']}: order {summary['order']}", title_justify="left", show_header=False)
    delay = f"{summary['delay_samples']} samples ({1e3 * summary['delay_s']:.3g} ms)"
    table.add_row("input delay", delay)
    table.add_row("steady gain", ", ".join(f"{gain:.4g}" for gain in summary["dc_gain"]))
    for pole in summary["poles"]:
        if pole["imag"] >= 0:
            place = f"{pole['real']:.4f}" + (f" ± {pole['imag']:.4f}i" if pole["imag"] else "")
            frequency = "" if pole["frequency_hz"] is None else f", {pole['frequency_hz']:.3g} Hz"
            damping = f", damping {pole['damping']:.2f}" if pole["imag"] else ""
            table.add_row("pole", f"{place}{frequency}{damping}")
    for kind in ("training", "validation"):
        for row in summary[kind]:
            table.add_row(f"fit, {kind}", f"{row['fit_percent']:.2f} %  {Path(row['file']).name}")
    console.print(table)
    remarks = list(summary["remarks"])
    if not summary["validation"]:
        remarks.append(
            "No log was held back: pass --validate LOG to see how the plant does on one that it has not seen."
        )
    print_end(console, remarks, summary["files"])
