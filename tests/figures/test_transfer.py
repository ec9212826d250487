import math

import pytest

from archerfish.figures.style import PALETTE, svg_text
from archerfish.figures.transfer import Slope, SlopePanel, transfer_figure

RANGES, WORLDS = ("1–2", "2–3"), ("sim.", "sentry", "rusty")


def slope(label: str, style: int, top: float) -> Slope:
    rate = [[top, top - 1, top - 9], [top - 2, math.nan, top - 20]]
    return Slope(
        label, style, rate, [[each - 2 for each in row] for row in rate], [[each + 1 for each in row] for row in rate]
    )


def test_a_line_per_controller_and_range_over_the_worlds():
    panel = SlopePanel("Static", RANGES, [slope("History policy", 0, 95.0), slope("Kalman filter", 1, 80.0)])
    figure = transfer_figure([panel, panel._replace(title="Dynamic")], WORLDS)
    assert [each.get_title(loc="left") for each in figure.axes] == ["Static", "Dynamic"]
    for axes in figure.axes:
        lines = [line for line in axes.lines if line.get_color() == PALETTE[0]]
        assert [len(line.get_xdata()) for line in lines] == [3, 3]
        assert list(lines[0].get_ydata()) == [95.0, 94.0, 86.0]
        assert [each.get_text() for each in axes.get_xticklabels()] == [*WORLDS, *WORLDS]
        assert [each.get_text() for each in axes.texts] == ["1–2 m", "2–3 m"]
    (legend,) = figure.legends
    assert [each.get_text() for each in legend.get_texts()] == ["History policy", "Kalman filter"]
    assert svg_text(figure).startswith("<svg")


@pytest.mark.parametrize(("name", "turned"), [("rusty", 0.0), ("a_robot_with_a_long_name", 25.0)])
def test_long_names_of_robots_are_turned(name: str, turned: float):
    figure = transfer_figure([SlopePanel("Static", RANGES, [slope("Oracle", 2, 99.0)])], ("sim.", "sentry", name))
    assert {each.get_rotation() for each in figure.axes[0].get_xticklabels()} == {turned}
