import numpy as np
import pytest

from archerfish.figures.shot_scatter import ScatterPanel, scatter_figure

RNG = np.random.default_rng(0)


def panel(name="4 m", sd=(0.02, 0.03), lost=0):
    lateral, ahead = (middle + each * RNG.standard_normal(400) for middle, each in zip((0.1, 2.0), sd, strict=True))
    ahead[:lost] -= 1.0
    return ScatterPanel(name, lateral, ahead, np.arange(400) >= lost, (0.1, 2.0), sd)


def test_the_ellipse_holds_95_percent_of_the_models_shots():
    (place,) = [axes for axes in scatter_figure([panel()]).axes if axes.patches]
    ellipse, dots = place.patches[0], place.lines[-1].get_xydata()
    inside = (2 * dots[:, 0] / ellipse.width) ** 2 + (2 * dots[:, 1] / ellipse.height) ** 2 < 1
    # Three standard deviations of 400 shots are 3.3 %.
    assert inside.mean() == pytest.approx(0.95, abs=0.033)


def test_left_is_left_and_what_was_left_out_is_a_cross_at_the_edge():
    (place,) = [axes for axes in scatter_figure([panel(lost=3)]).axes if axes.patches]
    assert place.get_xlim()[0] > 0 > place.get_xlim()[1]
    dots, crosses = place.lines[-2:]
    assert len(dots.get_xdata()) == 397
    assert (crosses.get_ydata() == place.get_ylim()[0]).all()


def test_a_scatter_that_is_mostly_ahead_gets_scales_of_its_own():
    even, tall = (scatter_figure([panel(sd=sd)]).axes[0] for sd in ((0.02, 0.03), (0.02, 0.3)))
    assert even.get_xlim()[0] == even.get_ylim()[1]
    assert tall.get_ylim()[1] > 5 * tall.get_xlim()[0]


def test_at_most_nine_settings_are_drawn():
    figure = scatter_figure([panel(f"{index} m") for index in range(12)])
    assert [axes.get_title(loc="left") for axes in figure.axes] == [f"{index} m" for index in range(9)]
