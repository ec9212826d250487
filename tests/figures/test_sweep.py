import pytest

from archerfish.figures.sweep import SweepPoint, sweep_figure


def point(world, *values, best=False):
    return SweepPoint(world, values, 80.0, 78.0, 82.0, best)


def test_numbers_over_a_wide_span_are_drawn_by_their_logarithm_and_words_by_name():
    points = [point("a", 1e-4, 0.1, True), point("a", 1e-2, 0.2, False, best=True)]
    figure = sweep_figure(["rate", "clip", "anneal"], points)
    rate, clip, anneal = figure.axes
    assert (rate.get_xscale(), clip.get_xscale()) == ("log", "linear")
    assert [label.get_text() for label in anneal.get_xticklabels()] == ["false", "true"]
    assert figure.legends == []


def test_worlds_have_a_legend():
    figure = sweep_figure(["clip"], [point("a", 0.1), point("b", 0.1), point("b", 0.2)])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b"]


@pytest.mark.parametrize("count", [1, 3, 4, 7])
def test_there_is_a_panel_per_parameter(count):
    names = [f"p{k}" for k in range(count)]
    figure = sweep_figure(names, [point("a", *range(1, count + 1))])
    assert [axes.get_xlabel() for axes in figure.axes if axes.get_visible()] == names
