"""Plots of an identified axis: its free run, frequency response, step response, and what its residual still has."""

from typing import Any

import numpy as np

from archerfish.identification.axis.bootstrap import interval
from archerfish.identification.frequency import MeasuredResponse, frequency_response
from archerfish.identification.residuals import ResidualTests
from archerfish.identification.simulation import Array, FreeRun, simulate
from archerfish.logs.recording import Recording
from archerfish.records.plant import PlantRecord
from archerfish.reports.style import INK, MUTED, PALETTE, Figure, new_figure, plot_style

_BLUE, _RED, _GREEN = PALETTE[:3]
_BAND: Any = {"color": _RED, "alpha": 0.25, "linewidth": 0, "label": "95 % band"}
_DOTS: Any = {"color": INK, "linestyle": "none", "marker": ".", "markersize": 4.0, "label": "measured (H1)"}
_LONGEST = 2000  # samples of a run that are legible
_POINTS, _AROUND = 400, 4.0  # frequencies, and the factor that they reach beyond the excited band
_SETTLED, _STEP = 6.0, (50, 5000)  # time constants that a step is drawn for, and its samples, least and most


def run_plot(log: Recording, run: FreeRun, *, title: str = "", unit: str = "") -> Figure:
    """Draw the whole log, then input, first output and its simulation where the residual is largest, and the residual.

    Args:
      log: with outputs.
      run: the plant's free run of it.
      title: above.
      unit: in which angles of a gimbal's axis are drawn, "°"; empty where the log is of something else.
    """
    factor, shown = (np.degrees(1.0), unit) if unit else (1.0, "as logged")
    command, measured, simulated = factor * log.inputs[:, 0], factor * log.outputs[:, 0], factor * run.outputs[:, 0]
    names = log.input_names[0], log.output_names[0]
    energy, length = np.append(0, np.cumsum((measured - simulated) ** 2)), min(_LONGEST, len(log))
    start = int(np.argmax(energy[length:] - energy[: len(energy) - length]))
    part = slice(start, start + length)
    with plot_style():
        figure, axes = new_figure(3, 1, height=6.0, height_ratios=(2, 2, 1))
        whole, above, below = axes[:, 0]
        for panel, where in ((whole, slice(None)), (above, part)):
            other = panel if unit else panel.twinx()  # a scale of its own for an input in another unit
            other.plot(log.time[where], command[where], color=_BLUE, linewidth=0.9)
            panel.plot([], [], color=_BLUE, linewidth=0.9, label="command" if unit else names[0])
            panel.plot(log.time[where], measured[where], color=INK, linewidth=1.0, label="measured")
            panel.plot(log.time[where], simulated[where], color=_RED, linestyle=(0, (4, 1.5)), label="simulated")
            if not unit:
                other.set_ylabel(f"{names[0]} [{shown}]")
                other.grid(visible=False)
            panel.set_ylabel(f"{'angle' if unit else names[1]} [{shown}]")
        whole.axvspan(
            *log.time[[start, start + length - 1]], color=_GREEN, alpha=0.15, linewidth=0, label="shown below"
        )
        below.plot(log.time[part], (measured - simulated)[part], color=_BLUE, linewidth=0.8)
        below.axhline(0.0, color=MUTED, linewidth=0.8)
        remark = ", where the residual is largest" * (length < len(log))
        below.set(ylabel=f"residual [{shown}]", xlabel=f"time [s]{remark}")
        below.sharex(above)
        above.label_outer()
        whole.set_xlabel("time [s]")
        return _labelled(figure, title, whole.get_ylabel())


