"""Pictures of an identification: an axis (measured and simulated, residual, Bode) and a muzzle (landing distances)."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.style import BLUE, INK, MUTED, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_LONGEST = 2000


class SimulatedRun(NamedTuple):
    """One output of a recording beside its simulation."""

    time: Array
    """Time [s], shape (N,)."""
    measured: Array
    """Measured output, shape (N,)."""
    simulated: Array
    """Simulated output, shape (N,)."""
    fit_percent: float
    """Fit over the whole recording [%]."""
    title: str
    """What the recording is."""


class BodeData(NamedTuple):
    """Frequency response of a model, and as measured where it was."""

    frequency_hz: Array
    """Frequencies of the model's response [Hz], shape (F,)."""
    response: ComplexArray
    """The model's output per input, shape (F,)."""
    measured_hz: Array
    """Frequencies of the measured response [Hz], shape (M,), M may be 0."""
    measured: ComplexArray
    """Measured output per input, shape (M,)."""
    excited_hz: tuple[float, float]
    """Frequencies that the inputs excite [Hz]; outside, the model is a guess."""


class LandingGroup(NamedTuple):
    """Shots beside the model, one entry per shot."""

    pitch: Array
    """Barrel's elevation [rad], shape (N,)."""
    measured: Array
    """Landing distance [m], shape (N,)."""
    modelled: Array
    """Landing distance by the model [m], shape (N,)."""
    modelled_sd: Array
    """Its standard deviation by the model [m], shape (N,)."""


def axis_figure(run: SimulatedRun, bode: BodeData, *, output: str = "output", title: str = "Axis") -> Figure:
    """Draw measured over simulated output, the residual, and the frequency response.

    A long recording is shown where its residual is largest.

    Args:
      run: the recording, with N ≥ 2.
      bode: frequency responses.
      output: name of the output, for the labels.
      title: what was identified.
    """
    with plot_style():
        figure, axes = new_figure(2, 2, width=10.0, height=5.6, sharex="col")
        shown, note = _worst_stretch(run)
        _draw_run(axes[0, 0], axes[1, 0], run, shown, output)
        label_axes(axes[0, 0], title=f"{title}: {run.title}{note}, fit {run.fit_percent:.2f} %", y=output)
        _draw_bode(axes[0, 1], axes[1, 1], bode)
    return figure


def _worst_stretch(run: SimulatedRun) -> tuple[slice, str]:
    count = run.time.size
    if count <= _LONGEST:
        return slice(0, count), ""
    energy = np.concatenate([[0.0], np.cumsum((run.measured - run.simulated) ** 2)])
    start = int(np.argmax(energy[_LONGEST:] - energy[:-_LONGEST]))
    return slice(start, start + _LONGEST), " (worst stretch)"


def _draw_run(above: Axes, below: Axes, run: SimulatedRun, shown: slice, output: str) -> None:
    time, measured, simulated = run.time[shown], run.measured[shown], run.simulated[shown]
    above.plot(time, measured, color=INK, linewidth=1.0, label="measured")
    above.plot(time, simulated, color=VERMILLION, linewidth=1.4, linestyle=(0, (4, 1.5)), label="simulated")
    above.legend(loc="best", ncols=2)
    below.plot(time, measured - simulated, color=BLUE, linewidth=0.8)
    label_axes(below, x="Time [s]", y=f"{output}: measured − simulated")


def _draw_bode(magnitude: Axes, phase: Axes, bode: BodeData) -> None:
    kept = bode.measured != 0
    if kept.any():
        dots: Any = {"color": MUTED, "linestyle": "none", "marker": ".", "markersize": 4.0}
        magnitude.plot(bode.measured_hz[kept], _decibel(bode.measured[kept]), label="measured (H1)", **dots)
        phase.plot(bode.measured_hz[kept], _phase_near(bode, bode.measured_hz[kept], bode.measured[kept]), **dots)
    magnitude.plot(bode.frequency_hz, _decibel(bode.response), color=VERMILLION, label="model")
    phase.plot(bode.frequency_hz, np.degrees(np.unwrap(np.angle(bode.response))), color=VERMILLION)
    magnitude.set_xscale("log")
    lowest, highest = bode.frequency_hz[0], bode.frequency_hz[-1]
    for axes in (magnitude, phase):
        axes.axvspan(
            min(bode.excited_hz[1], highest), highest, color=MUTED, alpha=0.15, linewidth=0, label="not excited"
        )
        axes.axvspan(lowest, max(bode.excited_hz[0], lowest), color=MUTED, alpha=0.15, linewidth=0)
    magnitude.legend(loc="best")
    label_axes(magnitude, title="Frequency response", y="Magnitude [dB]")
    label_axes(phase, x="Frequency [Hz]", y="Phase [°]")


def _decibel(response: ComplexArray) -> Array:
    return np.asarray(20 * np.log10(np.maximum(np.abs(response), 1e-12)))


def _phase_near(bode: BodeData, frequency_hz: Array, response: ComplexArray) -> Array:
    """Return phases [°] on the same turn as the model's: unwrapping noisy phases by themselves slips."""
    model = np.degrees(np.interp(frequency_hz, bode.frequency_hz, np.unwrap(np.angle(bode.response))))
    measured = np.degrees(np.angle(response))
    return np.asarray(measured + 360 * np.round((model - measured) / 360))


def landing_figure(shots: LandingGroup, *, title: str = "Landing distances") -> Figure:
    """Draw landing distances over pitch with the model's mean ± 2 standard deviations, and the residuals in percent."""
    with plot_style():
        figure, axes = new_figure(1, 2, width=10.0, height=3.6)
        pitch = np.degrees(shots.pitch)
        order = np.argsort(pitch, kind="stable")
        dots: Any = {"color": INK, "linestyle": "none", "marker": "o", "markersize": 4.0}
        bars: Any = {"color": VERMILLION, "linestyle": "none", "marker": "_", "markersize": 14.0, "capsize": 4.0}
        axes[0, 0].errorbar(
            pitch[order], shots.modelled[order], 2 * shots.modelled_sd[order], label="model ± 2 sd", **bars
        )
        axes[0, 0].plot(pitch, shots.measured, label="measured", **dots)
        axes[0, 0].legend(loc="upper left")
        label_axes(axes[0, 0], title=title, x="Pitch [°]", y="Distance [m]")
        axes[0, 1].axhline(0.0, color=MUTED, linewidth=0.8)
        axes[0, 1].plot(pitch, 100 * (shots.measured - shots.modelled) / shots.measured, **dots)
        label_axes(axes[0, 1], title="Measured − model", x="Pitch [°]", y="Share of distance [%]")
    return figure
