"""Paper and pencils of the report's plots."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

INK, FAINT = "#1f2933", "#8a97a5"
_STRONG = ("#2f6fb3", "#d9822b", "#3c9d6b", "#7b5ea7", "#c0392b", "#4b9fb5")
_MUTED = ("#7b8794", "#c08552", "#4f9d86", "#9b7bb8", "#c9736b", "#5b86a8")
LABEL_WIDTH_IN, LABEL_HEIGHT_IN = 0.5, 0.25
"""of a number at an axis, with room around it"""
_DASHES = ("--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)))

_STYLE: Any = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 9,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e9ee",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "svg.hashsalt": "rt-controller",
}


@dataclass(frozen=True, slots=True)
class Pen:
    """How a model is drawn in every plot."""

    color: str
    dashes: str | tuple[int, tuple[int, ...]]
    width: float


def pens(judged: Sequence[str], rivals: Sequence[str]) -> dict[str, Pen]:
    """Judged models in strong colours, rivals in muted ones and dashed."""
    strong = {name: Pen(_STRONG[i % len(_STRONG)], "-", 1.8) for i, name in enumerate(judged)}
    muted = {
        name: Pen(_MUTED[i % len(_MUTED)], _DASHES[i % len(_DASHES)], 1.3)
        for i, name in enumerate(rivals)
    }
    return strong | muted


def blank(
    rows: int, columns: int, height_in: float, sharex: bool = False, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure as wide as the page, with its panels in reading order."""
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(10.4, height_in), layout="constrained")
        grid = figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False)
    return figure, list(grid.ravel())


def log_scale(axes: Axes, which: str) -> None:
    """A logarithmic axis, "x" or "y", with plain numbers at it."""
    getattr(axes, f"set_{which}scale")("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    is_long = high > 100.0 * low
    if is_long:
        locator = LogLocator(numticks=_labels_along(axes, which))
    else:
        locator = LogLocator(subs=(1.0, 2.0, 5.0), numticks=12)
    axis.set_major_locator(locator)
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
    if not is_long:
        axis.set_minor_locator(NullLocator())


def _labels_along(axes: Axes, which: str) -> int:
    """How many numbers of up to five digits have room at an axis."""
    box = axes.get_window_extent()
    inches = (box.width if which == "x" else box.height) / axes.figure.dpi
    return max(2, int(inches / (LABEL_WIDTH_IN if which == "x" else LABEL_HEIGHT_IN)))


def as_svg(figure: Figure) -> str:
    """The drawing as an element of a page; the same figures make the same bytes."""
    file = StringIO()
    with matplotlib.rc_context(_STYLE):
        figure.savefig(file, format="svg", metadata={"Date": None})
    text = file.getvalue()
    return text[text.index("<svg") :]


def add_legend(figure: Figure, axes: Axes) -> None:
    """One legend for all panels, above them."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", ncols=min(4, len(labels)), frameon=False
    )
