"""Picture of a planned excitation: the commands, their spectra, and the frequency response that they will show."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.style import MUTED, PALETTE, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]

_FLOOR_DB = 80.0
"""Depth of the spectra that is shown below their peak [dB]."""


class CommandRun(NamedTuple):
    """One command that is to be played."""

    name: str
    """What it is called in the legend."""
    command: Array
    """Commanded angle [rad], shape (N,)."""


class ResponseBand(NamedTuple):
    """Frequency response with its 95 % band; entries named as in the prediction of an experiment."""

    frequency_hz: Array
    """Frequencies [Hz], shape (F,)."""
    gain: Array
    """Output per input, shape (F,)."""
    gain_half_width: Array
    """Half of the gain's 95 % interval, shape (F,)."""
    phase: Array
    """[rad], shape (F,)."""
    phase_half_width: Array
    """Half of the phase's 95 % interval [rad], shape (F,)."""
    shown: NDArray[np.bool_]
    """Where the logs hold more signal than noise, shape (F,)."""


def excitation_figure(
    runs: Sequence[CommandRun],
    sample_period_s: float,
    band_hz: tuple[float, float],
    response: ResponseBand,
    *,
    title: str = "Axis",
) -> Figure:
    """Draw commands one after another, their spectra with the wanted band, and the expected Bode plot.

    Args:
      runs: the commands.
      sample_period_s: sampling period of the commands [s].
      band_hz: frequencies that are to be excited [Hz].
      response: what the logs are expected to show.
      title: name of the axis.
    """
    with plot_style():
        figure, axes = new_figure(2, 2, width=10.0, height=5.6)
        _draw_commands(axes[0, 0], runs, sample_period_s)
        _draw_spectra(axes[1, 0], runs, sample_period_s, band_hz)
        _draw_response(axes[0, 1], axes[1, 1], response)
        label_axes(axes[0, 0], title=f"{title}: commands, one after another", x="Time [s]", y="Command [°]")
        label_axes(axes[1, 0], title="Spectra", x="Frequency [Hz]", y="Energy density [dB re 1 °²s²]")
    return figure


def _draw_commands(axes: Axes, runs: Sequence[CommandRun], sample_period_s: float) -> None:
    start = 0.0
    for run, colour in zip(runs, PALETTE, strict=False):
        time = start + sample_period_s * np.arange(len(run.command))
        axes.plot(time, np.degrees(run.command), color=colour, linewidth=0.8, label=run.name)
        start = float(time[-1]) + sample_period_s
    axes.legend(loc="upper right", ncols=len(runs))


def _draw_spectra(axes: Axes, runs: Sequence[CommandRun], sample_period_s: float, band_hz: tuple[float, float]) -> None:
    peak = -np.inf
    for run, colour in zip(runs, PALETTE, strict=False):
        frequency, density = _smoothed_density(np.degrees(run.command - run.command.mean()), sample_period_s)
        level = 10 * np.log10(np.maximum(density, 1e-30))
        peak = max(peak, float(level.max()))
        axes.plot(frequency, level, color=colour, linewidth=0.8, label=run.name)
    axes.axvspan(*band_hz, color=MUTED, alpha=0.15, linewidth=0, label="wanted band")
    axes.set_xscale("log")
    axes.set_xlim(0.1 * band_hz[0], min(5 * band_hz[1], 0.5 / sample_period_s))
    axes.set_ylim(peak - _FLOOR_DB, peak + 5)
    axes.legend(loc="best")


def _smoothed_density(signal: Array, sample_period_s: float) -> tuple[Array, Array]:
    """Average the energy density over a sixth of an octave: a step's has a zero at every other line."""
    power = np.concatenate([[0.0], np.cumsum(np.abs(np.fft.rfft(signal) * sample_period_s) ** 2)])
    lines = np.fft.rfftfreq(len(signal), sample_period_s)
    frequency = np.geomspace(lines[1], lines[-1], 400)
    first = np.maximum(np.searchsorted(lines, frequency * 2 ** (-1 / 12)) - 1, 0)
    last = np.minimum(np.searchsorted(lines, frequency * 2 ** (1 / 12)) + 1, len(lines))
    return frequency, (power[last] - power[first]) / (last - first)


def _draw_response(magnitude: Axes, phase: Axes, response: ResponseBand) -> None:
    least = 1e-3 * response.gain
    low, high = (20 * np.log10(np.maximum(response.gain + sign * response.gain_half_width, least)) for sign in (-1, 1))
    level = 20 * np.log10(response.gain)
    angle, half = np.degrees(response.phase), np.degrees(np.minimum(response.phase_half_width, np.pi))
    bands = ((magnitude, level, low, high), (phase, angle, angle - half, angle + half))
    for axes, middle, below, above in bands:
        axes.fill_between(response.frequency_hz, below, above, color=VERMILLION, alpha=0.25, linewidth=0, label="95 %")
        axes.plot(response.frequency_hz, middle, color=VERMILLION, label="assumed axis")
        room = 0.15 * np.ptp(middle) + 1
        axes.set_ylim(middle.min() - room, middle.max() + room)
        axes.fill_between(
            response.frequency_hz,
            0,
            1,
            where=(~response.shown).tolist(),
            transform=axes.get_xaxis_transform(),
            color=MUTED,
            alpha=0.15,
            linewidth=0,
            label="hidden by noise",
        )
        axes.set_xscale("log")
    magnitude.legend(loc="best")
    label_axes(magnitude, title="What the logs are expected to tell", y="Magnitude [dB]", x="Frequency [Hz]")
    label_axes(phase, x="Frequency [Hz]", y="Phase [°]")
