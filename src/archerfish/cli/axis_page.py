"""The page of an identified axis: one self-contained HTML file, the verdict first."""

from typing import Any

from archerfish.cli.axis_evidence import (
    AxisEvidence,
    LogEvidence,
    PoleEvidence,
    pole_evidence,
    steady_gains,
)
from archerfish.cli.axis_picture import bode_data, correlation_panels, pole_map, unit_steps
from archerfish.cli.axis_usability import judged_fit
from archerfish.cli.axis_verdict import Verdict
from archerfish.figures.bode import bode_figure
from archerfish.figures.identification import run_figure
from archerfish.figures.page import number, render_page
from archerfish.figures.pole_map import pole_figure
from archerfish.figures.residuals import correlation_figure
from archerfish.figures.step_response import unit_step_figure
from archerfish.figures.style import svg_text
from archerfish.identification.validation.residual_tests import ResidualTests
from archerfish.records.plant import USABLE_FIT_PERCENT

_RUNS_DRAWN = 4
"""Logs that are drawn; each is some hundred kilobytes, and a table tells the others."""


def axis_page(evidence: AxisEvidence, verdict: Verdict, *, output: str, unit: str = "") -> str:
    """Return the page of an identified axis.

    Args:
      evidence: the axis, its logs and findings.
      verdict: what follows from them.
      output: name of the output, for the labels.
      unit: of the output; where it is not known, numbers are said to be in the unit of the output.
    """
    result = evidence.result
    judged = judged_fit(evidence)
    return render_page(
        "axis.html",
        title=f"{result.plant.axis.capitalize()}: what the logs say",
        verdict=verdict,
        usable_percent=USABLE_FIT_PERCENT,
        judged={"kind": judged.kind, "fit_percent": judged.run.fit_percent},
        logs=[_log(each) for each in evidence.logs],
        findings=evidence.findings,
        remarks=result.remarks,
        unit=unit or f"unit of {output}",
        record=f"{result.plant.axis}.json",
        provenance=result.plant.provenance,
        **_numbers(evidence),
        **_pictures(evidence, f"{output} [{unit}]" if unit else output),
    )


def _log(log: LogEvidence) -> dict[str, Any]:
    p_value = min(each.p_value for each in log.tests.independence) if log.tests else 1.0
    return {
        "name": log.recording.source or log.path.name,
        "kind": log.kind,
        "duration_s": len(log.recording) * log.recording.sample_period_s,
        "fit_percent": log.run.fit_percent,
        "residual_sd": log.residual_sd,
        "tests": log.tests,
        "p_value": "< 0.001" if p_value < 1e-3 else number(p_value, 2),
    }


def _numbers(evidence: AxisEvidence) -> dict[str, Any]:
    result, plant = evidence.result, evidence.result.plant
    milliseconds = 1e3 * plant.sample_period_s
    gains = zip(plant.input_names, steady_gains(result), result.dc_gain_interval, strict=True)
    return {
        "plant": plant,
        "has_draws": bool(plant.draws),
        "delay_ms": milliseconds * plant.delay_samples,
        "delay_range": result.delay_range,
        "delay_range_ms": [milliseconds * each for each in result.delay_range],
        "gains": [
            {"name": name, "value": gain, "interval": interval, "unit": f"{plant.output_names[0]} per {name}"}
            for name, gain, interval in gains
        ],
        "held_gains": evidence.held_gains,
        "offset": float(result.offset[0]),
        "residual_sd": float(result.residual_sd[0]),
        "band": result.excited_band_hz,
        "trials": evidence.trials,
        "poles": [_pole(each) for each in pole_evidence(result) if each.pole.imag >= 0],
    }


def _pole(evidence: PoleEvidence) -> dict[str, Any]:
    pole = evidence.pole
    imaginary = f" ± {number(pole.imag, 4)}i" if pole.imag else ""
    return evidence._asdict() | {"place": f"{number(pole.real, 4)}{imaginary}"}


def _pictures(evidence: AxisEvidence, output: str) -> dict[str, Any]:
    result = evidence.result
    names = result.plant.input_names
    # Those held back come first: they are the ones to trust.
    logs = [*evidence.of_kind("validation"), *evidence.of_kind("training")]
    drawn = logs[:_RUNS_DRAWN]
    fitted = [log.recording for log in evidence.of_kind("training")]
    poles = pole_figure(pole_map(result, result.determined, result.excited_band_hz))
    steps = unit_step_figure(unit_steps(result), output=output)
    return {
        "runs": [_run(log, f"run-{index}", result.plant.axis, output) for index, log in enumerate(drawn)],
        "runs_left_out": len(logs) - len(drawn),
        "bodes": [
            svg_text(
                bode_figure(bode_data(result, fitted, channel), title=f"{output} per {name}"),
                prefix=f"bode-{channel}",
                label=f"Bode plot from {name}",
            )
            for channel, name in enumerate(names)
        ],
        "pole_map": svg_text(poles, prefix="poles", label="Pole map"),
        "steps": svg_text(steps, prefix="steps", label="Unit step responses"),
        "correlations": [
            _correlations(log, log.tests, f"residual-{index}", names) for index, log in enumerate(drawn) if log.tests
        ],
    }


def _run(log: LogEvidence, prefix: str, axis: str, output: str) -> dict[str, str]:
    role = "held back: the plant saw its input alone" if log.kind == "validation" else "fitted"
    label = f"Measured and simulated output, {log.path.stem}"
    picture = run_figure(log.run, output=output, title=axis)
    return {"svg": svg_text(picture, prefix=prefix, label=label), "caption": f"{log.path.name}, {role}."}


def _correlations(log: LogEvidence, tests: ResidualTests, prefix: str, names: tuple[str, ...]) -> dict[str, str]:
    picture = correlation_figure(correlation_panels(tests, names))
    label = f"Correlations of the residual of {log.path.name}"
    return {"svg": svg_text(picture, prefix=prefix, label=label), "caption": f"{log.path.name}, {log.kind}."}
