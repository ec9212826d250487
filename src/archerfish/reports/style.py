"""One style for every plot, drawn without pyplot's global state.

A plot is made inside `plot_style()` from `new_figure`. It is saved with its own `savefig`, or put into a page by
`svg_text`; the same figure gives the same bytes on every run. Matplotlib is imported when the first plot is made.
"""

import functools
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    import matplotlib.figure

Figure: TypeAlias = "matplotlib.figure.Figure"
"""Named here without loading Matplotlib."""

INK = "#222222"
MUTED = "#767676"

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", INK)
"""The colours of Okabe and Ito (less the yellow, too pale on white): distinct with every colour vision."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (5, 1.2, 1.2, 1.2)))

_SETTINGS: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.5,
    "lines.markersize": 5.5,
    "figure.dpi": 150.0,
    "figure.constrained_layout.h_pad": 0.07,  # [inch]; else titles touch the labels above them
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    # Text as outlines: the page looks alike on machines without the font.
    "svg.fonttype": "path",
    "svg.hashsalt": "archerfish",
}


@contextmanager
def plot_style() -> Iterator[None]:
    """Apply the style to what is drawn inside the block, and only to that."""
    import matplotlib as mpl
    from cycler import cycler

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        mpl.rcParams["axes.prop_cycle"] = cycler(color=PALETTE)
        yield


def new_figure(
    rows: int = 1, columns: int = 1, *, width: float = 7.2, height: float = 3.2, **options: Any
) -> tuple[Figure, Any]:
    """Make a figure with a grid of axes, inside `plot_style()`.

    Args:
      rows: of axes.
      columns: of axes.
      width: of the figure [inch].
      height: of the figure [inch].
      options: passed to `Figure.subplots`, for instance `sharex`.

    Returns:
      The figure and its axes, an object array of shape (rows, columns).
    """
    from matplotlib import figure as figures

    figure: Any = figures.Figure(figsize=(width, height), layout="constrained")
    figure._repr_png_ = functools.partial(_png, figure)  # else notebooks show a figure only if pyplot has made it
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    with plot_style():
        figure.savefig(stream, format="png")
    return stream.getvalue()


def look(index: int) -> dict[str, Any]:
    """Return colour, marker and line style of a curve; no two of the first 56 have colour and marker alike."""
    color, marker = PALETTE[index % len(PALETTE)], MARKERS[index % len(MARKERS)]
    return {"color": color, "marker": marker, "linestyle": DASHES[index // len(PALETTE) % len(DASHES)]}


def svg_text(figure: Figure, *, prefix: str = "", label: str = "") -> str:
    """Return a figure as an <svg> element for a page.

    Args:
      figure: of any size.
      prefix: goes before every id, so that several figures can share a page.
      label: alternative text for screen readers.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    canvas: Any = FigureCanvasSVG(figure)
    stream = io.StringIO()
    with plot_style():  # `savefig` would draw twice, once for the layout alone
        canvas.print_svg(stream, metadata={"Date": None})  # else stamped with the current time
    text = stream.getvalue()
    element = text[text.index("<svg") :]
    if prefix:
        element = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{prefix}-", element)
    return element.replace("<svg", f'<svg role="img" aria-label="{escape(label, quote=True)}"', 1)