def bode_plot(
    plant: PlantRecord, measured: MeasuredResponse, excited_hz: tuple[float, float], *, title: str = ""
) -> Figure:
    """Draw the response of the first output to each input with the band of the draws, and what of it was measured.

    Args:
      plant: with draws, or without.
      measured: from the logs.
      excited_hz: band in which the logs determine the plant [Hz].
      title: above.
    """
    hz = np.geomspace(excited_hz[0] / _AROUND, min(_AROUND * excited_hz[1], 0.5 / plant.sample_period_s), _POINTS)
    response, drawn = (frequency_response(plant, hz, draws=draws)[..., 0, :] for draws in (False, True))
    with plot_style():
        figure, axes = new_figure(2, response.shape[1], height=5.0, sharex=True)
        for channel, (magnitude, phase) in enumerate(axes.T):
            own, draws = response[:, channel], drawn[..., channel]
            coherent = measured.coherence[:, 0, channel] > measured.significant
            at, points = measured.hz[coherent], measured.response[coherent, 0, channel]
            # About the plant's own phase: noisy phases slip by a turn when they are unwrapped by themselves.
            turn, ratio = np.unwrap(np.angle(own)), points / frequency_response(plant, at)[:, 0, channel]
            turns = turn + np.angle(draws / own), np.interp(at, hz, turn) + np.angle(ratio)
            for panel, *curves in (
                (magnitude, *map(_decibel, (own, draws, points))),
                (phase, *map(np.degrees, (turn, *turns))),
            ):
                panel.plot(hz, curves[0], color=_RED, label="plant")
                panel.set_xscale("log", subs=[3])
                panel.xaxis.set_major_formatter("{x:g}")
                panel.xaxis.set_minor_formatter("{x:g}")
                panel.set(xlim=(hz[0], hz[-1]), ymargin=0.2)
                panel.autoscale(enable=False)  # the band of the draws would squeeze the rest where nothing is known
                if len(draws):
                    panel.fill_between(hz, *interval(curves[1]), **_BAND)
                panel.plot(at, curves[2], **_DOTS)
                panel.axvspan(*excited_hz, color=_GREEN, alpha=0.1, linewidth=0, label="excited band")
            phase.set(xlabel=f"frequency of {plant.input_names[channel]} [Hz]")
        axes[1, 0].set(ylabel="phase [°]")
        return _labelled(figure, title, "magnitude [dB]")


def step_plot(plant: PlantRecord, *, title: str = "") -> Figure:
    """Draw the first output's responses to a unit step of each input, with the band of the draws and the steady gain.

    Args:
      plant: with draws, or without.
      title: above.
    """
    decay = -np.log(min(float(np.abs(np.linalg.eigvals(plant.A)).max()), 1 - 1e-9))
    samples = plant.delay_samples + int(np.clip(_SETTLED / max(decay, 1e-9), *_STEP))
    time, inputs = plant.sample_period_s * np.arange(-1, samples), len(plant.input_names)
    with plot_style():
        figure, axes = new_figure(1, inputs, height=3.2)
        for channel, panel in enumerate(axes[0]):
            step = (time >= 0)[:, None] * np.eye(inputs)[channel]
            if plant.draws:
                panel.fill_between(time, *interval(simulate(plant, step, draws=True)[..., 0]), **_BAND)
            panel.plot(time, simulate(plant, step)[:, 0], color=_RED, label="plant")
            panel.axhline(plant.dc_gain[0, channel], color=MUTED, linestyle="--", label="steady gain")
            panel.set(xlabel=f"time since the step of {plant.input_names[channel]} [s]")
        return _labelled(figure, title, f"{plant.output_names[0]} per input [as logged]")


def correlation_plot(tests: ResidualTests, *, title: str = "") -> Figure:
    """Draw the correlation of a residual with each input, and the band that a good model's does not leave."""
    with plot_style():
        figure, axes = new_figure(1, len(tests.band), height=3.0)
        for panel, values, band in zip(axes[0], tests.correlation, tests.band, strict=True):
            panel.fill_between(tests.lags, -band, band, color=_GREEN, alpha=0.18, linewidth=0, label="99 % band")
            panel.vlines(tests.lags, 0.0, values, color=_BLUE, linewidth=1.6, label="residual")
            panel.set(xlabel="lag after the input [samples]")
        return _labelled(figure, title, "correlation [–]")


def _labelled(figure: Figure, title: str, ylabel: str) -> Figure:
    """Label the first panel, whose legend is put outside, where it hides nothing."""
    figure.axes[0].set(title=title, ylabel=ylabel)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.align_ylabels()
    return figure


def _decibel(response: Any) -> Array:
    return np.asarray(20 * np.log10(np.maximum(np.abs(response), 1e-12)))
