"""What `archerfish identify gimbal` says about an axis: as facts for --json, and as a table for a person."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from archerfish.cli.axis_evidence import (
    AxisEvidence,
    HeldGain,
    LogEvidence,
    PoleEvidence,
    gain_words,
    pole_evidence,
    steady_gains,
)
from archerfish.cli.axis_verdict import Verdict, delay_words
from archerfish.cli.sample_count import sample_facts
from archerfish.cli.summary_end import print_end
from archerfish.identification.axis.order_choice import WORTH_A_STATE

Summary = dict[str, Any]

_TRIFLE = 0.005
"""Share of the residual that the input may explain without a word: long clean logs detect what matters to nobody."""


def axis_summary(evidence: AxisEvidence, verdict: Verdict, files: Sequence[Path]) -> Summary:
    """Return the facts of an identified axis that --json writes.

    Args:
      evidence: the axis, its logs and findings.
      verdict: what follows from them.
      files: what was written.
    """
    result, plant = evidence.result, evidence.result.plant
    return {
        "headline": verdict.headline,
        "usable": verdict.usable,
        "reasons": list(verdict.reasons),
        "advice": [{"option": each.option, "gained_points": each.gained} for each in verdict.advice],
        "axis": plant.axis,
        "order": len(plant.A),
        "sample_period_s": plant.sample_period_s,
        "delay_samples": plant.delay_samples,
        "delay_s": plant.delay_samples * plant.sample_period_s,
        "delay_range_samples": list(result.delay_range),
        "later_delay_samples": result.later_delay,
        "feedthrough": plant.D[0].tolist(),
        "dc_gain": steady_gains(result),
        "dc_gain_interval": [list(each) for each in result.dc_gain_interval],
        "held_gains": [_held(each) for each in evidence.held_gains],
        "offset": float(result.offset[0]),
        "residual_sd": float(result.residual_sd[0]),
        "excited_band_hz": list(result.excited_band_hz),
        "poles": [_pole(each) for each in pole_evidence(result)],
        "orders_tried": [each._asdict() for each in evidence.trials],
        "training": [_log(each) for each in evidence.of_kind("training")],
        "validation": [_log(each) for each in evidence.of_kind("validation")],
        "samples": sample_facts(evidence.samples),
        "findings": [each._asdict() for each in evidence.findings],
        "remarks": [*result.remarks, *verdict.doubts],
        "next_steps": list(verdict.next_steps),
        "files": [str(path) for path in files],
    }


def _held(held: HeldGain) -> Summary:
    return {
        "input": held.name,
        "asked": held.asked,
        "estimated": held.free,
        "estimated_interval": list(held.interval),
        "contradicted": held.contradicted,
    }


def _log(log: LogEvidence) -> Summary:
    facts: Summary = {"file": str(log.path), "fit_percent": log.run.fit_percent, "residual_sd": log.residual_sd}
    if log.tests is None:
        return facts | {"residual": None}
    tests = log.tests
    judged = {
        "independent_of_input": tests.independent,
        "independence_p_value": min(each.p_value for each in tests.independence),
        "explained_share": tests.explained_share,
        "white": tests.whiteness.passed,
        "feedback": tests.feedback,
    }
    return facts | {"residual": judged}


def _pole(evidence: PoleEvidence) -> Summary:
    pole = evidence.pole
    return {
        "real": pole.real,
        "imag": pole.imag,
        "modulus": abs(pole),
        "frequency_hz": evidence.frequency_hz,
        "damping": evidence.damping,
        "frequency_interval_hz": evidence.frequency_interval_hz,
        "damping_interval": evidence.damping_interval,
        "determined": evidence.determined,
    }


def print_axis(console: Console, evidence: AxisEvidence, verdict: Verdict, files: Sequence[Path]) -> None:
    """Print the verdict in a line, the table of numbers, the findings, and what to do."""
    console.print(verdict.headline, style="bold", markup=False, highlight=False)
    result = evidence.result
    table = Table(show_header=False)
    table.add_row("input delay", f"{delay_words(evidence)} = {_samples(evidence)}")
    for name, gain, interval in zip(
        result.plant.input_names, steady_gains(result), result.dc_gain_interval, strict=True
    ):
        source = f" from {name}" if len(result.plant.input_names) > 1 else ""
        if not evidence.held_gains:
            table.add_row(f"steady gain{source}", gain_words(gain, interval))
    for held in evidence.held_gains:
        source = f" from {held.name}" if len(evidence.held_gains) > 1 else ""
        table.add_row(f"steady gain{source}", f"{held.asked:.4g}, held")
        table.add_row("left free", gain_words(held.free, held.interval))
    table.add_row("excited band", "{:.3g}–{:.3g} Hz".format(*result.excited_band_hz))
    for pole in pole_evidence(result):
        if pole.pole.imag >= 0:
            table.add_row("pole" if pole.determined else "pole, not determined", pole_words(pole))
    for log in evidence.logs:
        table.add_row(f"fit, {log.kind}", f"{log.run.fit_percent:.2f} %  {log.path.name}{_residual_words(log)}")
    console.print(table)
    if evidence.trials:
        console.print(_order_table(evidence))
    for finding in evidence.findings:
        words = f"• {finding.place}: {finding.message}; {finding.remedy} ({finding.severity}: {finding.code})"
        console.print(words, markup=False, highlight=False)
    print_end(console, [*result.remarks, *verdict.doubts, *verdict.next_steps], [str(path) for path in files])


def _order_table(evidence: AxisEvidence) -> Table:
    rule = (
        f"* chosen: largest fit on what was held back, less {WORTH_A_STATE:g} points for each state"
        if evidence.of_kind("validation")
        else "* chosen: lowest BIC"
    )
    table = Table("order", "fit, training", "fit, validation", "BIC less the best", title="orders tried", caption=rule)
    for trial in evidence.trials:
        held_back = "" if trial.validation_percent is None else f"{trial.validation_percent:.2f} %"
        chosen = " *" if trial.order == len(evidence.result.plant.A) else ""
        table.add_row(f"{trial.order}{chosen}", f"{trial.fit_percent:.2f} %", held_back, f"{trial.criterion:.1f}")
    return table


def _samples(evidence: AxisEvidence) -> str:
    low, high = evidence.result.delay_range
    count = evidence.result.plant.delay_samples
    return f"{count} {'sample' if count == 1 else 'samples'}" + (f" ({low}–{high})" if low < high else "")


def pole_words(evidence: PoleEvidence) -> str:
    """Write a pole, its frequency and damping, with their intervals where there are any."""
    pole = evidence.pole
    words = f"{pole.real:.4f}" + (f" ± {pole.imag:.4f}i" if pole.imag else "")
    if evidence.frequency_hz is None:
        return words
    words += f", {_with_interval(evidence.frequency_hz, evidence.frequency_interval_hz)} Hz"
    damped = pole.imag and evidence.damping is not None
    return words + (f", damping {_with_interval(evidence.damping or 0.0, evidence.damping_interval)}" if damped else "")


def _with_interval(value: float, interval: tuple[float, float] | None) -> str:
    return f"{value:.3g}" + (f" ({interval[0]:.3g}…{interval[1]:.3g})" if interval else "")


def _residual_words(log: LogEvidence) -> str:
    if log.tests is None or log.tests.independent or log.tests.explained_share < _TRIFLE:
        return ""
    return f"; the input explains {100 * log.tests.explained_share:.1f} % of the residual"
