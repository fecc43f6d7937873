"""`python -m benchmarks.growth`: horizons, latents, and where the states belong into the QP."""

import sys
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from rich.console import Console
from rich.table import Table

from benchmarks.growth.measure import CONDENSED, DAQP, STAGED, WARM, Cell, measure
from benchmarks.growth.sizes import HORIZONS, LATENTS, widened
from rt_controller.contract.artifact import load_bundle
from rt_controller.contract.figures import write_figures
from rt_controller.session import shipped_model

COLUMNS = (CONDENSED, WARM, DAQP, STAGED)

app = cyclopts.App(name="python -m benchmarks.growth", version_flags=[])


@app.default
def main(
    *,
    horizons: tuple[int, ...] = HORIZONS,
    latents: tuple[int, ...] = LATENTS,
    ticks: int = 60,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> int:
    """The time of one solve against the size of the problem.

    Parameters
    ----------
    horizons
        Stages of 25 ms.
    latents
        Observables beside the six states.
    ticks
        Solves of each.
    json
        The same figures for a program.
    """
    console = Console()
    linear = load_bundle(shipped_model("lti"))
    table = Table(title="median / p99 of a solve in us", title_justify="left")
    for head in ("stages", "latents", *COLUMNS, "rule"):
        table.add_column(head, justify="right", no_wrap=True)
    cells = []
    for count in latents:
        for horizon in horizons:
            with console.status(f"{horizon} stages, {count} latents"):
                cells.append(measure(widened(linear, count), count, horizon, ticks))
            table.add_row(*_row(cells[-1]))
    console.print(table)
    wrong = [cell for cell in cells if not _is_rule_right(cell)]
    console.print(f"the rule picks the slower form in {len(wrong)} of {len(cells)} sizes")
    for cell in wrong:
        loss = cell.p50_us[CONDENSED] / cell.p50_us[STAGED]
        loss = 1.0 / loss if cell.is_staged_by_rule else loss
        console.print(f"  {cell.horizon} stages, {cell.latents} latents: {loss:.2f} times slower")
    write_figures(json, {"ticks": ticks, "sizes": [_plain(cell) for cell in cells]})
    return 0


def _row(cell: Cell) -> list[str]:
    times = [
        f"{cell.p50_us[name]:.0f}/{cell.p99_us[name]:.0f}" if name in cell.p50_us else ""
        for name in COLUMNS
    ]
    rule = "staged" if cell.is_staged_by_rule else "condensed"
    return [str(cell.horizon), str(cell.latents), *times, rule]


def _is_rule_right(cell: Cell) -> bool:
    if STAGED not in cell.p50_us:
        return not cell.is_staged_by_rule
    return cell.is_staged_by_rule == (cell.p50_us[STAGED] < cell.p50_us[CONDENSED])


def _plain(cell: Cell) -> dict[str, Any]:
    return cell._asdict()


if __name__ == "__main__":
    sys.exit(app())
