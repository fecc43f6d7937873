"""The acceptance table for the terminal and the HTML page with its figures."""

from itertools import groupby

from rt_controller.report.page import Page, Part, Plot, Section, render_page
from rt_controller.report.table import Cell, Column, Row, Table
from sim_bridge.validation.acceptance import TESTS, LineResult, count_sentence
from sim_bridge.validation.measurements import Measurements

_COLUMNS = (
    Column("line", is_text=True),
    Column("target"),
    Column("reached"),
    Column("tolerance"),
    Column("unit", is_text=True),
    Column("", is_text=True),
)
_MARKS = {
    True: Cell("ok", status="good"),
    False: Cell("MISSED", status="bad"),
    None: Cell("reported", status="faint"),
}


def acceptance_table(results: list[LineResult]) -> Table:
    """The lines with a heading for each test and car."""
    rows: list[Row] = []
    for (test, car), lines in groupby(results, key=lambda line: (line.test, line.car)):
        rows.append((f"test {test}, {car}",))
        rows += [
            (
                line.name,
                "" if line.target is None else f"{line.target:.4g}",
                f"{line.reached:.4g}",
                line.tolerance or "",
                line.unit,
                _MARKS[line.ok],
            )
            for line in lines
        ]
    return Table("", _COLUMNS, tuple(rows))


def acceptance_page(measured: Measurements) -> str:
    """The whole page as HTML, with a section for each test.

    Raises:
        MissingExtraError: the extra `report` is not installed.
    """
    from sim_bridge.validation.figures import FIGURES

    sections = []
    for number, test in TESTS.items():
        lines = [line for line in measured.results if line.test == number]
        if lines:
            plots = (Plot(draw(measured)) for draw in FIGURES.get(number, ()))
            parts: tuple[Part, ...] = (test.text, acceptance_table(lines), *plots)
            sections.append(Section(f"{number} · {test.title}", parts))
    introduction = (f"{count_sentence(measured.results)}.",)
    return render_page(Page("Acceptance of the car", tuple(sections), introduction))
