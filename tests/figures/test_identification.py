import numpy as np
import pytest

from archerfish.figures.bode import BodeData
from archerfish.figures.identification import SimulatedRun, axis_figure, run_figure, worst_stretch
from archerfish.figures.style import svg_text

FREQUENCY = np.geomspace(0.1, 50, 50)
RESPONSE = 1 / (1 + 1j * FREQUENCY / 5)
NONE = np.zeros(0)


def run(count, spike=0, spread=None):
    time = 0.01 * np.arange(count)
    measured = np.sin(time)
    simulated = measured.copy()
    simulated[spike] += 0.1
    shown = simulated[worst_stretch(measured, simulated)]
    sides = (NONE, NONE) if spread is None else (shown - spread, shown + spread)
    return SimulatedRun(time, measured, simulated, sides, 98.7, "validation log.csv")


BODE = BodeData(FREQUENCY, RESPONSE, np.zeros((0, 50)), NONE, NONE, NONE, (1.0, 20.0))


def test_an_axis_shows_signals_residual_magnitude_and_phase():
    figure = axis_figure(run(500), BODE, output="angle [rad]", title="pitch")
    signals, magnitude, residual, phase = figure.axes
    assert "pitch: validation log.csv, fit 98.70 %" in signals.get_title(loc="left")
    np.testing.assert_allclose(residual.lines[0].get_ydata(), run(500).measured - run(500).simulated)
    np.testing.assert_allclose(magnitude.lines[0].get_ydata()[-1], 20 * np.log10(abs(RESPONSE[-1])))
    assert phase.get_ylabel() == "Phase [°]"
    assert svg_text(figure).startswith("<svg")


def test_a_long_run_is_shown_where_its_residual_is_largest():
    figure = axis_figure(run(10_000, spike=7777), BODE)
    shown = figure.axes[0].lines[0].get_xdata()
    assert len(shown) == 2000
    assert shown[0] <= 77.77 <= shown[-1]
    assert "worst stretch" in figure.axes[0].get_title(loc="left")


def test_a_run_with_a_band_shows_it_over_the_stretch_that_is_drawn():
    (band,) = run_figure(run(10_000, spike=7777, spread=0.2)).axes[0].collections
    outline = band.get_paths()[0].vertices
    assert np.ptp(outline[:, 0]) == pytest.approx(19.99)
    assert not run_figure(run(100)).axes[0].collections
