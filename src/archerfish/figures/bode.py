"""Frequency response of an identified axis: the model with its band, the measured one, and where both are silent."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.frame import frame_axes
from archerfish.figures.style import BLUE, GREEN, MUTED, VERMILLION, label_axes, label_log_axis, new_figure, plot_style

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_TRUSTED_COHERENCE = 0.5
"""Below it noise outweighs the response, and a measured point says nothing about the model."""
_MARGIN_DB = 15.0
"""A band may leave the picture by more than this: where nothing is known it would squeeze all the rest."""


class BodeData(NamedTuple):
    """Frequency response of a model, and as measured where it was."""

    frequency_hz: Array
    """Frequencies of the model's response [Hz], shape (F,)."""
    response: ComplexArray
    """The model's output per input, shape (F,)."""
    drawn: ComplexArray
    """Responses of the posterior draws, shape (k, F); k may be 0."""
    measured_hz: Array
    """Frequencies of the measured response [Hz], shape (M,), M may be 0."""
    measured: ComplexArray
    """Measured output per input, shape (M,)."""
    coherence: Array
    """Squared coherence of the measured response, 0…1, shape (M,)."""
    excited_hz: tuple[float, float]
    """Frequencies that the inputs excite [Hz]; outside, the model is a guess."""


def bode_figure(bode: BodeData, *, title: str = "Frequency response") -> Figure:
    """Draw magnitude and phase with the 95 % band of the draws, and the coherence of the measured response."""
    with plot_style():
        figure, axes = new_figure(3, 1, height=6.4, layout=None, sharex=True, height_ratios=(3, 2.4, 1))
        magnitude, phase, coherence = axes[:, 0]
        draw_bode(magnitude, phase, bode, title=title)
        coherence.plot(bode.measured_hz, bode.coherence, color=BLUE, linewidth=1.2)
        coherence.axhline(_TRUSTED_COHERENCE, color=MUTED, linewidth=0.8, linestyle=":")
        coherence.set_ylim(0.0, 1.05)
        shade_bands(coherence, bode.excited_hz)
        label_axes(phase, y="Phase [°]")
        label_axes(coherence, x="Frequency [Hz]", y="Coherence")
        frame_axes(figure, axes)
    return figure


def draw_bode(magnitude: Axes, phase: Axes, bode: BodeData, *, title: str = "Frequency response") -> None:
    """Draw magnitude and phase on axes that share their x; call it inside `plot_style()`."""
    turn = np.unwrap(np.angle(bode.response))
    if len(bode.drawn):
        low, high = np.quantile(np.abs(bode.drawn), [0.025, 0.975], axis=0)
        fill: Any = {"color": VERMILLION, "alpha": 0.25, "linewidth": 0}
        magnitude.fill_between(bode.frequency_hz, _decibel(low), _decibel(high), label="95 % band", **fill)
        # About the model's own phase, so that no draw slips by a turn.
        ahead, behind = np.quantile(np.angle(bode.drawn / bode.response), [0.025, 0.975], axis=0)
        phase.fill_between(bode.frequency_hz, np.degrees(turn + ahead), np.degrees(turn + behind), **fill)
    magnitude.plot(bode.frequency_hz, _decibel(bode.response), color=VERMILLION, label="model")
    phase.plot(bode.frequency_hz, np.degrees(turn), color=VERMILLION)
    _draw_measured(magnitude, phase, bode)
    magnitude.set_xscale("log")
    magnitude.set_xlim(bode.frequency_hz[0], bode.frequency_hz[-1])
    label_log_axis(magnitude)
    _limit(magnitude, _decibel(bode.response), _MARGIN_DB)
    _limit(phase, np.degrees(turn), 60.0)
    for axes in (magnitude, phase):
        shade_bands(axes, bode.excited_hz)
    label_unknown(magnitude, bode.excited_hz)
    magnitude.legend(loc="lower left", ncols=2)
    label_axes(magnitude, title=title, y="Magnitude [dB]")
    label_axes(phase, x="Frequency [Hz]", y="Phase [°]")


def _draw_measured(magnitude: Axes, phase: Axes, bode: BodeData) -> None:
    kept = (bode.measured != 0) & (bode.coherence > _TRUSTED_COHERENCE)
    if not kept.any():
        return
    dots: Any = {"color": MUTED, "linestyle": "none", "marker": ".", "markersize": 4.0}
    magnitude.plot(bode.measured_hz[kept], _decibel(bode.measured[kept]), label="measured (H1)", **dots)
    phase.plot(bode.measured_hz[kept], _phase_near(bode, bode.measured_hz[kept], bode.measured[kept]), **dots)


def shade_bands(axes: Axes, excited_hz: tuple[float, float]) -> None:
    """Tint the excited band of an axis of frequencies, and hatch what lies outside within its present limits."""
    lowest, highest = axes.get_xlim()
    low, high = (min(max(edge, lowest), highest) for edge in excited_hz)
    axes.axvspan(low, high, color=GREEN, alpha=0.08, linewidth=0)
    for start, stop in ((lowest, low), (high, highest)):
        if stop > start:
            axes.axvspan(start, stop, facecolor="#EDEDED", edgecolor="#CFCFCF", hatch="////", linewidth=0, zorder=0)
    axes.set_xlim(lowest, highest)


def label_unknown(axes: Axes, excited_hz: tuple[float, float]) -> None:
    """Write "nothing known here" into the hatched parts of a logarithmic axis of frequencies that have room for it."""
    lowest, highest = np.log(axes.get_xlim())
    low, high = (min(max(edge, lowest), highest) for edge in np.log(excited_hz))
    plate: Any = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5}
    for start, stop in ((lowest, low), (high, highest)):
        share = (stop - start) / (highest - lowest)
        if share > 0.07:
            place = (0.5 * (start + stop) - lowest) / (highest - lowest)
            words = "nothing known here" if share > 0.3 else "nothing\nknown\nhere"
            anchor: Any = {"transform": axes.transAxes, "ha": "center", "va": "top", "fontsize": 8.0, "color": MUTED}
            axes.text(place, 0.97, words, bbox=plate, **anchor)


def _limit(axes: Axes, model: Array, margin: float) -> None:
    axes.set_ylim(float(model.min()) - margin, float(model.max()) + margin)


def _decibel(response: ComplexArray | Array) -> Array:
    return np.asarray(20 * np.log10(np.maximum(np.abs(response), 1e-12)))


def _phase_near(bode: BodeData, frequency_hz: Array, response: ComplexArray) -> Array:
    """Return phases [°] on the same turn as the model's: unwrapping noisy phases by themselves slips."""
    model = np.degrees(np.interp(frequency_hz, bode.frequency_hz, np.unwrap(np.angle(bode.response))))
    measured = np.degrees(np.angle(response))
    return np.asarray(measured + 360 * np.round((model - measured) / 360))
