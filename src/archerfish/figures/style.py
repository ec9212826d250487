"""One style for every plot of the project, drawn without pyplot's global state.

A plot is made inside `plot_style()` from `new_figure`, and leaves as a file (`save_figure`) or as SVG for a page
(`svg_text`). The same figure gives the same bytes on every run: no timestamps, no random ids.
"""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from archerfish.records import storage
from archerfish.records.errors import InputError

BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
ORANGE = "#E69F00"
INK = "#222222"
MUTED = "#767676"

PALETTE = (BLUE, VERMILLION, GREEN, PURPLE, SKY, ORANGE, INK)
"""The Okabe–Ito colours (less the yellow, which is too pale on white): told apart with every colour vision."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
"""One marker per colour of `PALETTE`, so that no plot leans on colour alone."""

WIDTH = 7.2
"""Width of a full-width figure [inch]."""

_MANY_DECADES = 3e3
"""Ratio of the ends of a logarithmic axis from which each decade has one number."""

_SETTINGS: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=PALETTE),
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "savefig.dpi": 150,
    # Text as outlines: the page looks alike on machines without the font.
    "svg.fonttype": "path",
    "svg.hashsalt": "archerfish",
}


@contextmanager
def plot_style() -> Iterator[None]:
    """Apply the style to the artists made inside the block, and only to those."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


def new_figure(
    rows: int = 1,
    columns: int = 1,
    *,
    width: float = WIDTH,
    height: float = 3.2,
    layout: Literal["constrained"] | None = "constrained",
    **options: Any,
) -> tuple[Figure, NDArray[np.object_]]:
    """Make a figure with a grid of axes; call it, and draw on it, inside `plot_style()`.

    Args:
      rows: rows of axes.
      columns: columns of axes.
      width: width of the figure [inch].
      height: height of the figure [inch].
      layout: who makes room for labels: Matplotlib, which measures all of them, or with None `frame.frame_axes`.
      options: passed to `Figure.subplots`, for instance `sharex`.

    Returns:
      The figure and its axes, shape (rows, columns).
    """
    figure = Figure(figsize=(width, height), layout=layout)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, axes


def label_axes(axes: Axes, *, title: str = "", x: str = "", y: str = "") -> None:
    """Set the title and the labels (with their units) of one set of axes."""
    axes.set_title(title)
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def label_log_axis(axes: Axes) -> None:
    """Put plain numbers along a logarithmic horizontal axis whose limits are set: 1, 2 and 5 of a decade, or 1 alone.

    Matplotlib's own are powers of ten with ticks between them, which take longer to draw than all the rest.
    """
    low, high = axes.get_xlim()
    steps = (1.0, 2.0, 5.0) if high < _MANY_DECADES * low else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=steps, numticks=20))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_locator(NullLocator())


def save_figure(path: Path, figure: Figure) -> None:
    """Write a figure whole, in the format that the ending of `path` names (.svg, .png, .pdf).

    Raises:
      InputError: if the ending is another, or the folder can't be written.
    """
    kind = path.suffix.removeprefix(".").lower()
    if kind not in {"svg", "png", "pdf"}:
        raise InputError(f'{path}: a figure can\'t be written as "{path.suffix}"; name it .svg, .png or .pdf')
    storage.write_bytes(path, _rendered(figure, kind))


def svg_text(figure: Figure, *, prefix: str = "", label: str = "") -> str:
    """Return a figure as an <svg> element to be put into a page.

    Args:
      figure: the figure.
      prefix: goes before every id, so that several figures can share a page.
      label: what a screen reader says in place of the picture.

    Returns:
      The element, without XML declaration and document type.
    """
    text = _rendered(figure, "svg").decode()
    element = text[text.index("<svg") :]
    if prefix:
        element = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{prefix}-", element)
    described = f'<svg role="img" aria-label="{escape(label, quote=True)}"' if label else '<svg role="img"'
    return element.replace("<svg", described, 1)


def _rendered(figure: Figure, kind: str) -> bytes:
    stream = io.BytesIO()
    # Without these keys Matplotlib stamps the file with the current time.
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[kind]
    with plot_style():
        figure.savefig(stream, format=kind, metadata=metadata)
    return stream.getvalue()
