"""One HTML page for all reports: sections of text, tables and plots in a single file.

The page loads nothing from the network; plots are part of it as SVG. Only a `Player` has a script,
and is a still picture without it.

    page = Page("Acceptance of the car", (
        Section("Braking", ("150 N at the pedal.", table, Plot(figure, "Speed."))),
    ))
    save_page(page, file, "--html")
"""

import re
from pathlib import Path
from typing import Any, NamedTuple

from rt_controller.contract.errors import OutputError, require_packages
from rt_controller.contract.files import write_text
from rt_controller.report.player import Player
from rt_controller.report.table import Table

NEEDED = ("jinja2", "matplotlib")


class Plot(NamedTuple):
    """A plot with its caption."""

    figure: Any
    """`matplotlib.figure.Figure`"""
    caption: str = ""


Part = str | Table | Plot | Player
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
    environment.filters["svg"] = lambda plot: to_svg(plot.figure)
    return environment.get_template("page.html.j2").render(page=page)


def save_page(page: Page, file: Path, option: str) -> str:
    """Write the page; a line with its name and size. `option` is the one that named it.

    Raises:
        MissingExtraError: the extra `report` is not installed.
        OutputError: the file can no longer be written.
    """
    text = render_page(page)
    try:
        write_text(file, text)
    except OSError as error:
        raise OutputError(
            f"{option} {file}: expected room for the page, found {error.strerror}. The run itself "
            f"is done; only this file is missing. Free some space, or choose another folder."
        ) from error
    return f"{file}, {len(text.encode()) / 1e6:.1f} MB"
