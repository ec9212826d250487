"""Hit rate against range, a curve with intervals per controller."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from archerfish.figures.style import MARKERS, PALETTE, label_axes, new_figure, plot_style

_DODGE = 0.07
"""Sideways shift between controllers, so that their intervals don't hide each other [bins]."""


class RateCurve(NamedTuple):
    """One controller's hit rates over the ranges of a panel; where a range was not measured, NaN."""

    label: str
    """Name for the legend."""
    style: int
    """Index into the palette: the same controller looks alike in all figures."""
    rate_percent: Sequence[float]
    """Hit rates [%], shape (R,)."""
    low_percent: Sequence[float] | None = None
    """Lower ends of the 95 % intervals [%], shape (R,); None for printed figures, which come without."""
    high_percent: Sequence[float] | None = None
    """Upper ends [%], shape (R,)."""


class RatePanel(NamedTuple):
    """One kind of target."""

    title: str
    """Above the panel."""
    ranges: Sequence[str]
    """Names of the R ranges."""
    curves: Sequence[RateCurve]
    """Controllers, and the paper's columns."""


def hit_rate_figure(panels: Sequence[RatePanel], *, height: float = 3.7, columns: int | None = None) -> Figure:
    """Draw kinds of target side by side on one scale, with one legend below.

    Printed figures are dashed with hollow markers.

    Args:
      panels: at least one.
      height: of the figure [inch].
      columns: of panels; as many as there are panels if not given.
    """
    across = len(panels) if columns is None else columns
    down = -(-len(panels) // across)
    with plot_style():
        figure, axes = new_figure(down, across, height=height, sharey=True)
        places: list[Axes] = list(axes.ravel())
        for index, panel in enumerate(panels):
            _draw_panel(places[index], panel)
            x, y = "Range [m]" if index >= len(panels) - across else "", "Hit rate [%]" if index % across == 0 else ""
            label_axes(places[index], title=panel.title, x=x, y=y)
        axes[0, 0].set_ylim(top=101.0)
        handles = {
            label: handle for each in places for handle, label in zip(*each.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=min(4, len(handles)))
    return figure


def _draw_panel(axes: Axes, panel: RatePanel) -> None:
    places = np.arange(len(panel.ranges))
    measured = [curve for curve in panel.curves if curve.low_percent is not None]
    for curve in panel.curves:
        style: Any = {"color": PALETTE[curve.style], "marker": MARKERS[curve.style], "label": curve.label}
        if curve.low_percent is None or curve.high_percent is None:
            axes.plot(
                places, curve.rate_percent, **style, linestyle=(0, (2, 2)), linewidth=1.1, markerfacecolor="white"
            )
            continue
        shift = _DODGE * (measured.index(curve) - (len(measured) - 1) / 2)
        rate = np.asarray(curve.rate_percent)
        spread = np.stack([rate - curve.low_percent, curve.high_percent - rate])
        axes.errorbar(places + shift, rate, yerr=spread, **style, capsize=2.5, elinewidth=1.0)
    axes.set_xticks(places, panel.ranges)
    axes.grid(visible=False, axis="x")
