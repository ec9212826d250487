import numpy as np

from archerfish.figures.step_response import StepResponse, unit_step_figure
from archerfish.figures.style import svg_text


def test_a_unit_step_shows_its_band_and_where_it_settles():
    time = np.linspace(-0.01, 1.0, 102)
    response = np.where(time >= 0, 1 - np.exp(-5 * time), 0.0)
    banded = StepResponse("u1", time, response, (response - 0.1, response + 0.1), 1.0)
    bare = banded._replace(spread=(np.zeros(0), np.zeros(0)))
    figure = unit_step_figure([banded, bare], output="angle [rad]")
    assert [len(each.collections) for each in figure.axes] == [1, 0]
    assert figure.axes[0].lines[1].get_ydata() == [1.0, 1.0]
    assert figure.axes[0].get_ylabel() == "angle [rad] per unit"
    assert svg_text(figure).startswith("<svg")
