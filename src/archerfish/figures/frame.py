"""Grid, numbers and room for them around the axes of a figure, without Matplotlib's own ticks and layout.

A tick of Matplotlib is five artists, and its constrained layout draws a figure twice more to measure them: both take
several times as long as all curves of a page. Here the grid of a set of axes is one path, each number one text, and
the room that they need is counted in letters.
"""

from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

_DIGIT, _SIGN = 0.64, 0.84
"""Widths of a digit and of a minus sign over their size."""
_LINE = 1.25
"""Height of a line over the size of its letters."""
_GAP = 5.0
"""Between what stands beside one another [point]."""
_LOCATOR = MaxNLocator(6, steps=[1, 2, 2.5, 5, 10])
"""Where the numbers of an axis stand: at no more than seven places."""
_PLAIN = (1e-3, 1e6)
"""Numbers whose largest lies within these are written without an exponent."""


class _Numbers(NamedTuple):
    """What stands along one axis."""

    places: list[float]
    """Where the grid has its lines."""
    texts: list[str]
    """What is written there; empty where another axis of the figure bears the numbers."""


class _Room(NamedTuple):
    """What one set of axes needs outside itself [point]."""

    beside: float
    """From the axes to the label on the left."""
    left: float
    """All on the left."""
    right: float
    """All on the right."""
    below: float
    """From the axes to the label below."""
    bottom: float
    """All below."""
    top: float
    """All above."""


def frame_axes(figure: Figure, grid: NDArray[np.object_]) -> None:
    """Draw grid and numbers of all axes, and make room for them; call it when all else is drawn.

    Args:
      figure: made by `new_figure` with `layout=None`; a legend of its own takes the bottom.
      grid: its axes, shape (rows, columns).
    """
    numbers = [
        [(_numbers(axes.xaxis, "labelbottom"), _numbers(axes.yaxis, "labelleft")) for axes in row] for row in grid
    ]
    rooms = [[_room(axes, *each) for axes, each in zip(*row, strict=True)] for row in zip(grid, numbers, strict=True)]
    _place(figure, rooms)
    for row, found, needed in zip(grid, numbers, rooms, strict=True):
        for axes, (across, up), room in zip(row, found, needed, strict=True):
            _draw(figure, axes, across, up, room)


def _numbers(axis: Axis, label: str) -> _Numbers:
    low, high = sorted(axis.get_view_interval())
    margin = 1e-9 * (high - low)
    logarithmic = axis.get_scale() == "log"
    found = axis.get_majorticklocs() if logarithmic else _LOCATOR.tick_values(low, high)
    places = [float(each) for each in found if low - margin <= each <= high + margin]
    if not axis.get_tick_params(which="major").get(label, True):
        return _Numbers(places, [])
    texts = axis.get_major_formatter().format_ticks(places) if logarithmic else number_texts(places)
    return _Numbers(places, list(texts))


def number_texts(values: list[float]) -> list[str]:
    """Write evenly spaced numbers with as many decimals as tell them apart, all alike."""
    if not values:
        return []
    step = min(np.diff(values), default=abs(values[0]) or 1.0)
    largest = max(map(abs, values))
    low, high = _PLAIN
    exponent = 0 if largest == 0 or low <= largest < high else int(np.floor(np.log10(largest)))
    scaled = [each / 10.0**exponent for each in values]
    off = 1e-3 * step / 10.0**exponent
    decimals = next((count for count in range(12) if all(abs(round(v, count) - v) < off for v in scaled)), 12)
    end = f"e{exponent}" if exponent else ""
    texts = (f"{round(each, decimals) + 0.0:.{decimals}f}{end}" for each in scaled)
    return [each.replace("-", "−") for each in texts]


