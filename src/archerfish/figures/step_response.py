"""Step responses: of the identified beside the true plant (Fig. 4), and of an identified plant with its band."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.style import BLUE, INK, MUTED, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]


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


class StepResponse(NamedTuple):
    """Response of an identified plant to a unit step of one input."""

    title: str
    """Which input."""
    time_s: Array
    """Time since the step [s], shape (N,)."""
    response: Array
    """Output per unit of the input, shape (N,)."""
    spread: tuple[Array, Array]
    """Lower and upper side of its 95 % band, each of shape (N,); (0,) where there is none."""
    dc_gain: float
    """Where it settles, output per input."""


def unit_step_figure(panels: Sequence[StepResponse], *, output: str = "output") -> Figure:
    """Draw unit step responses side by side, each with its band and the steady gain.

    Args:
      panels: at least one.
      output: name of the output, for the labels.
    """
    with plot_style():
        figure, axes = new_figure(1, len(panels), height=2.8)
        for place, panel in zip(axes[0], panels, strict=True):
            if panel.spread[0].size:
                sides = panel.spread
                place.fill_between(panel.time_s, *sides, color=VERMILLION, alpha=0.25, linewidth=0, label="95 % band")
            place.plot(panel.time_s, panel.response, color=VERMILLION, label="model")
            place.axhline(panel.dc_gain, color=MUTED, linewidth=0.9, linestyle="--", label="steady gain")
            place.legend(loc="lower right")
            label_axes(place, title=panel.title, x="Time since the step [s]", y=f"{output} per unit")
    return figure
