"""Poles of an identified axis with their uncertainty, in the z plane and as frequency and damping."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Wedge
from numpy.typing import NDArray

from archerfish.figures.bode import label_unknown, shade_bands
from archerfish.figures.frame import frame_axes
from archerfish.figures.style import BLUE, GREEN, MUTED, VERMILLION, label_axes, label_log_axis, new_figure, plot_style

Poles = NDArray[np.complex128]


class PoleMap(NamedTuple):
    """Poles of a plant and of its posterior draws."""

    poles: Poles
    """In the z plane, shape (n,)."""
    drawn: Poles
    """Of the draws, shape (k, n); k may be 0."""
    determined: NDArray[np.bool_]
    """Whether the recordings determine each pole, shape (n,)."""
    sample_period_s: float
    """Sampling period [s]."""
    excited_hz: tuple[float, float]
    """Frequencies that the inputs excite [Hz]."""


def pole_figure(poles: PoleMap) -> Figure:
    """Draw the poles: a cross where they are determined, a hollow circle where they are not, draws as dots."""
    with plot_style():
        figure, axes = new_figure(1, 2, height=3.8, layout=None, width_ratios=(1, 1.35))
        _draw_plane(axes[0, 0], poles)
        _draw_damping(axes[0, 1], poles)
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="lower center", ncols=3)
        frame_axes(figure, axes)
    return figure


def _draw_plane(axes: Axes, poles: PoleMap) -> None:
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 361))
    axes.plot(circle.real, circle.imag, color=MUTED, linewidth=0.8)
    low, high = (min(360.0 * edge * poles.sample_period_s, 180.0) for edge in poles.excited_hz)
    for start, stop in ((low, high), (-high, -low)):
        axes.add_patch(Wedge((0, 0), 1.0, start, stop, color=GREEN, alpha=0.15, linewidth=0))
    _draw_points(axes, poles, poles.poles.real, poles.poles.imag, poles.drawn.real, poles.drawn.imag)
    axes.set_aspect("equal")
    axes.set_xlim(-1.1, 1.1)
    axes.set_ylim(-1.1, 1.1)
    label_axes(axes, title="z plane", x="Real part", y="Imaginary part")


def _draw_damping(axes: Axes, poles: PoleMap) -> None:
    kept = (poles.poles.imag >= 0) & (np.abs(poles.poles) > 1e-6)
    frequency, damping = _frequency_and_damping(poles.poles[kept], poles.sample_period_s)
    drawn = _frequency_and_damping(poles.drawn[:, kept], poles.sample_period_s)
    picked = poles._replace(determined=poles.determined[kept])
    _draw_points(axes, picked, frequency, damping, *drawn)
    nyquist = 0.5 / poles.sample_period_s
    edges = [*frequency, *poles.excited_hz, nyquist]
    axes.set_xscale("log")
    axes.set_xlim(0.6 * max(min(edges), 1e-4 * nyquist), 1.6 * max(edges))
    label_log_axis(axes)
    axes.set_ylim(-0.05, 1.3)  # room above the real poles for words
    shade_bands(axes, poles.excited_hz)
    label_unknown(axes, poles.excited_hz)
    label_axes(axes, title="Frequency and damping", x="Natural frequency [Hz]", y="Damping ratio")


def _draw_points(axes: Axes, poles: PoleMap, x: Any, y: Any, drawn_x: Any, drawn_y: Any) -> None:
    dots: Any = {"color": BLUE, "linestyle": "none", "marker": ".", "markersize": 3.0, "alpha": 0.35, "mew": 0}
    if drawn_x.size:
        axes.plot(drawn_x.ravel(), drawn_y.ravel(), label="posterior draws", **dots)
    known, guess = poles.determined, ~poles.determined
    cross: Any = {"color": VERMILLION, "linestyle": "none", "markersize": 7.0, "markeredgewidth": 1.8}
    if known.any():
        axes.plot(x[known], y[known], marker="x", label="pole", **cross)
    if guess.any():
        axes.plot(x[guess], y[guess], marker="o", fillstyle="none", label="not determined", **cross)


def _frequency_and_damping(poles: Poles, sample_period_s: float) -> tuple[Any, Any]:
    """Return |ln z| / 2π Ts [Hz] and −Re ln z / |ln z| of poles of the z plane."""
    # A draw may come to lie at zero, a pure delay: far right, and no warning.
    s = np.log(np.where(np.abs(poles) > 1e-9, poles, 1e-9))
    size = np.maximum(np.abs(s), 1e-12)
    return size / (2 * np.pi * sample_period_s), -s.real / size
