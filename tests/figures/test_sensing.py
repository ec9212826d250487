import numpy as np

from archerfish.figures.sensing import AlignmentData, sensing_figure
from archerfish.figures.style import svg_text

RNG = np.random.default_rng(0)
OFFSET = np.arange(-1, 1, 0.005)


def data(outliers):
    bearing = 0.002 * RNG.standard_normal(500)
    inlier = np.ones(500, dtype=bool)
    inlier[:outliers] = False
    bearing[:outliers] = 1.0
    distance = 0.04 * RNG.standard_normal(500)
    misfit = 0.002 + np.abs(OFFSET - 0.1)
    return AlignmentData(OFFSET, misfit, 0.1, np.arange(500.0), bearing, distance, inlier, 0.002, 0.04)


def test_the_picture_shows_the_offset_the_residuals_and_their_noise():
    figure = sensing_figure(data(outliers=3))
    scan, residuals, bearing, distance = figure.axes
    assert scan.lines[1].get_xdata()[0] == 100.0
    assert len(residuals.lines[0].get_xdata()) == 497
    # What is not the plate is drawn at the edge, where it doesn't squeeze the rest.
    assert residuals.lines[1].get_ydata().max() < 20
    for axes in (bearing, distance):
        counts = sum(patch.get_height() for patch in axes.patches)
        density = axes.lines[0]
        expected = np.trapezoid(density.get_ydata(), density.get_xdata()) / axes.patches[0].get_width()
        assert abs(counts - expected) < 10
    assert svg_text(figure).startswith("<svg")


def test_without_outliers_none_are_drawn():
    assert len(sensing_figure(data(outliers=0)).axes[1].lines) == 1
