import numpy as np

from archerfish.figures.identification import BodeData, LandingGroup, SimulatedRun, axis_figure, landing_figure
from archerfish.figures.style import svg_text

FREQUENCY = np.geomspace(0.1, 50, 50)
RESPONSE = 1 / (1 + 1j * FREQUENCY / 5)


def run(count, spike=0):
    time = 0.01 * np.arange(count)
    measured = np.sin(time)
    simulated = measured.copy()
    simulated[spike] += 0.1
    return SimulatedRun(time, measured, simulated, 98.7, "validation log.csv")


def bode(measured=True):
    kept = slice(10, 30) if measured else slice(0, 0)
    return BodeData(FREQUENCY, RESPONSE, FREQUENCY[kept], RESPONSE[kept] * 1.01, (1.0, 20.0))


def test_an_axis_shows_signals_residual_magnitude_and_phase():
    figure = axis_figure(run(500), bode(), output="angle [rad]", title="pitch")
    signals, magnitude, residual, phase = figure.axes
    assert "pitch: validation log.csv, fit 98.70 %" in signals.get_title(loc="left")
    np.testing.assert_allclose(residual.lines[0].get_ydata(), run(500).measured - run(500).simulated)
    np.testing.assert_allclose(magnitude.lines[-1].get_ydata()[-1], 20 * np.log10(abs(RESPONSE[-1])))
    np.testing.assert_allclose(phase.lines[0].get_ydata(), phase.lines[-1].get_ydata()[10:30], atol=1e-9)
    assert svg_text(figure).startswith("<svg")


def test_a_long_run_is_shown_where_its_residual_is_largest():
    figure = axis_figure(run(10_000, spike=7777), bode())
    shown = figure.axes[0].lines[0].get_xdata()
    assert len(shown) == 2000
    assert shown[0] <= 77.77 <= shown[-1]
    assert "worst stretch" in figure.axes[0].get_title(loc="left")


def test_an_axis_without_measured_response_is_drawn_all_the_same():
    assert len(axis_figure(run(100), bode(measured=False)).axes[1].lines) == 1


def test_landing_distances_are_drawn_with_their_residuals_in_percent():
    pitch = np.radians([0.0, 5.0])
    group = LandingGroup(pitch, np.array([3.0, 6.0]), np.array([3.3, 6.0]), np.array([0.1, 0.2]))
    residuals = landing_figure(group).axes[1]
    np.testing.assert_allclose(residuals.lines[-1].get_ydata(), [-10.0, 0.0], atol=1e-9)
