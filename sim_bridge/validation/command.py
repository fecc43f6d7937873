"""`sim-bridge validate`: the acceptance table from the command line."""

from pathlib import Path

from rich.console import Console

from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.report.table import print_table
from rt_controller.terminal.progress import announce
from sim_bridge.validation.acceptance import acceptance_table, count_sentence, drive_all


def validate(car: str | None = None, json_file: Path | None = None) -> int:
    """Drive the acceptance tests and print the table; 1 if a line missed its target."""
    require_writable(json_file)
    with announce("driving"):
        results = drive_all(car)
    console = Console()
    print_table(acceptance_table(results), console)
    write_figures(json_file, [line._asdict() for line in results])
    console.print(count_sentence(results))
    return int(any(line.ok is False for line in results))
