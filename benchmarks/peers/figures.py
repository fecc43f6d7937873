"""The standings, for people and for programs."""

import platform
from collections.abc import Iterable, Sequence
from typing import Any

from rich.table import Table

from benchmarks.peers.entrants.roster import Entrant
from benchmarks.peers.nonlinear.outcome import Summary
from benchmarks.peers.race import EXACT_ENOUGH, Mode
from benchmarks.peers.ratio import Ratio
from benchmarks.peers.standings import Standing

Found = tuple[str, str, str, Mode, list[Standing]]
"""model, scenario, tier, mode, standings"""
Driven = tuple[str, str, list[Summary]]
"""model, scenario, one summary for each controller"""


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
            str(one.p50_over_cold),
            str(one.p99_over_cold),
            str(one.p50_over_default),
            _error(one),
            "" if one.tolerance is None else f"{one.tolerance:g}",
        )
    return table


def duel_table(title: str, summaries: Sequence[Summary]) -> Table:
    """One drive, the fastest plan first."""
    table = Table(title=title, title_justify="left")
    heads = ("controller", "plan p50 us", "p99 us", "max us", "prepare p50 us", "p50 / default")
    for head in (*heads, "with prepare", "e_y RMS m", "peak m", "v_x RMS m/s"):
        table.add_column(head, justify="left" if head == "controller" else "right", no_wrap=True)
    for one in sorted(summaries, key=lambda summary: summary.plan_p50_us):
        table.add_row(
            one.name,
            f"{one.plan_p50_us:.0f}",
            f"{one.plan_p99_us:.0f}",
            f"{one.plan_max_us:.0f}",
            f"{one.prepare_p50_us:.0f}",
            str(one.plan_p50_over_default),
            str(one.both_p50_over_default),
            f"{one.ey_rms_m:.3f}",
            f"{one.ey_peak_m:.3f}",
            f"{one.vx_rms_mps:.3f}",
        )
    return table


def to_json(
    found: Iterable[Found],
    duels: Iterable[Driven],
    everybody: Iterable[Entrant],
    missing: list[str],
    rounds: int,
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
        "closed_loop": [
            {
                "model": model,
                "scenario": scenario,
                "controllers": {one.name: _plain(one) for one in summaries},
            }
            for model, scenario, summaries in duels
        ],
    }


def _plain(one: Standing | Summary) -> dict[str, Any]:
    return {
        name: value._asdict() if isinstance(value, Ratio) else value
        for name, value in one._asdict().items()
        if name != "name"
    }


def _error(one: Standing) -> str:
    words = f"{one.first_input_error:.0e}"
    if one.unsolved:
        return f"{words}, {one.unsolved} unsolved"
    return words if one.first_input_error <= EXACT_ENOUGH else f"{words}, too large"
