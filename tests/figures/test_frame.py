import numpy as np
import pytest

from archerfish.figures.frame import frame_axes, number_texts
from archerfish.figures.style import label_axes, label_log_axis, new_figure, plot_style


def framed(draw=lambda _: None, **options):
    with plot_style():
        figure, grid = new_figure(2, 2, layout=None, **options)
        for axes in grid.flat:
            axes.plot([0.0, 1.0], [-100_000.25, 100_000.25])
            label_axes(axes, title="Title", x="Time [s]", y="Angle [°]")
        draw(grid)
        if draw is with_legend:
            figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="lower center")
        frame_axes(figure, grid)
    return figure, grid


def with_legend(grid):
    grid[0, 0].plot([0.0, 1.0], [0.0, 0.0], label="line")


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([0.0, 0.5, 1.0], ["0.0", "0.5", "1.0"]),
        ([-0.25, 0.0, 0.25], ["−0.25", "0.00", "0.25"]),
        ([100.0, 200.0], ["100", "200"]),
        ([100_000.1, 100_000.2], ["100000.1", "100000.2"]),
        ([0.0, 2e-7, 4e-7], ["0e−7", "2e−7", "4e−7"]),
        ([1e6, 1.5e6], ["1.0e6", "1.5e6"]),
        ([0.0], ["0"]),
        ([], []),
    ],
)
def test_numbers_have_as_many_decimals_as_tell_them_apart(values, texts):
    assert number_texts(values) == texts


@pytest.mark.parametrize("draw", [lambda _: None, with_legend])
def test_nothing_overlaps_and_nothing_leaves_the_figure(draw):
    figure, grid = framed(draw)
    figure.draw_without_rendering()
    pixels = figure.bbox
    boxes = [each.get_tightbbox() for each in grid.flat]
    boxes += [each.get_window_extent() for each in figure.texts]
    for box in boxes + [each.get_window_extent() for each in figure.legends]:
        assert pixels.x0 <= box.x0
        assert box.x1 <= pixels.x1
        assert pixels.y0 <= box.y0
        assert box.y1 <= pixels.y1
    texts = [*figure.texts, *(axes._left_title for axes in grid.flat)]
    for index, text in enumerate(texts):
        box = text.get_window_extent()
        others = [*texts[:index], *(axes.patch for axes in grid.flat)]
        assert not any(box.overlaps(each.get_window_extent()) for each in others), text


def test_shared_axes_bear_numbers_once_and_a_line_for_each():
    figure, grid = framed(sharex=True, sharey=True)
    words = [each.get_text() for each in figure.texts]
    assert words.count("0.0") == 2
    assert words.count("−100000") == 2
    for axes in grid.flat:
        assert len(axes.patches[0].get_path().vertices) > 10


def test_a_logarithmic_axis_has_plain_numbers():
    def scaled(grid):
        for axes in grid.flat:
            axes.set_xscale("log")
            axes.set_xlim(0.5, 100.0)
            label_log_axis(axes)

    figure, grid = framed(scaled)
    words = {each.get_text() for each in figure.texts}
    assert {"0.5", "1", "2", "5", "10", "20", "50", "100"} <= words
    np.testing.assert_allclose(grid[0, 0].get_xlim(), (0.5, 100.0))


def test_limits_stay_as_they_were():
    _, grid = framed()
    assert grid[0, 0].get_xlim() == pytest.approx((-0.05, 1.05))
