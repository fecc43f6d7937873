"""The standings, for people and for programs."""

import platform
from collections.abc import Iterable, Sequence
from typing import Any

from rich.table import Table

from benchmarks.peers.entrants.roster import Entrant
from benchmarks.peers.race import EXACT_ENOUGH, Mode
from benchmarks.peers.standings import Ratio, Standing

Found = tuple[str, str, str, Mode, list[Standing]]
"""model, scenario, tier, mode, standings"""


def to_table(title: str, standings: Sequence[Standing]) -> Table:
    """One recording, fastest first."""
    table = Table(title=title, title_justify="left")
    heads = ("solver", "p50 us", "p99 us", "max us", "p50 / PIQP cold", "p99 / PIQP cold")
    for head in (*heads, "p50 / default", "error of u_0", "tolerance"):
        table.add_column(head, justify="left" if head == "solver" else "right", no_wrap=True)
    for one in sorted(standings, key=lambda standing: standing.p50_us):
        table.add_row(
            one.name,
            f"{one.p50_us:.0f}",
            f"{one.p99_us:.0f}",
            f"{one.max_us:.0f}",
            _spread(one.p50_over_cold),
            _spread(one.p99_over_cold),
            _spread(one.p50_over_default),
            _error(one),
            "" if one.tolerance is None else f"{one.tolerance:g}",
        )
    return table


def to_json(
    found: Iterable[Found], everybody: Iterable[Entrant], missing: list[str], rounds: int
) -> dict[str, Any]:
    """All standings; times in microseconds, errors as shares of an input's range."""
    return {
        "machine": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        "rounds": rounds,
        "versions": {entrant.name: entrant.version for entrant in everybody},
        "not_installed": missing,
        "recordings": [
            {
                "model": model,
                "scenario": scenario,
                "tier": tier,
                "mode": mode.value,
                "solvers": {one.name: _plain(one) for one in standings},
            }
            for model, scenario, tier, mode, standings in found
        ],
    }


def _plain(one: Standing) -> dict[str, Any]:
    return {
        name: value._asdict() if isinstance(value, Ratio) else value
        for name, value in one._asdict().items()
        if name != "name"
    }


def _spread(ratio: Ratio) -> str:
    return f"{ratio.median:.2f} ({ratio.least:.2f}–{ratio.most:.2f})"


def _error(one: Standing) -> str:
    words = f"{one.first_input_error:.0e}"
    if one.unsolved:
        return f"{words}, {one.unsolved} unsolved"
    return words if one.first_input_error <= EXACT_ENOUGH else f"{words}, too large"
