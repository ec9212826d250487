"""Pictures of an identified axis: measured beside simulated output, the residual, and the frequency response."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.bode import BodeData, draw_bode
from archerfish.figures.frame import frame_axes
from archerfish.figures.style import BLUE, INK, VERMILLION, label_axes, new_figure, plot_style

Array = NDArray[np.float64]

_LONGEST = 2000
_WIDEST_TITLE = 44
"""Letters of a title that fit beside another one."""


class SimulatedRun(NamedTuple):
    """One output of a recording beside its simulation."""

    time: Array
    """Time [s], shape (N,)."""
    measured: Array
    """Measured output, shape (N,)."""
    simulated: Array
    """Simulated output, shape (N,)."""
    spread: tuple[Array, Array]
    """Lower and upper side of the simulation's 95 % band over the stretch that is drawn (`worst_stretch`), each of its
    shape (S,); (0,) where there is none."""
    fit_percent: float
    """Fit over the whole recording [%]."""
    title: str
    """What the recording is."""


def axis_figure(run: SimulatedRun, bode: BodeData, *, output: str = "output", title: str = "Axis") -> Figure:
    """Draw measured over simulated output, the residual, and the frequency response.

    A long recording is shown where its residual is largest.

    Args:
      run: the recording, with N ≥ 2.
      bode: frequency responses.
      output: name of the output, for the labels.
      title: what was identified.
    """
    with plot_style():
        figure, axes = new_figure(2, 2, width=10.0, height=5.6, layout=None, sharex="col")
        _draw_run(axes[0, 0], axes[1, 0], run, output, title)
        draw_bode(axes[0, 1], axes[1, 1], bode)
        frame_axes(figure, axes)
    return figure


def run_figure(run: SimulatedRun, *, output: str = "output", title: str = "Axis") -> Figure:
    """Draw measured over simulated output with its band (Fig. 4 for a step), and the residual; see `axis_figure`."""
    with plot_style():
        figure, axes = new_figure(2, 1, height=4.0, layout=None, sharex=True, height_ratios=(2, 1))
        _draw_run(axes[0, 0], axes[1, 0], run, output, title)
        frame_axes(figure, axes)
    return figure


def worst_stretch(measured: Array, simulated: Array) -> slice:
    """Return the samples of a recording that are drawn: all, or of a long one those where its residual is largest.

    Args:
      measured: shape (N,).
      simulated: shape (N,).
    """
    if measured.size <= _LONGEST:
        return slice(0, measured.size)
    energy = np.concatenate([[0.0], np.cumsum((measured - simulated) ** 2)])
    start = int(np.argmax(energy[_LONGEST:] - energy[:-_LONGEST]))
    return slice(start, start + _LONGEST)


def _draw_run(above: Axes, below: Axes, run: SimulatedRun, output: str, title: str) -> None:
    shown = worst_stretch(run.measured, run.simulated)
    note = " (worst stretch)" if run.time.size > _LONGEST else ""
    time, measured, simulated = run.time[shown], run.measured[shown], run.simulated[shown]
    above.plot(time, measured, color=INK, linewidth=1.0, label="measured")
    if run.spread[0].size:
        above.fill_between(time, *run.spread, color=VERMILLION, alpha=0.25, linewidth=0, label="95 % band")
    above.plot(time, simulated, color=VERMILLION, linewidth=1.4, linestyle=(0, (4, 1.5)), label="simulated")
    # On a ground of its own: an oscillation fills the axes, and leaves no corner free.
    above.legend(loc="best", ncols=3, frameon=True, facecolor="white", framealpha=0.85, edgecolor="none")
    name = f"{title}: {run.title}{note},"
    # A long one would run into the title beside it.
    between = "\n" if len(name) > _WIDEST_TITLE else " "
    label_axes(above, title=f"{name}{between}fit {run.fit_percent:.2f} %", y=output)
    below.plot(time, measured - simulated, color=BLUE, linewidth=0.8)
    label_axes(below, x="Time [s]", y="Residual")
