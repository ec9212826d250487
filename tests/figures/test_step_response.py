import numpy as np

from archerfish.figures.step_response import MeasuredStep, StepResponse, measured_steps, unit_step_figure
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


def test_measured_steps_stand_in_rows_of_axes():
    time = np.linspace(0.0, 1.0, 51)
    small = MeasuredStep("Yaw, 2°: fit 97.0 %", time, 2 - 2 * np.exp(-9 * time), 2 - 2 * np.exp(-10 * time))
    large = small._replace(title="Yaw, 30°: fit 35.0 %", measured_deg=30 * time)
    figure = measured_steps([[small], [small, large]])
    titles = [each.get_title(loc="left") for each in figure.axes]
    assert titles == [small.title, "", small.title, large.title]
    assert [each.axison for each in figure.axes] == [True, False, True, True]
    measured, model = figure.axes[3].lines
    assert measured.get_ydata()[-1] == 30.0
    assert model.get_label() == "model"
    assert [each.get_text() for each in figure.legends[0].get_texts()] == ["measured", "model"]
