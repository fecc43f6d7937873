"""Empty figures of matplotlib in the style of the reports, and their form as SVG."""

from collections.abc import Sequence
from io import BytesIO, StringIO
from itertools import cycle
from typing import Any, Literal

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

PAGE_IN = 10.4
"""width of a page"""
COLUMNS = 5
"""of a legend"""
INK, FAINT, GRID = "#1f2933", "#8a97a5", "#e4e9ee"
STRONG = ("#2f6fb3", "#d9822b", "#3c9d6b", "#7b5ea7", "#c0392b", "#4b9fb5")
_MUTED = ("#7b8794", "#c08552", "#4f9d86", "#9b7bb8", "#c9736b", "#5b86a8")
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
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "svg.hashsalt": "rt-controller",
}


def line_styles(main: Sequence[str], others: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Arguments of `Axes.plot` by name: strong colours for `main`, muted and dashed `others`."""
    strong = {
        name: {"color": color, "linestyle": "-", "linewidth": 1.8}
        for name, color in zip(main, cycle(STRONG), strict=False)
    }
    return strong | {
        name: {"color": color, "linestyle": dashes, "linewidth": 1.3}
        for name, color, dashes in zip(others, cycle(_MUTED), cycle(_DASHES), strict=False)
    }


class PageFigure(Figure):
    """A figure that a notebook shows as the value of a cell, without a plotting backend."""

    def _repr_png_(self) -> bytes:
        image = BytesIO()
        self.savefig(image, format="png")
        return image.getvalue()


def empty_figure(
    rows: int, columns: int, height_in: float, sharex: bool = False, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure as wide as the page, and its panels row by row."""
    with matplotlib.rc_context(_STYLE):
        figure = PageFigure(figsize=(PAGE_IN, height_in), layout="constrained")
        grid = figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False)
    return figure, list(grid.ravel())


def figure_under_head(
    rows: int, head_in: float, height_in: float
) -> tuple[Figure, Axes, list[Axes]]:
    """A figure as wide as the page: a panel of this height, and rows with one x axis below it."""
    with matplotlib.rc_context(_STYLE):
        figure = PageFigure(figsize=(PAGE_IN, head_in + height_in), layout="constrained")
        ratios = [head_in, *[height_in / rows] * rows]
        grid = figure.add_gridspec(rows + 1, 1, height_ratios=ratios)
        head, first = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
        others = [figure.add_subplot(grid[2 + k], sharex=first) for k in range(rows - 1)]
    for axes in [first, *others][:-1]:
        axes.tick_params(labelbottom=False)
    return figure, head, [first, *others]


def set_log_scale(axes: Axes, which: Literal["x", "y"]) -> None:
    """Make an axis logarithmic and label it with plain numbers."""
    getattr(axes, f"set_{which}scale")("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    if high > 100.0 * low:
        # as many numbers of up to five digits as fit along the axis
        box = axes.get_window_extent()
        size, label_in = (box.width, 0.5) if which == "x" else (box.height, 0.25)
        labels = int(size / axes.figure.dpi / label_in)
        axis.set_major_locator(LogLocator(numticks=max(2, labels)))
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
        axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def add_legend(figure: Figure, axes: Axes) -> None:
    """Add one legend above all panels, with the curves of `axes`."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", ncols=min(4, len(labels)), frameon=False
    )


def add_legend_above(axes: Axes) -> None:
    """Add the legend of one panel above it, where no curve is, in rows from left to right."""
    entries = list(zip(*axes.get_legend_handles_labels(), strict=True))
    by_column = [entry for first in range(COLUMNS) for entry in entries[first::COLUMNS]]
    handles, labels = zip(*by_column, strict=True)
    axes.legend(
        handles, labels, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=COLUMNS,
        borderaxespad=0.0, frameon=False,
    )  # fmt: skip


def to_svg(figure: Figure) -> str:
    """The figure as an SVG element; the same figure gives the same bytes."""
    file = StringIO()
    with matplotlib.rc_context(_STYLE):
        figure.savefig(file, format="svg", metadata={"Date": None})
    text = file.getvalue()
    return text[text.index("<svg") :]
