"""What each ingredient is worth: hit rates without it less those with all, with intervals."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from archerfish.figures.style import INK, MARKERS, PALETTE, label_axes, new_figure, plot_style


class Bar(NamedTuple):
    """One variant against the whole; differences of hit rates in points, with the ends of their 95 % intervals."""

    name: str
    """What was changed."""
    all_cells: float
    """Over still and moving targets."""
    all_low: float
    """Lower end."""
    all_high: float
    """Upper end."""
    moving: float
    """Over moving targets alone."""
    moving_low: float
    """Lower end."""
    moving_high: float
    """Upper end."""


def ablation_figure(bars: Sequence[Bar]) -> Figure:
    """Draw a row for each variant, below zero where it hits less than the whole."""
    places = np.arange(len(bars))[::-1]
    with plot_style():
        figure, axes = new_figure(1, 1, height=0.9 + 0.45 * len(bars))
        panel = axes[0, 0]
        panel.axvline(0.0, color=INK, linewidth=0.9)
        for index, (label, part) in enumerate((("all targets", "all"), ("moving targets", "moving"))):
            middle = np.array([each.all_cells if part == "all" else each.moving for each in bars])
            low, high = (np.array([getattr(each, f"{part}_{end}") for each in bars]) for end in ("low", "high"))
            panel.errorbar(
                middle,
                places + 0.12 * (0.5 - index) * 2,
                xerr=np.stack([middle - low, high - middle]),
                color=PALETTE[index],
                marker=MARKERS[index],
                linestyle="none",
                capsize=2.5,
                label=label,
            )
        panel.set_yticks(places, [each.name for each in bars])
        panel.grid(visible=False, axis="y")
        label_axes(panel, x="Hit rate less that of the whole [points], 95 % interval")
        figure.legend(loc="outside lower center", ncols=2)
    return figure
