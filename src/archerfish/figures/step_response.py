"""Step responses of the identified and the true plant, Fig. 4."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from archerfish.figures.style import BLUE, INK, VERMILLION, label_axes, new_figure, plot_style


class StepPanel(NamedTuple):
    """One axis: both responses."""

    title: str
    """Name of the axis, with the fit."""
    time_s: Sequence[float]
    """Time since the step [s], shape (N,)."""
    true_deg: Sequence[float]
    """Angle of the true plant [degrees], shape (N,)."""
    identified_deg: Sequence[float]
    """Angle of the identified plant [degrees], shape (N,)."""


def step_responses(panels: Sequence[StepPanel]) -> Figure:
    """Draw the responses of one or more axes side by side, their differences below.

    Args:
      panels: at least one.
    """
    with plot_style():
        figure, axes = new_figure(2, len(panels), height=4.2, sharex="col", height_ratios=(2, 1))
        for index, panel in enumerate(panels):
            above, below = axes[0, index], axes[1, index]
            above.plot(panel.time_s, panel.true_deg, color=INK, linewidth=1.2, label="true")
            above.plot(
                panel.time_s, panel.identified_deg, color=VERMILLION, linestyle=(0, (4, 1.5)), label="identified"
            )
            above.legend(loc="lower right")
            below.plot(panel.time_s, np.subtract(panel.identified_deg, panel.true_deg), color=BLUE, linewidth=1.0)
            label_axes(above, title=panel.title, y="Angle [°]" if index == 0 else "")
            label_axes(below, x="Time since the step [s]", y="Identified\n− true [°]" if index == 0 else "")
    return figure
