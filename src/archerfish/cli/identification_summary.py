"""What `archerfish identify` says about a result: as facts for --json, and as a table for a person."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.identification.frequency import natural_frequency_hz
from archerfish.identification.gimbal import AxisIdentification
from archerfish.identification.muzzle_likelihood import MuzzleIdentification
from archerfish.records.plant import dc_gain
from archerfish.records.shots import Shots

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
    _print_end(console, remarks, summary["files"])


def muzzle_summary(shots: Shots, result: MuzzleIdentification, files: Sequence[Path]) -> Summary:
    """Return the facts of an identified muzzle that --json writes; `files` is what was written."""
    muzzle, fit = result.muzzle, result.lack_of_fit
    names = ("speed", "speed_sd", "pitch_offset", "pitch_sd", "yaw_offset", "yaw_sd", "height", "drag")
    return {
        "parameters": {name: getattr(muzzle, name) for name in names},
        "estimated": list(result.estimated),
        "intervals_95": {name: list(ends) for name, ends in muzzle.intervals.items()},
        "log_likelihood": result.log_likelihood,
        "lack_of_fit": {
            "rms_percent": fit.rms_percent,
            "worst_percent": fit.worst_percent,
            "worst_pitch_deg": float(np.degrees(fit.worst_pitch)),
            "replicate_percent": fit.replicate_percent,
            "p_value": fit.p_value,
            "statement": fit.statement,
        },
        "shots": [
            {"pitch_deg": pitch, "yaw_deg": yaw, "distance_m": measured, "model_m": model, "model_sd_m": sd}
            for pitch, yaw, measured, model, sd in zip(
                np.degrees(shots.pitch).tolist(),
                np.degrees(shots.yaw).tolist(),
                shots.distance.tolist(),
                result.distance.tolist(),
                result.distance_sd.tolist(),
                strict=True,
            )
        ],
        "remarks": list(result.remarks),
        "files": [str(path) for path in files],
    }


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
        if interval is None and name.startswith("yaw"):
            continue
        ends = "given" if interval is None else f"{scale * interval[0]:.4g} … {scale * interval[1]:.4g}"
        table.add_row(label, f"{scale * summary['parameters'][name]:.4g} {unit}", ends)
    console.print(table)
    _print_end(console, [summary["lack_of_fit"]["statement"], *summary["remarks"]], summary["files"])


def _print_end(console: Console, remarks: list[str], files: list[str]) -> None:
    for remark in remarks:
        console.print(f"• {remark}", markup=False, highlight=False)
    console.print(f"wrote {', '.join(files)}", markup=False, highlight=False)
