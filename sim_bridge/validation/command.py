"""`sim-bridge validate`: the acceptance table from the command line."""

import json
from collections.abc import Callable
from dataclasses import asdict
from itertools import groupby
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.contract.figures import require_writable
from sim_bridge.validation.acceptance import Verdict, has_failed
from sim_bridge.validation.findings import Findings, fleet, investigate, verdicts

_MARKS = {True: "[green]ok[/green]", False: "[red]MISSED[/red]", None: "[dim]reported[/dim]"}

_LEAST_WIDTH = 100
"""of the table, also where no terminal tells how wide it is"""


def validate(
    *,
    car: str | None = None,
    html: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    quick: bool = False,
) -> int:
    """Drive the acceptance tests and hold the car against its targets; 1 if a line missed.

    Parameters
    ----------
    car
        drive all tests with this car; without it, each with the car that its targets belong to
    html
        write tables and plots to this page
    json_file
        write the lines to this file: test, name, car, target, reached, tolerance, ok
    quick
        leave the slowest sines of the frequency response out; every line is judged all the same
    """
    console = Console()
    console.width = max(console.width, _LEAST_WIDTH)
    require_writable(json_file)
    page = None if html is None else _page_for(html)
    with console.status("driving (the first start compiles the car: about a minute)"):
        findings = investigate(fleet(car), quick)
    lines = verdicts(findings)
    console.print(_table(lines))
    if json_file is not None:
        json_file.write_text(json.dumps([_figures(v) for v in lines], indent=2) + "\n", "utf-8")
    if html is not None and page is not None:
        html.write_text(page(findings, lines), "utf-8")
    missed = sum(line.ok is False for line in lines)
    judged = sum(line.ok is not None for line in lines)
    console.print(f"{judged - missed} of {judged} lines hold, {len(lines) - judged} reported")
    return int(has_failed(lines))


def _page_for(html: Path) -> Callable[[Findings, list[Verdict]], str]:
    """What draws the page, known to be installed and to have somewhere to write to."""
    try:
        html.open("a", encoding="utf-8").close()
        from sim_bridge.validation.report import page
    except OSError as error:
        raise ConfigError(
            f"--html {html}: expected a file that can be written, found {error.strerror}. Name "
            f"another file, in a folder that exists."
        ) from error
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"--html needs {error.name}: expected the extra [report], found it missing. Install "
            f'it with: pip install -e ".[report]"'
        ) from error
    return page


def _table(lines: list[Verdict]) -> Table:
    table = Table(show_edge=False, header_style="bold")
    table.add_column("#", justify="right")
    table.add_column("line")
    for name in ("target", "reached", "tolerance"):
        table.add_column(name, justify="right")
    table.add_column("unit")
    table.add_column("")
    for (test, car), group in groupby(lines, key=lambda line: (line.test, line.car)):
        table.add_section()
        table.add_row("", f"[bold]{escape(car)}[/bold]")
        for line in group:
            table.add_row(
                str(test),
                line.name,
                "" if line.target is None else f"{line.target:.4g}",
                f"{line.reached:.4g}",
                line.tolerance or "",
                line.unit,
                _MARKS[line.ok],
            )
    return table


def _figures(line: Verdict) -> dict[str, Any]:
    """JSON knows no NaN: what could not be measured is null."""
    return {**asdict(line), "reached": line.reached if isfinite(line.reached) else None}
