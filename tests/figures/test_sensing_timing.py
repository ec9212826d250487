import numpy as np

from archerfish.figures.sensing_timing import Noise, Overlay, Spread, noise_figure, overlay_figure, times_figure

RNG = np.random.default_rng(0)
TIME = np.arange(0, 8, 0.002)
YAW = 0.3 * np.sin(2 * np.pi * (0.2 * TIME + 0.1 * TIME**2))


def test_the_overlay_shows_the_whole_sweep_and_its_fastest_second():
    moment = np.arange(0.1, 7.9, 0.0125)
    inlier = np.ones(moment.size, bool)
    inlier[5] = False
    figure = overlay_figure(Overlay(TIME, YAW, moment, np.interp(moment, TIME, YAW), inlier))
    whole, close = figure.axes
    assert len(whole.lines[1].get_xdata()) == moment.size - 1
    low, high = close.get_xlim()
    assert np.isclose(high - low, 1.0)
    # The sweep's rate grows, so the fastest second is near its end.
    assert low > 5


def test_every_kind_of_delay_has_its_histogram_and_estimate():
    values = 0.035 + 0.002 * RNG.standard_normal(500)
    latency = Spread(values, 0.035, (0.034, 0.036), "Camera latency", "[ms]")
    figure = times_figure([latency, latency._replace(interval=None, values=values[:8])])
    first, second = figure.axes
    assert sum(patch.get_height() for patch in first.patches[:-1]) == 500
    assert first.lines[0].get_xdata()[0] == 35.0
    assert sum(patch.get_height() for patch in second.patches) == 8
    assert not times_figure([latency]).axes[1].axison


def test_the_noise_curve_holds_as_many_detections_as_the_histogram():
    figure = noise_figure([Noise(2 * RNG.standard_normal(2000), 2.0, name, "[mrad]") for name in ("side", "height")])
    for axes in figure.axes:
        curve = axes.lines[0]
        expected = np.trapezoid(curve.get_ydata(), curve.get_xdata()) / axes.patches[0].get_width()
        assert np.isclose(expected, 2000, rtol=0.02)
