"""`sim-bridge validate`: the acceptance table from the command line."""

from dataclasses import asdict
from datetime import date
from pathlib import Path

from rich.console import Console

from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.files import write_text
from rt_controller.report.page import require_report_extra
from rt_controller.report.table import print_table
from rt_controller.terminal.progress import announce
from sim_bridge.validation.acceptance import acceptance_table, count_sentence, drive_all
from sim_bridge.validation.page import acceptance_page

_LEAST_WIDTH = 150
"""of the printed table, also if the output is no terminal"""


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
    console.width = max(console.width, _LEAST_WIDTH)
    print_table(acceptance_table(results), console)
    write_figures(json_file, [asdict(line) for line in results])
    if html is not None:
        title = f"Acceptance of {Path(car).name if car else 'the shipped cars'}, {date.today()}"
        write_text(html, acceptance_page(results, measured, title))
    console.print(count_sentence(results))
    return int(any(line.ok is False for line in results))
