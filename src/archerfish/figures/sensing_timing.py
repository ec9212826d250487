"""Pictures of what a sensing record's times rest on: the plate over the yaw, receipts, commands and noise."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.style import BLUE, GREEN, INK, MUTED, SKY, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]
Interval = tuple[float, float]

_CLOSE_S = 1.0
"""Length of the stretch that is drawn large [s]."""
_BINS = 40


class Overlay(NamedTuple):
    """The gimbal's yaw and what the camera saw of it."""

    time: Array
    """Moments of the gimbal's samples [s], shape (N,)."""
    yaw: Array
    """[rad], shape (N,)."""
    moment: Array
    """Moments of the detections, aligned [s], shape (K,)."""
    mirrored: Array
    """Yaw that the plate's bearing tells [rad], shape (K,)."""
    inlier: NDArray[np.bool_]
    """Detections of the plate, shape (K,)."""


class Spread(NamedTuple):
    """A set of measured times."""

    values: Array
    """[s], shape (K,)."""
    mean: float
    """What was estimated [s]."""
    interval: Interval | None
    """Its 95 % interval [s]."""
    title: str
    """What they are."""
    label: str
    """Of the axis, with the unit ms."""


class Noise(NamedTuple):
    """The residuals of one direction."""

    values: Array
    """In the unit of the label, shape (K,)."""
    sd: float
    """The estimated noise, in that unit."""
    title: str
    """Which direction."""
    label: str
    """Of the axis, with its unit."""


def overlay_figure(data: Overlay) -> Figure:
    """Draw the yaw with the detections laid over it, whole and where the gimbal turned fastest."""
    with plot_style():
        figure, axes = new_figure(1, 2, width=10.0, height=3.4, width_ratios=(3, 2))
        start = data.moment[0]
        fastest = data.time[int(np.argmax(np.abs(np.gradient(data.yaw, data.time))))]
        _draw_overlay(axes[0, 0], data, start, 2.0)
        label_axes(axes[0, 0], title="Whole sweep", x="Time [s]", y="Yaw [°]")
        _draw_overlay(axes[0, 1], data, start, 4.0)
        low = float(np.clip(fastest - 0.5 * _CLOSE_S, start, max(start, data.moment[-1] - _CLOSE_S))) - start
        axes[0, 1].set_xlim(low, low + _CLOSE_S)
        label_axes(axes[0, 1], title="Where it turned fastest", x="Time [s]")
        figure.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _draw_overlay(axes: Axes, data: Overlay, start: float, size: float) -> None:
    axes.plot(data.time - start, np.degrees(data.yaw), color=BLUE, linewidth=1.2, label="gimbal's log")
    dots: Any = {"linestyle": "none", "marker": ".", "markersize": size, "color": INK}
    moment, mirrored = data.moment[data.inlier] - start, data.mirrored[data.inlier]
    axes.plot(moment, np.degrees(mirrored), label="camera's frames, shifted", **dots)


def times_figure(spreads: list[Spread]) -> Figure:
    """Draw histograms of times, each with its estimate and the estimate's interval."""
    with plot_style():
        figure, _ = new_figure(1, max(2, len(spreads)), width=10.0, height=3.0)
        for place, spread in zip(figure.axes, spreads, strict=False):
            values = 1e3 * spread.values
            bins = min(_BINS, max(6, int(np.sqrt(values.size) * 1.5)))
            place.hist(values, bins=bins, color=SKY, alpha=0.7, label=f"{values.size} measured")
            if spread.interval is not None:
                place.axvspan(1e3 * spread.interval[0], 1e3 * spread.interval[1], color=GREEN, alpha=0.25, linewidth=0)
            mean = 1e3 * spread.mean
            place.axvline(mean, color=VERMILLION, linestyle=(0, (4, 1.5)), label=f"{mean:.1f} ms")
            place.legend(loc="best")
            label_axes(place, title=spread.title, x=spread.label, y="Count")
        for place in figure.axes[len(spreads) :]:
            place.set_axis_off()
    return figure


def noise_figure(noises: list[Noise]) -> Figure:
    """Draw histograms of the residuals, with the noise that was estimated from them."""
    with plot_style():
        figure, axes = new_figure(1, len(noises), width=10.0, height=3.0)
        for place, noise in zip(figure.axes, noises, strict=True):
            reach, sd = 4 * max(float(noise.values.std()), 1e-12), max(noise.sd, 1e-12)
            _, edges, _ = place.hist(noise.values, bins=_BINS, range=(-reach, reach), color=MUTED, alpha=0.6)
            at = np.linspace(-reach, reach, 200)
            expected = noise.values.size * (edges[1] - edges[0]) / (sd * np.sqrt(2 * np.pi))
            place.plot(at, expected * np.exp(-0.5 * (at / sd) ** 2), color=VERMILLION, label="noise at standstill")
            label_axes(place, title=noise.title, x=noise.label, y="Detections" if place is axes[0, 0] else "")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center")
    return figure