def _room(axes: Axes, across: _Numbers, up: _Numbers) -> _Room:
    size = float(mpl.rcParams["xtick.labelsize"])
    title = axes.get_title(loc="left")
    if title:
        axes.set_title(title, y=1.0)  # nothing stands above the axes that it must keep clear of
    beside = _GAP + max(map(_width, up.texts), default=0.0) * size
    below = _GAP + _LINE * size if across.texts else 0.0
    last = 0.5 * _width(across.texts[-1]) * size if across.texts else 0.0
    return _Room(
        beside + 0.5 * _GAP,
        beside + _height(axes.yaxis.label) + 1.5 * _GAP,
        last + _GAP,
        below + 0.5 * _GAP,
        below + _height(axes.xaxis.label) + 1.5 * _GAP,
        (_height(axes.title, title) if title else 0.0) + 1.5 * _GAP,
    )


def _width(number: str) -> float:
    return _DIGIT * len(number) + (_SIGN - _DIGIT) * number.count("−")


def _height(label: Any, text: str | None = None) -> float:
    words = label.get_text() if text is None else text
    return (words.count("\n") + 1) * _LINE * float(label.get_fontsize()) if words else 0.0


def _place(figure: Figure, rooms: list[list[_Room]]) -> None:
    rows, columns = len(rooms), len(rooms[0])
    width, height = (72.0 * each for each in figure.get_size_inches())
    left, right = max(row[0].left for row in rooms), max(row[-1].right for row in rooms)
    bottom, top = max(each.bottom for each in rooms[-1]), max(each.top for each in rooms[0])
    if figure.legends:
        bottom += _height(figure.legends[0].get_texts()[0]) + 2 * _GAP
    across = max((row[i].right + row[i + 1].left for row in rooms for i in range(columns - 1)), default=0.0)
    down = max((rooms[i][j].bottom + rooms[i + 1][j].top for i in range(rows - 1) for j in range(columns)), default=0.0)
    figure.subplots_adjust(
        left=left / width,
        right=1 - right / width,
        bottom=bottom / height,
        top=1 - top / height,
        wspace=across * columns / (width - left - right - across * (columns - 1)),
        hspace=down * rows / (height - bottom - top - down * (rows - 1)),
    )


def _draw(figure: Figure, axes: Axes, across: _Numbers, up: _Numbers, room: _Room) -> None:
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    lines = [((x, low), (x, high)) for x in across.places] + [((left, y), (right, y)) for y in up.places]
    if lines:
        path = Path(np.reshape(lines, (-1, 2)), [Path.MOVETO, Path.LINETO] * len(lines))
        style: Any = {"edgecolor": mpl.rcParams["grid.color"], "linewidth": mpl.rcParams["grid.linewidth"]}
        axes.add_artist(PathPatch(path, fill=False, zorder=0.5, **style))
    text: Any = {"fontsize": mpl.rcParams["xtick.labelsize"], "color": mpl.rcParams["xtick.color"]}
    below = axes.get_xaxis_transform() + ScaledTranslation(0, -_GAP / 72, figure.dpi_scale_trans)
    beside = axes.get_yaxis_transform() + ScaledTranslation(-_GAP / 72, 0, figure.dpi_scale_trans)
    for place, word in zip(across.places, across.texts, strict=False):
        figure.text(place, 0.0, word, transform=below, ha="center", va="top", **text)
    for place, word in zip(up.places, up.texts, strict=False):
        figure.text(0.0, place, word, transform=beside, ha="right", va="center", **text)
    text = {"fontsize": mpl.rcParams["axes.labelsize"], "color": mpl.rcParams["axes.labelcolor"]}
    under = axes.transAxes + ScaledTranslation(0, -room.below / 72, figure.dpi_scale_trans)
    left_of = axes.transAxes + ScaledTranslation(-room.beside / 72, 0, figure.dpi_scale_trans)
    if label := axes.get_xlabel():
        figure.text(0.5, 0.0, label, transform=under, ha="center", va="top", **text)
    if label := axes.get_ylabel():
        figure.text(0.0, 0.5, label, transform=left_of, ha="right", va="center", rotation=90, **text)
    # All that an axis would draw is there.
    axes.xaxis.set_visible(False)
    axes.yaxis.set_visible(False)
    axes.set(xlim=(left, right), ylim=(low, high))
