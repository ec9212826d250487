"""Hit rates from the simulator to the robot: a sloping line per controller and range."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from archerfish.figures.style import INK, MARKERS, PALETTE, label_axes, new_figure, plot_style

_SPREAD, _DODGE = 0.3, 0.022
"""Distance between worlds, and sideways shift between controllers, so that intervals don't hide each other [ranges]."""
_LONGEST = 10
"""Names of worlds up to so many letters stand level beside one another."""


class Slope(NamedTuple):
    """One controller's hit rates over ranges and worlds; where one was not measured, NaN."""

    label: str
    """Name for the legend."""
    style: int
    """Index into the palette: the same controller looks alike in all figures."""
    rate_percent: Sequence[Sequence[float]]
    """Hit rates [%], shape (R, W)."""
    low_percent: Sequence[Sequence[float]]
    """Lower ends of the 95 % intervals [%], shape (R, W)."""
    high_percent: Sequence[Sequence[float]]
    """Upper ends [%], shape (R, W)."""


class SlopePanel(NamedTuple):
    """One kind of target."""

    title: str
    """Above the panel."""
    ranges: Sequence[str]
    """Names of the R ranges."""
    slopes: Sequence[Slope]
    """Controllers; the first is drawn boldest."""


def transfer_figure(panels: Sequence[SlopePanel], worlds: Sequence[str]) -> Figure:
    """Draw kinds of target below each other, in each a group of worlds per range, one legend below all.

    Args:
      panels: at least one.
      worlds: names of the W worlds, the simulator first.
    """
    with plot_style():
        figure, axes = new_figure(len(panels), 1, height=0.9 + 3.1 * len(panels))
        for panel, place in zip(panels, axes[:, 0], strict=True):
            _draw_panel(place, panel, worlds)
            label_axes(place, title=panel.title, y="Hit rate [%]")
        handles = {
            label: handle
            for each in axes[:, 0]
            for handle, label in zip(*each.get_legend_handles_labels(), strict=True)
        }
        order = list(dict.fromkeys(slope.label for panel in panels for slope in panel.slopes))
        figure.legend([handles[each] for each in order], order, loc="outside lower center", ncols=min(3, len(order)))
    return figure


def _draw_panel(axes: Axes, panel: SlopePanel, worlds: Sequence[str]) -> None:
    offsets = _SPREAD * (np.arange(len(worlds)) - (len(worlds) - 1) / 2)
    # The last is drawn first, so that the first lies on top.
    for index, slope in reversed(list(enumerate(panel.slopes))):
        shift = _DODGE * (index - (len(panel.slopes) - 1) / 2)
        for number, _ in enumerate(panel.ranges):
            _draw_slope(axes, slope, number, number + offsets + shift, bold=index == 0)
    for edge in range(1, len(panel.ranges)):
        axes.axvline(edge - 0.5, color="#C9CED3", linewidth=0.8)
    ticks = [
        (number + offset, world)
        for number in range(len(panel.ranges))
        for offset, world in zip(offsets, worlds, strict=True)
    ]
    axes.set_xticks([place for place, _ in ticks], [world for _, world in ticks], fontsize=7.5)
    level = max(map(len, worlds)) <= _LONGEST
    if not level:
        axes.tick_params(axis="x", labelrotation=25)
    axes.set_xlim(-0.5, len(panel.ranges) - 0.5)
    axes.grid(visible=False, axis="x")
    for number, name in enumerate(panel.ranges):
        place = axes.get_xaxis_transform()
        axes.text(number, -0.11 if level else -0.24, f"{name} m", transform=place, ha="center", va="top", color=INK)


def _draw_slope(axes: Axes, slope: Slope, number: int, places: Any, *, bold: bool) -> None:
    rate = np.asarray(slope.rate_percent[number], dtype=np.float64)
    spread = np.stack([rate - slope.low_percent[number], slope.high_percent[number] - rate])
    axes.errorbar(
        places,
        rate,
        yerr=spread,
        color=PALETTE[slope.style],
        marker=MARKERS[slope.style],
        markersize=4.5 if bold else 3.5,
        linewidth=1.8 if bold else 1.0,
        elinewidth=0.8,
        label=slope.label if number == 0 else None,
    )
