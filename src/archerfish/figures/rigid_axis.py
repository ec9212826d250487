"""Picture of an identified rigid axis: torque, measured and simulated angle, and the residual."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.style import BLUE, GREEN, INK, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]


class RigidRun(NamedTuple):
    """One recording of a rigid axis beside its simulation."""

    time: Array
    """Time [s], shape (N,)."""
    torque: Array
    """[N m], shape (N,)."""
    measured: Array
    """Measured angle [rad], shape (N,)."""
    simulated: Array
    """Simulated angle [rad], shape (N,)."""
    fit_percent: float
    """Fit [%]."""
    title: str
    """What the recording is."""


def rigid_figure(run: RigidRun, *, title: str = "Axis") -> Figure:
    """Draw the torque, the angle as measured and as simulated from it, and their difference."""
    with plot_style():
        figure, axes = new_figure(3, 1, height=6.0, sharex=True)
        torque, angle, residual = axes[:, 0]
        torque.plot(run.time, run.torque, color=GREEN, linewidth=1.0)
        label_axes(torque, title=f"{title}: {run.title}, fit {run.fit_percent:.1f} %", y="Torque [N m]")
        angle.plot(run.time, np.degrees(run.measured), color=INK, linewidth=1.0, label="measured")
        angle.plot(
            run.time,
            np.degrees(run.simulated),
            color=VERMILLION,
            linewidth=1.4,
            linestyle=(0, (4, 1.5)),
            label="simulated from the torque",
        )
        angle.legend(loc="best", ncols=2)
        label_axes(angle, y="Angle [°]")
        residual.plot(run.time, np.degrees(run.measured - run.simulated), color=BLUE, linewidth=0.8)
        label_axes(residual, x="Time [s]", y="Measured − simulated [°]")
    return figure
