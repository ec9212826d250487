"""Picture of an identified muzzle: where the shots of each setting went, beside where the model puts them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.style import INK, MUTED, SKY, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]

_MOST_LABELS = 12
_HALF_WIDTH = 0.36
"""Of a setting's bar, in settings."""
_MARGIN = 1.15


class ShotGroups(NamedTuple):
    """N shots at G settings beside the model."""

    setting: NDArray[np.intp]
    """Number of each shot's setting, from 0, shape (N,)."""
    names: Sequence[str]
    """Name of each setting, G of them."""
    measured: Array
    """Landing distances or heights of the hits [m], shape (N,)."""
    expected: Array
    """The same by the model [m], shape (N,)."""
    expected_sd: Array
    """Their standard deviations by the model [m], shape (N,)."""
    kept: NDArray[np.bool_]
    """Which shots were used; the others are outliers, shape (N,)."""


def shots_figure(groups: ShotGroups, *, title: str = "Landing distances", quantity: str = "Distance") -> Figure:
    """Draw the shots of each setting over the model's mean and ± 2 standard deviations, and what is left of them.

    Outliers are crosses; in the right picture those beyond its range stand at its edge.

    Args:
      groups: the shots, N ≥ 1.
      title: of the left picture.
      quantity: what was measured, for the labels.
    """
    with plot_style():
        figure, axes = new_figure(1, 2, width=10.0, height=3.9)
        where, residual = axes[0, 0], axes[0, 1]
        place = _beside_each_other(groups)
        _draw_bars(where, groups, *_spans(groups))
        _draw_dots(where, place, groups.measured, groups.kept)
        label_axes(where, title=title, x="Setting", y=f"{quantity} [m]")
        left = 100 * (groups.measured - groups.expected)
        sd = _of_settings(groups, 100 * groups.expected_sd)
        _draw_bars(residual, groups, 0 * sd, 2 * sd)
        edge = _MARGIN * max(float(np.abs(left[groups.kept]).max(initial=0.0)), 2 * float(sd.max()), 1e-6)
        residual.set_ylim(-edge, edge)
        _draw_dots(residual, place, np.clip(left, -edge, edge), groups.kept)
        label_axes(residual, title="Measured − model", x="Setting", y=f"{quantity} [cm]")
        handles, labels = where.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _of_settings(groups: ShotGroups, values: Array) -> Array:
    """Mean of each setting, shape (G,)."""
    return np.asarray(np.bincount(groups.setting, values) / np.bincount(groups.setting))


def _spans(groups: ShotGroups) -> tuple[Array, Array]:
    """Middle and half height of each setting's bar, shape (G,) each; with measured speeds each shot has a mean."""
    middle = _of_settings(groups, groups.expected)
    moved = _of_settings(groups, (groups.expected - middle[groups.setting]) ** 2)
    return middle, 2 * np.sqrt(moved + _of_settings(groups, groups.expected_sd**2))


def _beside_each_other(groups: ShotGroups) -> Array:
    """Spread the shots of a setting over the width of its bar in the order of fire, shape (N,)."""
    place = groups.setting.astype(float)
    for group in range(len(groups.names)):
        shots = np.flatnonzero(groups.setting == group)
        if shots.size > 1:
            place[shots] += np.linspace(-1, 1, shots.size) * 0.8 * _HALF_WIDTH
    return place


def _draw_bars(axes: Axes, groups: ShotGroups, middle: Array, half: Array) -> None:
    position = np.arange(len(groups.names))
    axes.bar(position, 2 * half, 2 * _HALF_WIDTH, middle - half, color=SKY, alpha=0.35, label="model ± 2 sd")
    axes.hlines(
        middle, position - _HALF_WIDTH, position + _HALF_WIDTH, color=VERMILLION, linewidth=1.8, label="model mean"
    )
    shown = position[:: max(1, -(-position.size // _MOST_LABELS))]
    axes.set_xticks(shown, [groups.names[index] for index in shown])
    axes.grid(visible=False, axis="x")
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=0.5)
    # A bar would hold the axes to its foot, where its own edge hides.
    axes.use_sticky_edges = False
    axes.margins(x=0.02)


def _draw_dots(axes: Axes, place: Array, value: Array, kept: NDArray[np.bool_]) -> None:
    axes.plot(place[kept], value[kept], color=INK, linestyle="none", marker="o", markersize=3.0, label="measured")
    if not kept.all():
        cross: Any = {"linestyle": "none", "marker": "X", "markersize": 7.0, "markeredgecolor": "white"}
        axes.plot(place[~kept], value[~kept], color=VERMILLION, clip_on=False, label="left out", **cross)
