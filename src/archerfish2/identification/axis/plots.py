"""Plots of an identified axis: its free run, frequency response, step response, and what its residual still has."""

from typing import TYPE_CHECKING, Any

import numpy as np

from archerfish2.identification.axis.bootstrap import interval
from archerfish2.identification.frequency import MeasuredResponse, frequency_response
from archerfish2.identification.residuals import ResidualTests
from archerfish2.identification.simulation import Array, simulate
from archerfish2.identification.validation import FreeRun
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.style import INK, MUTED, PALETTE, new_figure, plot_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BLUE, _RED, _GREEN = PALETTE[:3]
_BAND: Any = {"color": _RED, "alpha": 0.25, "linewidth": 0, "label": "95 % band"}
_DOTS: Any = {"color": INK, "linestyle": "none", "marker": ".", "markersize": 4.0, "label": "measured (H1)"}
_LONGEST = 2000  # samples of a run that are legible
_POINTS, _AROUND = 400, 4.0  # frequencies, and the factor that they reach beyond the excited band
_SETTLED, _STEP = 6.0, (50, 5000)  # time constants that a step is drawn for, and its samples, least and most


def run_plot(log: Recording, run: FreeRun, *, output: int = 0, title: str = "") -> "Figure":
    """Draw measured and simulated output and, below, the residual; of a long log where that is largest.

    Args:
      log: with outputs.
      run: the plant's free run of it.
      output: which one.
      title: above.
    """
    measured, simulated = log.outputs[:, output], run.outputs[:, output]
    energy, length = np.append(0, np.cumsum((measured - simulated) ** 2)), min(_LONGEST, len(log))
    start = int(np.argmax(energy[length:] - energy[: len(energy) - length]))
    part = slice(start, start + length)
    time = log.time[part]
    with plot_style():
        figure, axes = new_figure(2, 1, height=4.4, sharex=True, height_ratios=(2, 1))
        above, below = axes[:, 0]
        above.plot(time, measured[part], color=INK, linewidth=1.0, label="measured")
        above.plot(time, simulated[part], color=_RED, linestyle=(0, (4, 1.5)), label="simulated")
        above.set(title=title, ylabel=log.output_names[output])
        below.plot(time, (measured - simulated)[part], color=_BLUE, linewidth=0.8)
        below.axhline(0.0, color=MUTED, linewidth=0.8)
        below.set(ylabel="residual", xlabel="time [s]" + ", where the residual is largest" * (length < len(log)))
        _legend(figure, above)
    return figure


def bode_plot(
    plant: PlantRecord, measured: MeasuredResponse, excited_hz: tuple[float, float], *, output: int = 0, title: str = ""
) -> "Figure":
    """Draw magnitude and phase from each input with the band of the draws, and as measured where that is significant.

    Args:
      plant: with draws, or without.
      measured: from the logs.
      excited_hz: band in which the logs determine the plant [Hz].
      output: which one.
      title: above.
    """
    hz = np.geomspace(excited_hz[0] / _AROUND, min(_AROUND * excited_hz[1], 0.5 / plant.sample_period_s), _POINTS)
    response, drawn = (frequency_response(plant, hz, draws=draws)[..., output, :] for draws in (False, True))
    with plot_style():
        figure, axes = new_figure(2, response.shape[1], height=5.0, sharex=True)
        for channel, (magnitude, phase) in enumerate(axes.T):
            own, draws = response[:, channel], drawn[..., channel]
            coherent = measured.coherence[:, output, channel] > measured.significant
            at, points = measured.hz[coherent], measured.response[coherent, output, channel]
            # About the plant's own phase: noisy phases slip by a turn when they are unwrapped by themselves.
            turn, ratio = np.unwrap(np.angle(own)), points / frequency_response(plant, at)[:, output, channel]
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
        axes[0, 0].set(title=title, ylabel="magnitude [dB]")
        axes[1, 0].set(ylabel="phase [°]")
        _legend(figure, axes[0, 0])
    return figure


def step_plot(plant: PlantRecord, *, output: int = 0, title: str = "") -> "Figure":
    """Draw the responses to a unit step of each input, with the band of the draws and the steady gain.

    Args:
      plant: with draws, or without.
      output: which one.
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
                panel.fill_between(time, *interval(simulate(plant, step, draws=True)[..., output]), **_BAND)
            panel.plot(time, simulate(plant, step)[:, output], color=_RED, label="plant")
            panel.axhline(plant.dc_gain[output, channel], color=MUTED, linestyle="--", label="steady gain")
            panel.set(xlabel=f"time since the step of {plant.input_names[channel]} [s]")
        axes[0, 0].set(title=title, ylabel=f"{plant.output_names[output]} per unit")
        _legend(figure, axes[0, 0])
    return figure


def correlation_plot(tests: ResidualTests, *, title: str = "") -> "Figure":
    """Draw the correlation of a residual with each input, and the band that a good model's does not leave."""
    with plot_style():
        figure, axes = new_figure(1, len(tests.band), height=3.0)
        for panel, values, band in zip(axes[0], tests.correlation, tests.band, strict=True):
            panel.fill_between(tests.lags, -band, band, color=_GREEN, alpha=0.18, linewidth=0, label="99 % band")
            panel.vlines(tests.lags, 0.0, values, color=_BLUE, linewidth=1.6, label="residual")
            panel.set(xlabel="lag after the input [samples]")
        axes[0, 0].set(title=title, ylabel="correlation")
        _legend(figure, axes[0, 0])
    return figure


def _legend(figure: "Figure", panel: Any) -> None:
    """Set the legend outside, where it hides nothing."""
    figure.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.align_ylabels()


def _decibel(response: Any) -> Array:
    return np.asarray(20 * np.log10(np.maximum(np.abs(response), 1e-12)))
