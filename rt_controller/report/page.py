"""One HTML page for all reports: sections of text, tables and plots in a single file.

The page loads nothing from the network. Plots of matplotlib are part of it as SVG and need no
script; if a plot is of plotly, plotly.js is part of the page once.

    page = Page("Acceptance of the car", (
        Section("Braking", ("150 N at the pedal.", table, Plot(figure, "Speed."))),
    ))
    write_text(file, render_page(page))
"""

import re
from itertools import count
from typing import Any, NamedTuple

from rt_controller.contract.errors import require_packages
from rt_controller.report.table import Table

NEEDED = ("jinja2", "matplotlib", "plotly")


class Bullets(NamedTuple):
    """A list of sentences."""

    items: tuple[str, ...]


class Links(NamedTuple):
    """A sentence that ends with links to sections."""

    text: str
    targets: tuple[tuple[str, str], ...]
    """text of the link, title of the section"""


class Plot(NamedTuple):
    """A plot with its caption."""

    figure: Any
    """`matplotlib.figure.Figure` or `plotly.graph_objects.Figure`"""
    caption: str = ""

    @property
    def is_plotly(self) -> bool:
        """True if the page needs plotly.js for it."""
        return type(self.figure).__module__.startswith("plotly.")


class Details(NamedTuple):
    """Tables that are hidden until the reader opens them."""

    title: str
    parts: tuple[Table, ...]


Part = str | Bullets | Links | Table | Plot | Details
"""a string is a paragraph of plain text; all texts are escaped"""


class Section(NamedTuple):
    """A heading and what follows it."""

    title: str
    parts: tuple[Part, ...]


class Page(NamedTuple):
    """Everything that the page shows, in order."""

    title: str
    sections: tuple[Section, ...]
    introduction: tuple[Part, ...] = ()


def require_report_extra(option: str) -> None:
    """Return if the packages of the extra `report` are installed; `option` is what needs them.

    Raises:
        MissingExtraError: one is missing.
    """
    require_packages("report", NEEDED, option)


def render_page(page: Page) -> str:
    """The page as HTML; the same content gives the same bytes.

    Raises:
        MissingExtraError: the extra `report` is not installed.
    """
    require_report_extra("an HTML page")
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from rt_controller.report.canvas import to_svg

    environment = Environment(
        loader=PackageLoader("rt_controller.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["keep_percent"] = lambda text: text.replace(" %", "\u00a0%")
    environment.filters["anchor"] = lambda title: re.sub(r"[^a-z0-9]+", "-", title.lower())
    environment.filters["kind"] = lambda part: type(part).__name__
    numbers = count()

    def draw(plot: Plot) -> str:
        if not plot.is_plotly:
            return to_svg(plot.figure)
        number = next(numbers)
        html: str = plot.figure.to_html(
            full_html=False,
            include_plotlyjs=number == 0,
            div_id=f"plot-{number}",
            config={"displayModeBar": False, "responsive": True},
        )
        return html

    def has_plotly() -> bool:
        return next(numbers) > 0

    return environment.get_template("page.html.j2").render(
        page=page, draw=draw, has_plotly=has_plotly
    )
