"""Hit rate against what a sweep varied: a panel per parameter, a point with its interval per configuration."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from archerfish.figures.style import MARKERS, PALETTE, label_axes, new_figure, plot_style

_COLUMNS = 3
_FEW = 9
"""Fewer values than this that points share get a place each, like words."""
_SPREAD = 0.6
"""Room that points of one place share [places]."""
_MOST_CURVES = len(PALETTE)


class SweepPoint(NamedTuple):
    """One configuration in one world, or one training."""

    world: str
    """World: each has a colour."""
    values: Sequence[object]
    """Value of each parameter."""
    rate_percent: float
    """Hit rate [%]."""
    low_percent: float
    """Lower end of its 95 % interval [%]."""
    high_percent: float
    """Upper end [%]."""
    best: bool
    """Whether it is the best of its world."""


def sweep_figure(names: Sequence[str], points: Sequence[SweepPoint]) -> Figure:
    """Draw the hit rates of a sweep; the best of each world is filled, the others are hollow.

    Args:
      names: of the parameters, at least one.
      points: values in the order of `names`.
    """
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    with plot_style():
        figure, grid = new_figure(rows, columns, height=0.7 + 2.5 * rows, sharey=True)
        panels: list[Any] = list(grid.flat)
        for index, name in enumerate(names):
            _draw_panel(panels[index], [point.values[index] for point in points], points)
            label_axes(panels[index], x=name, y="Hit rate [%]" if index % columns == 0 else "")
        for empty in panels[len(names) :]:
            empty.set_visible(False)
        handles, labels = panels[0].get_legend_handles_labels()
        # No legend holds more worlds than there are colours.
        if 1 < len(labels) <= _MOST_CURVES:
            figure.legend(handles, labels, loc="outside lower center", ncols=min(2, len(labels)))
    return figure


def _draw_panel(axes: Axes, values: Sequence[object], points: Sequence[SweepPoint]) -> None:
    places = _places(axes, values)
    worlds = list(dict.fromkeys(point.world for point in points))
    for number, world in enumerate(worlds):
        here = [index for index, point in enumerate(points) if point.world == world]
        for index in here:
            point = points[index]
            axes.errorbar(
                places[index],
                point.rate_percent,
                yerr=[[point.rate_percent - point.low_percent], [point.high_percent - point.rate_percent]],
                color=PALETTE[number % len(PALETTE)],
                marker=MARKERS[number % len(MARKERS)],
                markerfacecolor=PALETTE[number % len(PALETTE)] if point.best else "white",
                markersize=7.0 if point.best else 5.0,
                linestyle="none",
                elinewidth=1.0,
                capsize=2.5,
                label=world if index == here[0] else None,
            )


def _places(axes: Axes, values: Sequence[object]) -> list[float]:
    """Set up the horizontal axis, and return where each value lies on it."""
    numbers = [float(each) for each in values if isinstance(each, int | float) and not isinstance(each, bool)]
    words = len(numbers) < len(values)
    distinct: list[Any] = sorted(set(values), key=_word if words else float)
    if words or len(distinct) < min(len(values), _FEW):
        axes.set_xticks(np.arange(len(distinct)), [_word(each) for each in distinct])
        axes.set_xlim(-0.5, len(distinct) - 0.5)
        axes.grid(visible=False, axis="x")
        return _side_by_side([distinct.index(each) for each in values])
    # What spans more than a factor of five is looked at by its logarithm.
    if min(numbers) > 0 and max(numbers) > 5 * min(numbers):
        axes.set_xscale("log")
    else:
        axes.xaxis.set_major_locator(MaxNLocator(4))
    return numbers


def _side_by_side(places: Sequence[int]) -> list[float]:
    """Move points of one place apart, so that their intervals don't hide each other."""
    found = []
    for index, place in enumerate(places):
        count, before = places.count(place), places[:index].count(place)
        found.append(place + _SPREAD * ((before + 0.5) / count - 0.5))
    return found


def _word(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
