import numpy as np

from archerfish.figures.excitation import CommandRun, ResponseBand, excitation_figure
from archerfish.figures.rigid_axis import RigidRun, rigid_figure
from archerfish.figures.style import svg_text

TIME = np.arange(500) * 0.01


def test_a_plan_shows_commands_spectra_and_response():
    frequency = np.geomspace(0.2, 40, 50)
    ones = np.ones(50)
    response = ResponseBand(frequency, ones, 0.1 * ones, -0.1 * ones, 10 * ones, frequency < 20)
    runs = [CommandRun("sweep", 0.1 * np.sin(30 * TIME)), CommandRun("step", np.where(TIME > 2, 0.1, 0.0))]
    figure = excitation_figure(runs, 0.01, (2.0, 20.0), response, title="pitch")
    assert figure.axes[0].get_title(loc="left") == "pitch: commands, one after another"
    assert len(figure.axes[0].lines) == 2
    np.testing.assert_allclose(figure.axes[0].lines[1].get_xdata()[0], 5.0)
    assert svg_text(figure).startswith("<svg")


def test_a_rigid_axis_shows_angles_in_degrees():
    run = RigidRun(TIME, np.ones(500), np.radians(TIME), np.radians(TIME - 1), 91.2, "log.csv")
    figure = rigid_figure(run, title="yaw")
    assert "91.2 %" in figure.axes[0].get_title(loc="left")
    np.testing.assert_allclose(figure.axes[1].lines[0].get_ydata(), TIME)
    np.testing.assert_allclose(figure.axes[2].lines[0].get_ydata(), 1.0)
