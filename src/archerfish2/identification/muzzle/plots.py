"""Shots by setting, with the dispersion that the model expects."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from archerfish2.identification.statistics import Array
from archerfish2.reports.style import MUTED, PALETTE, new_figure, plot_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def shots_by_setting(
    setting: NDArray[np.intp], residual: Array, sd: Array, kept: NDArray[np.bool_], *, names: list[str], title: str = ""
) -> "Figure":
    """Draw measured less expected distances or heights, a setting after the other, each in the order of fire.

    Args:
      setting: number of each shot's setting, shape (N,).
      residual: measured less expected [m], shape (N,).
      sd: of each by the model [m], shape (N,); the band holds 95 % of the shots.
      kept: which shots were used, shape (N,); the others are crosses.
      names: of the settings.
      title: above all.
    """
    order, place = np.argsort(setting, kind="stable"), np.arange(setting.size)
    with plot_style():
        figure, [[axes]] = new_figure()
        band = 196 * sd[order]
        axes.fill_between(
            place, -band, band, step="mid", color=MUTED, alpha=0.25, linewidth=0, label="95 % by the model"
        )
        for used, label, marker, color in ((kept, "measured", ".", PALETTE[0]), (~kept, "left out", "x", PALETTE[1])):
            axes.plot(place[used[order]], 100 * residual[order][used[order]], marker, color=color, label=label)
        axes.set_xticks([place[setting[order] == each].mean() for each in range(len(names))], names)
        axes.set(xlabel="setting", ylabel="measured less model [cm]", title=title)
        figure.legend(loc="outside lower center", ncols=3)
    return figure
