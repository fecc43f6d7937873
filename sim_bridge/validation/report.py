"""The acceptance table for the terminal and the HTML page with its figures."""

from itertools import groupby

from rt_controller.report.page import Links, Page, Part, Plot, Section, render_page
from rt_controller.report.table import Cell, Column, Row, Table, format_number
from sim_bridge.validation.acceptance import TESTS, LineResult, count_sentence
from sim_bridge.validation.measurements import Measurements

_COLUMNS = (
    Column("line", is_text=True),
    Column("", is_text=True, width="short"),
    Column("reached"),
    Column("target"),
    Column("tolerance"),
    Column("unit", is_text=True, width="short"),
    Column("fitted", is_text=True, width="short"),
)


def acceptance_table(results: list[LineResult], has_sources: bool = False) -> Table:
    """The lines with a heading for each test and car; the sources of the targets make it wide."""
    rows: list[Row] = []
    for (test, car), lines in groupby(results, key=lambda line: (line.test, line.car)):
        rows.append((f"test {test}, {car}",))
        for line in lines:
            row: Row = (
                line.name,
                _mark(line),
                format_number(line.reached),
                "" if line.target is None else format_number(line.target),
                line.tolerance or "",
                line.unit,
                "fitted" if line.fitted else "",
            )
            rows.append((*row, line.source or "") if has_sources else row)
    columns = (*_COLUMNS, Column("source of the target", is_text=True, width="long"))
    return Table("", columns if has_sources else _COLUMNS, tuple(rows))


def _mark(line: LineResult) -> Cell:
    """Whether the line passes; a line that is not judged shows a miss too."""
    if line.ok is not None:
        return Cell("ok", status="good") if line.ok else Cell("MISSED", status="bad")
    if line.is_within is False:
        return Cell("missed, not judged", status="bad")
    return Cell("reported", status="faint")


def acceptance_page(measured: Measurements, title: str) -> str:
    """The whole page as HTML, with a section for each test, and links to those with misses.

    Raises:
        MissingExtraError: the extra `report` is not installed.
    """
    from sim_bridge.validation.plots.acceptance import FIGURES

    sections = []
    for number, test in TESTS.items():
        lines = [line for line in measured.results if line.test == number]
        if lines:
            plots = (Plot(draw(measured)) for draw in FIGURES.get(number, ()))
            parts: tuple[Part, ...] = (test.text, acceptance_table(lines, True), *plots)
            sections.append(Section(_heading(number), parts))
    introduction: tuple[Part, ...] = (f"{count_sentence(measured.results)}.",)
    missed = [line for line in measured.results if line.ok is False]
    if missed:
        targets = tuple((line.name, _heading(line.test)) for line in missed)
        introduction += (Links("Missed:", targets),)
    return render_page(Page(title, tuple(sections), introduction))


def _heading(test: int) -> str:
    return f"{test} · {TESTS[test].title}"
