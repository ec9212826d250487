"""Picture of an identified sensing: misfit over offset, residuals over time, and their histogram."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.style import BLUE, INK, MUTED, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]

_AROUND = 0.25


class AlignmentData(NamedTuple):
    """Detections of a plate at rest beside the gimbal's log."""

    offset: Array
    """Time offsets that were tried [s], shape (M,)."""
    misfit: Array
    """Scatter of the plate's bearing at each [rad], shape (M,)."""
    best: float
    """The offset that was found [s]."""
    moment: Array
    """Moments of the detections [s], shape (K,)."""
    bearing: Array
    """Measured less modelled bearing [rad], shape (K,)."""
    distance: Array
    """Measured less modelled distance [m], shape (K,)."""
    inlier: NDArray[np.bool_]
    """Detections of the plate, shape (K,)."""
    bearing_sd: float
    """Estimated noise of the bearing [rad]."""
    range_sd: float
    """Estimated noise of the distance [m]."""


def sensing_figure(data: AlignmentData, *, title: str = "Sensing") -> Figure:
    """Draw the misfit over the time offset, and the residuals of bearing and distance over time and as histograms."""
    with plot_style():
        figure, axes = new_figure(2, 2, width=10.0, height=6.0)
        _draw_scan(axes[0, 0], data, title)
        _draw_residuals(axes[0, 1], data)
        _draw_histogram(axes[1, 0], 1e3 * data.bearing[data.inlier], 1e3 * data.bearing_sd, "Bearing [mrad]")
        _draw_histogram(axes[1, 1], 1e3 * data.distance[data.inlier], 1e3 * data.range_sd, "Distance [mm]")
    return figure


def alignment_figure(data: AlignmentData) -> Figure:
    """Draw the misfit over the time offset, and the bearing's residual over time; see `sensing_figure`."""
    with plot_style():
        figure, axes = new_figure(1, 2, width=10.0, height=3.2)
        _draw_scan(axes[0, 0], data, "Search")
        _draw_residuals(axes[0, 1], data)
    return figure


def _draw_scan(axes: Axes, data: AlignmentData, title: str) -> None:
    near = np.abs(data.offset - data.best) <= _AROUND
    axes.plot(1e3 * data.offset[near], 1e3 * data.misfit[near], color=BLUE)
    axes.axvline(1e3 * data.best, color=VERMILLION, linestyle=(0, (4, 1.5)), label=f"{1e3 * data.best:.2f} ms")
    axes.legend(loc="best")
    label_axes(axes, title=f"{title}: alignment", x="Time offset [ms]", y="Scatter of the bearing [mrad]")


def _draw_residuals(axes: Axes, data: AlignmentData) -> None:
    dots: Any = {"linestyle": "none", "marker": ".", "markersize": 3.0}
    time, residual = data.moment - data.moment[0], 1e3 * data.bearing
    axes.plot(time[data.inlier], residual[data.inlier], color=INK, label="plate", **dots)
    # What is far off would hide the rest; it is drawn at the edge.
    edge = 6e3 * max(float(data.bearing[data.inlier].std()), 1e-9)
    away = ~data.inlier
    if away.any():
        crosses: Any = {"linestyle": "none", "marker": "x", "markersize": 4.0}
        axes.plot(time[away], np.clip(residual[away], -edge, edge), color=VERMILLION, label="not the plate", **crosses)
    axes.set_ylim(-1.1 * edge, 1.5 * edge)
    axes.legend(loc="upper right", ncols=2)
    label_axes(axes, title="Bearing, measured − model", x="Time [s]", y="Residual [mrad]")


def _draw_histogram(axes: Axes, residual: Array, sd: float, label: str) -> None:
    reach = 4 * max(float(residual.std()), 1e-9)
    _, edges, _ = axes.hist(residual, bins=40, range=(-reach, reach), color=MUTED, alpha=0.6, label="residuals")
    at = np.linspace(-reach, reach, 200)
    expected = residual.size * (edges[1] - edges[0]) / (max(sd, 1e-9) * np.sqrt(2 * np.pi))
    axes.plot(at, expected * np.exp(-0.5 * (at / max(sd, 1e-9)) ** 2), color=VERMILLION, label="noise at standstill")
    axes.legend(loc="upper right")
    label_axes(axes, x=label, y="Detections")
