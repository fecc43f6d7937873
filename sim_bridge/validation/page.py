"""The acceptance table as an HTML page, with the curves of the tests."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rt_controller.report.page import Links, Page, Part, Plot, Section, render_page
from sim_bridge.validation.acceptance import TESTS, LineResult, acceptance_table, count_sentence
from sim_bridge.validation.manoeuvres import Curve, Measured

if TYPE_CHECKING:  # matplotlib is of the extra `report`
    from matplotlib.figure import Figure


def acceptance_page(
    results: Sequence[LineResult], measured: Mapping[int, Measured], title: str
) -> str:
    """The whole page as HTML, with a section for each test, and links to those with misses.

    Raises:
        MissingExtraError: the extra `report` is not installed.
    """
    sections = []
    for number, test in TESTS.items():
        lines = [line for line in results if line.test == number]
        curves = measured[number].curves
        plots = (Plot(_draw(curves)),) if curves else ()
        parts: tuple[Part, ...] = (test.text, acceptance_table(lines, True), *plots)
        sections.append(Section(_heading(number), parts))
    missed = tuple((line.name, _heading(line.test)) for line in results if line.ok is False)
    links: tuple[Part, ...] = (Links("Missed:", missed),) if missed else ()
    return render_page(Page(title, tuple(sections), (f"{count_sentence(results)}.", *links)))


def _heading(test: int) -> str:
    return f"{test} · {TESTS[test].title}"


def _draw(curves: Sequence[Curve]) -> "Figure":
    """A panel for each pair of axes."""
    from rt_controller.report.canvas import add_legend, empty_figure, line_styles

    titles = list(dict.fromkeys((curve.x_title, curve.y_title) for curve in curves))
    styles = line_styles(list(dict.fromkeys(curve.name for curve in curves)), ())
    figure, panels = empty_figure(1, len(titles), 3.2)
    for panel, (x_title, y_title) in zip(panels, titles, strict=True):
        panel.set(xlabel=x_title, ylabel=y_title)
        for curve in curves:
            if (curve.x_title, curve.y_title) == (x_title, y_title):
                panel.plot(curve.x, curve.y, label=curve.name, **styles[curve.name])
    if len(styles) > 1:
        add_legend(figure, panels[0])
    return figure
