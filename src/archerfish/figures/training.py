"""Learning curves, Figs. 5 and 6: return against environment steps."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from numpy.typing import ArrayLike

from archerfish.figures.style import INK, PALETTE, label_axes, new_figure, plot_style


def learning_curves(
    steps: ArrayLike, returns: Mapping[str, Sequence[float | None] | ArrayLike], *, title: str = "Training"
) -> Figure:
    """Draw the mean return of each training, and with several trainings their median.

    Args:
      steps: environment steps so far, shape (N,).
      returns: label of a training → its mean return per engagement [m], shape (N,); None leaves a gap.
      title: above the plot.
    """
    curves = {label: np.asarray(values, dtype=np.float64) for label, values in returns.items()}
    with plot_style():
        figure, grid = new_figure(height=3.0)
        axes = grid[0, 0]
        for index, (label, values) in enumerate(curves.items()):
            axes.plot(steps, values, color=PALETTE[index % len(PALETTE)], linewidth=1.1, alpha=0.9, label=label)
        if len(curves) > 2:
            median = np.median(np.stack(list(curves.values())), axis=0)
            axes.plot(steps, median, color=INK, linewidth=2.0, linestyle=(0, (4, 1.5)), label="median")
        axes.xaxis.set_major_formatter(EngFormatter(sep=" "))
        if curves:
            axes.legend(loc="lower right", ncols=2)
        label_axes(axes, title=title, x="Environment steps", y="Mean return per engagement [m]")
    return figure
