"""Correlations of a residual with itself and with the inputs, each with the band that a good model keeps."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.frame import frame_axes
from archerfish.figures.style import BLUE, GREEN, MUTED, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]


class CorrelationPanel(NamedTuple):
    """One correlation over lags."""

    title: str
    """With what the residual is correlated."""
    lag: NDArray[np.int64]
    """Lags [samples], shape (L,)."""
    correlation: Array
    """−1…1, shape (L,)."""
    half_width: Array
    """Half width of the 99 % band, shape (L,)."""


def correlation_figure(panels: Sequence[CorrelationPanel]) -> Figure:
    """Draw correlations side by side, those outside their band in another colour.

    Args:
      panels: at least one.
    """
    with plot_style():
        figure, axes = new_figure(1, len(panels), height=2.6, layout=None)
        for place, panel in zip(axes[0], panels, strict=True):
            place.fill_between(panel.lag, -panel.half_width, panel.half_width, color=GREEN, alpha=0.18, linewidth=0)
            outside = np.abs(panel.correlation) > panel.half_width
            for chosen, colour in ((~outside, BLUE), (outside, VERMILLION)):
                place.vlines(panel.lag[chosen], 0.0, panel.correlation[chosen], color=colour, linewidth=1.6)
            reach = max(np.abs(panel.correlation).max(), panel.half_width.max())
            place.set_ylim(-min(1.1 * reach, 1.05), min(1.1 * reach, 1.05))  # a band may be wider than any correlation
            place.axhline(0.0, color=MUTED, linewidth=0.8)
            label_axes(place, title=panel.title, x="Lag [samples]", y="Correlation" if place is axes[0, 0] else "")
        frame_axes(figure, axes)
    return figure
