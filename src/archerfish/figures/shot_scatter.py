"""Picture of where shots went, setting by setting, with the ellipse in which the model puts 95 % of them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from numpy.typing import NDArray

from archerfish.figures.style import INK, SKY, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]

_MOST_PANELS = 9
_COLUMNS = 3
_RADII = float(np.sqrt(-2 * np.log(0.05)))
"""Standard deviations from the middle of a two-dimensional normal that hold 95 % of it."""
_MARGIN = 1.25
_ALIKE = 3.0
"""Ratio of height and width up to which both are drawn to one scale; landing points scatter mostly ahead."""


class ScatterPanel(NamedTuple):
    """The shots of one setting, N of them."""

    name: str
    """Name of the setting."""
    lateral: Array
    """How far left [m], shape (N,)."""
    ahead: Array
    """Landing distance, or height of the hit [m], shape (N,)."""
    kept: NDArray[np.bool_]
    """Which shots were used, shape (N,)."""
    middle: tuple[float, float]
    """Where the model puts them on average: lateral, ahead [m]."""
    sd: tuple[float, float]
    """Their standard deviations by the model [m]."""


def scatter_figure(panels: Sequence[ScatterPanel], *, quantity: str = "Distance") -> Figure:
    """Draw the shots of each setting as seen by the shooter, left to the left; what was left out as crosses.

    Shots outside a picture stand at its edge. All pictures have the same scales, about the model's middle.

    Args:
      panels: the settings; the first nine are drawn.
      quantity: what is drawn upwards, for the labels.
    """
    shown = panels[:_MOST_PANELS]
    rows = -(-len(shown) // _COLUMNS)
    with plot_style():
        figure, _ = new_figure(rows, _COLUMNS, width=10.0, height=0.9 + 2.7 * rows)
        reach = np.max([_reach(panel) for panel in shown], axis=0)
        if reach.max() < _ALIKE * reach.min():
            reach = np.full(2, reach.max())
        for place, panel in zip(figure.axes, shown, strict=False):
            _draw(place, panel, reach)
            label_axes(place, title=panel.name, x="Left − model [cm]", y=f"{quantity} − model [cm]")
        for place in figure.axes[len(shown) :]:
            place.set_axis_off()
        # Only a setting that lost shots has the crosses.
        drawn = [pair for place in figure.axes for pair in zip(*place.get_legend_handles_labels(), strict=True)]
        entries = {label: handle for handle, label in drawn}
        figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=4)
    return figure


def _reach(panel: ScatterPanel) -> tuple[float, float]:
    """Half width and half height of a picture that holds the ellipse and the shots that were used [cm]."""
    found = []
    for values, middle, sd in zip((panel.lateral, panel.ahead), panel.middle, panel.sd, strict=True):
        furthest = float(np.abs(values[panel.kept] - middle).max(initial=0.0))
        found.append(_MARGIN * 100 * max(_RADII * sd, furthest, 1e-6))
    return found[0], found[1]


def _draw(axes: Axes, panel: ScatterPanel, reach: Array) -> None:
    left, ahead = 100 * (panel.lateral - panel.middle[0]), 100 * (panel.ahead - panel.middle[1])
    width, height = (2 * _RADII * 100 * each for each in panel.sd)
    axes.add_patch(Ellipse((0, 0), width, height, color=SKY, alpha=0.35, linewidth=0, label="model, 95 % of shots"))
    axes.plot(0, 0, color=VERMILLION, marker="+", markersize=10, linestyle="none", label="model, middle")
    dots: Any = {"linestyle": "none", "marker": "o", "markersize": 3.5, "color": INK}
    axes.plot(left[panel.kept], ahead[panel.kept], label="shot", **dots)
    gone = ~panel.kept
    if gone.any():
        cross: Any = {"linestyle": "none", "marker": "X", "markersize": 7.5, "markeredgecolor": "white"}
        held = [np.clip(each[gone], -far, far) for each, far in zip((left, ahead), reach, strict=True)]
        axes.plot(*held, color=VERMILLION, clip_on=False, label="left out (at the edge if beyond)", **cross)
    axes.set_xlim(reach[0], -reach[0])
    axes.set_ylim(-reach[1], reach[1])
    if reach[0] == reach[1]:
        axes.set_aspect("equal")
