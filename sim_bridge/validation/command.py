"""`sim-bridge validate`: the acceptance table from the command line, and as a page with curves."""

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.files import write_text
from rt_controller.report.page import (
    Links,
    Page,
    Part,
    Plot,
    Section,
    render_page,
    require_report_extra,
)
from rt_controller.report.table import print_table
from rt_controller.terminal.progress import announce
from sim_bridge.validation.acceptance import (
    TESTS,
    LineResult,
    acceptance_table,
    count_sentence,
    drive_all,
)
from sim_bridge.validation.run import Curve, Measured

if TYPE_CHECKING:  # matplotlib is of the extra `report`
    from matplotlib.figure import Figure


def validate(
    car: str | None = None, html: Path | None = None, json_file: Path | None = None
) -> int:
    """Drive the acceptance tests and print the table; 1 if a line missed its target."""
    require_writable(json_file)
    if html is not None:
        require_writable(html, "--html")
        require_report_extra("--html")
    with announce("driving"):
        results, measured = drive_all(car)
    console = Console()
    print_table(acceptance_table(results), console)
    write_figures(json_file, [line._asdict() for line in results])
    if html is not None:
        title = f"Acceptance of {Path(car).name if car else 'the shipped cars'}, {date.today()}"
        write_text(html, _page(results, measured, title))
    console.print(count_sentence(results))
    return int(any(line.ok is False for line in results))


def _page(results: Sequence[LineResult], measured: Mapping[int, Measured], title: str) -> str:
    """The table as HTML, with a section for each test, and links to those with misses."""
    sections = []
    headings = {number: f"{number} · {test.title}" for number, test in TESTS.items()}
    for number, test in TESTS.items():
        table = acceptance_table([line for line in results if line.test == number], True)
        curves = measured[number].curves
        plots = (Plot(_draw(curves)),) if curves else ()
        sections.append(Section(headings[number], (test.text, table, *plots)))
    missed = tuple((line.name, headings[line.test]) for line in results if line.ok is False)
    links: tuple[Part, ...] = (Links("Missed:", missed),) if missed else ()
    return render_page(Page(title, tuple(sections), (f"{count_sentence(results)}.", *links)))


def _draw(curves: Sequence[Curve]) -> "Figure":
    """A panel for each pair of axes."""
    from rt_controller.report.canvas import add_legend, empty_figure, line_styles

    titles = list(dict.fromkeys(curve[:2] for curve in curves))
    styles = line_styles(list(dict.fromkeys(curve.name for curve in curves)), ())
    figure, panels = empty_figure(1, len(titles), 3.2)
    for panel, (x_title, y_title) in zip(panels, titles, strict=True):
        panel.set(xlabel=x_title, ylabel=y_title)
        for curve in curves:
            if curve[:2] == (x_title, y_title):
                panel.plot(curve.x, curve.y, label=curve.name, **styles[curve.name])
    if len(styles) > 1:
        add_legend(figure, panels[0])
    return figure
