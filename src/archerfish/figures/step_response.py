"""Step responses: identified beside true (Fig. 4) or measured ones, and an identified plant's with its band."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.frame import frame_axes
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


class MeasuredStep(NamedTuple):
    """A step of a real axis beside that of its model."""

    title: str
    """Axis and size, with the fit."""
    time_s: Sequence[float]
    """Time since the step [s], shape (N,)."""
    measured_deg: Sequence[float]
    """Angle as measured [degrees], shape (N,)."""
    model_deg: Sequence[float]
    """Angle of the model [degrees], shape (N,)."""


def measured_steps(rows: Sequence[Sequence[MeasuredStep]]) -> Figure:
    """Draw measured steps beside those of a model: a row per axis, a column per size.

    Args:
      rows: at least one, each of at least one step; a shorter row leaves places empty.
    """
    with plot_style():
        figure, axes = new_figure(len(rows), max(map(len, rows)), height=0.4 + 2.1 * len(rows), sharex=True)
        for row, places in zip(rows, axes, strict=True):
            for panel, place in zip(row, places, strict=False):
                place.plot(panel.time_s, panel.measured_deg, color=INK, linewidth=1.2, label="measured")
                place.plot(panel.time_s, panel.model_deg, color=VERMILLION, linestyle=(0, (4, 1.5)), label="model")
                label_axes(place, title=panel.title)
                place.title.set_fontsize(10.0)
            for place in places[len(row) :]:
                place.set_axis_off()
            places[0].set_ylabel("Angle [°]")
        for place in axes[-1]:
            place.set_xlabel("Time since the step [s]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
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
        figure, axes = new_figure(1, len(panels), height=2.8, layout=None)
        for place, panel in zip(axes[0], panels, strict=True):
            if panel.spread[0].size:
                sides = panel.spread
                place.fill_between(panel.time_s, *sides, color=VERMILLION, alpha=0.25, linewidth=0, label="95 % band")
            place.plot(panel.time_s, panel.response, color=VERMILLION, label="model")
            place.axhline(panel.dc_gain, color=MUTED, linewidth=0.9, linestyle="--", label="steady gain")
            place.legend(loc="lower right")
            label_axes(place, title=panel.title, x="Time since the step [s]", y=f"{output} per unit")
        frame_axes(figure, axes)
    return figure
