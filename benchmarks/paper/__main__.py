"""`python -m benchmarks.paper`: every table and figure of the paper, with the shipped models."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Literal

import cyclopts
from rich.console import Console

from benchmarks.figures.results import hashes_of
from benchmarks.figures.tables import rows_table
from benchmarks.paper import closed_loop, prediction, training
from benchmarks.paper.elements import Element, Figures
from offline.commands.options import JsonFile, Several
from rt_controller.contract.figures import require_folder, require_writable, write_figures
from rt_controller.contract.files import write_text
from rt_controller.contract.revision import source_revision
from rt_controller.report.canvas import to_svg
from rt_controller.report.page import Page, Part, Section, render_page, require_report_extra
from rt_controller.report.table import Table, print_table, print_text
from rt_controller.terminal.command_line import run_command

Name = Literal["table-1", "algorithm-1", "table-2", "figure-3", "figure-4", "computation-time"]
MEASURES: dict[Name, Callable[[Path], Element]] = {
    "table-1": lambda output: training.table_1(),
    "algorithm-1": lambda output: training.algorithm_1(output / "training"),
    "table-2": lambda output: prediction.table_2(output / "training"),
    "figure-3": lambda output: prediction.figure_3(),
    "figure-4": lambda output: closed_loop.figure_4(),
    "computation-time": lambda output: closed_loop.computation_time(),
}
COMPARABLE = (
    "The car of the paper is CarSim's, here it is the simulated car of this repository, so no "
    "number is comparable with the paper's; a ratio of two models is comparable in kind."
)

app = cyclopts.App(name="python -m benchmarks.paper", version_flags=[])


@app.default
def main(
    *,
    only: Annotated[tuple[Name, ...], Several] = (),
    output: Path = Path("runs/paper"),
    json: JsonFile = None,
) -> None:
    """Measure what the tables and figures of the paper show, and print both numbers.

    The data set is made on first use and kept in the cache. An interrupted training goes on.

    Args:
        only: these elements; default: all.
        output: folder of the page, paper.html, of its pictures and of the trainings.
    """
    require_report_extra("The page")
    require_writable(json)
    require_folder(output, "--output")
    output.mkdir(parents=True, exist_ok=True)
    found, wall_s = dict[Name, Element](), dict[str, float]()
    console = Console(stderr=True)
    for name in only or MEASURES:
        begun = time.monotonic()
        found[name] = MEASURES[name](output)
        wall_s[name] = time.monotonic() - begun
        console.print(f"{name}: {wall_s[name]:.0f} s", highlight=False)
    overview = Figures()
    for element in found.values():
        overview |= element.overview()
    table = rows_table(overview, "in the paper")
    print_table(table, Console())
    for element in found.values():
        for file, plot in element.plots.items():
            write_text(output / f"{file}.svg", to_svg(plot.figure))
    page = output / "paper.html"
    write_text(page, render_page(_page(table, found.values())))
    print_text(f"{COMPARABLE}\n{page}", Console())
    figures: Figures = {
        name: {"shows": each.shows, "summary": each.summary, "tables": dict(each.tables)}
        for name, each in found.items()
    }
    made_with = {"revision": source_revision(), "model_sha256": hashes_of(prediction.MODELS)}
    write_figures(json, {**made_with, "wall_s": wall_s, "overview": overview, **figures})


def _page(table: Table, elements: Iterable[Element]) -> Page:
    sections = []
    for each in elements:
        tables = (
            rows_table(rows, "", title=name.removeprefix("paper_").replace("_", " "))
            for name, rows in each.tables.items()
        )
        parts: tuple[Part, ...] = (each.shows, *tables, *each.plots.values())
        sections.append(Section(each.place, parts))
    title = "Tables and figures of the MDK-Net paper"
    return Page(title, tuple(sections), (COMPARABLE, table))


if __name__ == "__main__":
    run_command(app)
