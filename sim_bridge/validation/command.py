"""`sim-bridge validate`: the acceptance table from the command line."""

from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.report.page import require_report_extra
from rt_controller.report.table import print_table
from rt_controller.terminal.progress import announce
from sim_bridge.validation.acceptance import count_sentence, has_failed
from sim_bridge.validation.measurements import measure_all
from sim_bridge.validation.report import acceptance_page, acceptance_table

_LEAST_WIDTH = 100
"""of the printed table, also if the output is no terminal"""


def validate(
    car: str | None = None,
    html: Path | None = None,
    json_file: Path | None = None,
    quick: bool = False,
) -> int:
    """Drive the acceptance tests and print the table; 1 if a line missed its target."""
    require_writable(json_file)
    if html is not None:
        require_writable(html, "--html")
        require_report_extra("--html")
    with announce("driving (the first start compiles the car: up to a minute)"):
        measured = measure_all(car, quick)
    results = measured.results
    console = Console()
    console.width = max(console.width, _LEAST_WIDTH)
    print_table(acceptance_table(results), console)
    if json_file is not None:
        write_figures(json_file, [asdict(line) for line in results])
    if html is not None:
        html.write_text(acceptance_page(measured), encoding="utf-8")
    console.print(count_sentence(results))
    return int(has_failed(results))
