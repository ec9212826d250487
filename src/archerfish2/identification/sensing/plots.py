"""Plots of an identified sensing: how camera and gimbal are aligned, and how delays and detections scatter."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from archerfish2.identification.statistics import Array
from archerfish2.reports.style import MUTED, new_figure, plot_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def alignment_plot(scan: Array, yaw: Array, seen: Array, *, title: str = "Alignment") -> "Figure":
    """Draw the misfit over the offset, and gimbal and camera in the second of fastest motion.

    Args:
      scan: offset less that of the record [s] and misfit [rad], shape (2, M).
      yaw: of the gimbal over time [s, rad], shape (2, N).
      seen: yaw by the plate's bearing over its aligned time [s, rad], shape (2, K).
      title: of the figure.
    """
    with plot_style():
        figure, ((left, right),) = new_figure(1, 2, width=10.0)
        left.plot(*1e3 * scan[:, np.abs(scan[0]) < 0.25])
        left.set(title=title, xlabel="Offset less that of the record [ms]", ylabel="Misfit of bearing and yaw [mrad]")
        fastest = yaw[0, np.argmax(np.abs(np.gradient(yaw[1], yaw[0])))]
        for line, style, label in ((yaw, "-", "gimbal"), (seen, ".", "camera")):
            time, angle = line[:, np.abs(line[0] - fastest) < 0.5]
            right.plot(time, np.degrees(angle), style, label=label)
        right.set(title="Fastest motion", xlabel="Time in the gimbal's log [s]", ylabel="Yaw [°]")
        right.legend()
    return figure


def scatter_plot(samples: Mapping[str, Array], *, title: str = "Scatter") -> "Figure":
    """Draw a histogram of each sample, of shape (K,), by its label; a line shows the mean."""
    with plot_style():
        figure, (row,) = new_figure(1, len(samples), width=10.0, height=2.6)
        for axes, (label, sample) in zip(row, samples.items(), strict=True):
            axes.hist(sample, bins=40, color=MUTED)
            axes.axvline(sample.mean(), label=f"{sample.mean():.2f} ± {sample.std():.2f}")
            axes.set_xlabel(label)
            axes.legend()
        row[0].set(title=title, ylabel="Count")
    return figure
