"""Hit rate against range: a curve with 95 % intervals per controller, a panel per motion."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from archerfish2.evaluation.results import Cell
from archerfish2.evaluation.tables import FEW, bounds, grouped, mean, range_text
from archerfish2.reports.style import MUTED, look, new_figure, plot_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SPREAD = 0.6
"""Width over which the controllers of a range are set side by side, so that their intervals don't hide each other."""


def hit_rates(cells: Sequence[Cell], *, title: str = "") -> "Figure":
    """Draw hit rate against range, a panel for each world, command limit, length and motion.

    A controller has one look in all panels; the mean of its trainings is drawn. Hollow markers are the paper's figures,
    grey lines the bounds.

    Args:
      cells: at least one.
      title: above all.
    """
    panels = grouped(cells, lambda each: (*each.place, each.motion))
    looks = {name: look(place) for place, name in enumerate(grouped(cells, lambda each: each.controller))}
    across = min(len(panels), FEW if len({each.motion for each in cells}) <= FEW else 4)
    down = -(-len(panels) // across)
    lines = -(-(len(looks) + 2) // 4)
    with plot_style():
        size = {"width": 7.2 if across <= FEW else 10.0, "height": 2.6 * down + 0.9 + 0.22 * lines}
        figure, axes = new_figure(down, across, sharey="row", **size)
        handles: dict[str, Any] = {}
        for place, (key, own) in enumerate(panels.items()):
            panel = axes[place // across, place % across]
            handles |= _draw(panel, own, looks)
            varying = [f"{each:g} s" if index == 2 else each for index, each in enumerate(key[:3])
                       if len({other[index] for other in panels}) > 1]
            panel.set_title(", ".join([key[3], *varying]))
            panel.set_ylabel("hit rate [%]" if place % across == 0 else "")
        for unused in axes.ravel()[len(panels) :]:
            unused.set_visible(False)
        figure.suptitle(title)
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=min(4, len(handles)), handlelength=3)
    return figure


def _draw(axes: Any, cells: list[Cell], looks: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Draw one panel and return what its legend names."""
    ranges = sorted({each.range_m for each in cells})
    by_name = grouped(cells, lambda each: each.controller)
    handles: dict[str, Any] = {}
    for line, (name, own) in zip((":", "-."), bounds(cells).items(), strict=False):
        values = {each.range_m: 100 * each.bound for each in own if each.bound is not None}
        places = [place for place, range_m in enumerate(ranges) if range_m in values]
        handles[name] = axes.plot(places, [values[ranges[place]] for place in places], color=MUTED, linestyle=line)[0]
    for index, (name, own) in enumerate(by_name.items()):
        shift = _SPREAD * ((index + 0.5) / len(by_name) - 0.5)
        found = [(place, mean([each for each in own if each.range_m == at])) for place, at in enumerate(ranges)]
        drawn = [(place + shift, each.value, each.value - each.low, each.high - each.value) for place, each in found if each]
        x, y, below, above = zip(*drawn, strict=True)
        handles[name] = axes.errorbar(x, y, yerr=(below, above), **looks[name], capsize=2, elinewidth=0.9)
        printed = {each.range_m: each.paper for each in own if each.paper is not None}
        if printed:
            style = looks[name] | {"linestyle": "", "markerfacecolor": "white"}
            x = [place + shift for place, at in enumerate(ranges) if at in printed]
            axes.plot(x, [printed[at] for at in ranges if at in printed], **style)
    axes.set_xticks(range(len(ranges)), [range_text(at) for at in ranges])
    axes.grid(visible=False, axis="x")
    return handles
