import numpy as np

from archerfish.figures.residuals import CorrelationPanel, correlation_figure
from archerfish.figures.style import svg_text


def test_correlations_outside_their_band_stand_out():
    panel = CorrelationPanel("Residual with u", np.arange(3), np.array([0.0, 0.5, -0.1]), np.full(3, 0.2))
    figure = correlation_figure([panel, panel._replace(half_width=np.full(3, 2.0))])
    _, inside, outside = figure.axes[0].collections
    assert [len(each.get_segments()) for each in (inside, outside)] == [2, 1]
    assert figure.axes[1].get_ylim()[1] < 1.1
    assert svg_text(figure).startswith("<svg")
