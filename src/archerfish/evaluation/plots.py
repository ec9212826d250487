"""Hit rate against range: a curve with 95 % intervals per controller, a panel per motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from archerfish.evaluation.tables import FEW, bounds, by_controller, grouped, mean, range_text
from archerfish.reports.style import MUTED, look, new_figure, plot_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from archerfish.evaluation.results import Cell

_SPREAD = 0.6
"""Width over which the controllers of a range are set side by side, so that their intervals don't hide each other."""


def hit_rates(cells: Sequence[Cell], *, names: Sequence[str] = ()) -> Figure:
    """Draw hit rate against range, a panel for each world, command limit, length and motion.

    A controller has one look in all panels; the mean of its trainings is drawn. Hollow markers are the paper's figures,
    grey lines the bounds.

    Args:
      cells: at least one.
      names: of controllers, in the order of their looks, where several figures are to agree.
    """
    panels = grouped(cells, lambda cell: (*cell.place, cell.motion))
    looks = {name: look(place) for place, name in enumerate(names or by_controller(cells))}
    across = min(len(panels), FEW if len({cell.motion for cell in cells}) <= FEW else 4)
    down = -(-len(panels) // across)
    height = 2.7 * down + 0.5 + 0.06 * len(looks)  # the legend has four names in a row
    with plot_style():
        figure, axes = new_figure(down, across, width=7.2 if across <= FEW else 10.0, height=height, sharey="row")
        handles: dict[str, Any] = {}
        for panel, (key, own) in zip(axes.flat, panels.items(), strict=False):
            handles |= _draw(panel, own, looks)
            panel.set_title(_title(key, list(panels)))
            panel.set_xlabel("distance [m]")
        for first in axes[:, 0]:
            first.set_ylabel("hit rate [%]")
        for unused in axes.flat[len(panels) :]:
            unused.set_visible(False)
        named = sorted(handles, key=lambda name: list(looks).index(name) if name in looks else len(looks))
        figure.legend([handles[name] for name in named], named, loc="outside lower center", ncols=4, handlelength=3)
    return figure


def trajectory(times: Any, target: Any, commands: Any, angles: Any, miss: Any, hit: Any) -> Figure:
    """Draw one engagement against time: yaw and pitch of target, command and gimbal, and the miss of each shot.

    Args:
      times: when the shots leave [s], shape (T,).
      target: pitch and yaw of its line of sight then [°], shape (T, 2).
      commands: in force until then [°], shape (T, 2).
      angles: of the gimbal then [°], shape (T, 2).
      miss: left and up [m], NaN without pellet, shape (T, 2).
      hit: whether each shot hit, shape (T,).
    """
    with plot_style():
        figure, axes = new_figure(3, 1, width=7.2, height=6.5, sharex=True)
        curves = {"line of sight": target, "command": commands, "gimbal": angles}
        for panel, axis, name in ((axes[0, 0], 1, "yaw"), (axes[1, 0], 0, "pitch")):
            for place, (label, values) in enumerate(curves.items()):
                panel.plot(times, values[:, axis], **{**look(place), "marker": ""}, label=label)
            panel.set_ylabel(f"{name} [°]")
        axes[0, 0].legend(ncols=3)
        distance = 1e3 * (miss**2).sum(-1) ** 0.5
        for chosen, label, place in ((hit, "hit", 0), (~hit, "miss", 1)):
            axes[2, 0].plot(times[chosen], distance[chosen], **{**look(place), "linestyle": ""}, label=label)
        axes[2, 0].set(xlabel="time [s]", ylabel="miss [mm]")
        axes[2, 0].legend(ncols=2)
    return figure


def _title(key: tuple[Any, ...], keys: list[tuple[Any, ...]]) -> str:
    """Return the motion of a panel, and of world, command limit, length and task what is not the same in all."""
    *place, motion = key
    varying = [part for index, part in enumerate(place) if part and len({other[index] for other in keys}) > 1]
    return ", ".join([motion, *(f"{part:g} s" if isinstance(part, float) else part for part in varying)])


def _draw(axes: Any, cells: list[Cell], looks: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Draw one panel and return what its legend names."""
    ranges, controllers = sorted({cell.range_m for cell in cells}), by_controller(cells)
    handles: dict[str, Any] = {}
    for index, (name, own) in enumerate(controllers.items()):
        shift = _SPREAD * ((index + 0.5) / len(controllers) - 0.5)
        places, values, below, above = [], [], [], []
        for place, range_m in enumerate(ranges):
            if estimate := mean([cell for cell in own if cell.range_m == range_m]):
                places.append(place + shift)
                values.append(estimate.value)
                below.append(estimate.value - estimate.low)
                above.append(estimate.high - estimate.value)
        handles[name] = axes.errorbar(places, values, yerr=(below, above), **looks[name], capsize=2, elinewidth=0.9)
        paper = {ranges.index(cell.range_m) + shift: cell.paper for cell in own if cell.paper is not None}
        if paper:
            hollow = {**looks[name], "linestyle": "", "markerfacecolor": "white"}
            axes.plot(list(paper), list(paper.values()), **hollow)
            handles["hollow: the paper"] = axes.plot([], [], **{**hollow, "color": MUTED, "marker": "o"})[0]
    for line, (name, own) in zip((":", "-."), bounds(cells).items(), strict=False):
        bounded = sorted({ranges.index(cell.range_m): 100 * (cell.bound or 0.0) for cell in own}.items())
        handles[name] = axes.plot(*zip(*bounded, strict=True), color=MUTED, linestyle=line)[0]
    named = list(enumerate(map(range_text, ranges)))[:: 1 + len(ranges) // 10]  # more would overlap
    axes.set_xticks(*zip(*named, strict=True))
    axes.grid(visible=False, axis="x")
    return handles
