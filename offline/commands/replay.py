"""The work of `offline-replay`: read logs, drive the simulated car with them, print the errors."""

from collections.abc import Sequence
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import Any

from offline.commands.terminal import STDERR, STDOUT
from offline.evaluation.replay import (
    LARGEST_LAG_S,
    SETTLING_S,
    SPEED_RATE,
    Comparison,
    replay_drive,
)
from offline.logs.recorded_drive import PERIOD_S, Window, load_drive
from rt_controller.report.table import NO_VALUE, Column, Row, Table, format_number, print_table
from sim_bridge.plant.parameters import load_parameters, with_road_friction

_COLUMNS = (
    Column("signal", is_text=True),
    Column("RMS recorded"),
    Column("RMS error"),
    Column("error", "%"),
    Column("gain"),
    Column("lag", "s"),
    Column("error at lag", "%"),
    Column("remark", is_text=True),
)
_GAINS = (1.0 / 3.0, 3.0)
"""beyond: km/h instead of m/s changes a gain by 3.6, g by 9.8, degrees by 57"""
_NOTES = (
    f"Open loop: recorded steering and speed; {SETTLING_S:g} s are left out after a start. A car "
    f"that spins is started again.",
    "gain: the car over the recording; lag: the recording after the car. Printed, not judged.",
)


def replay_logs(
    logs: Sequence[Path],
    car: str,
    columns: Sequence[str],
    period_s: float | None,
    window: Window,
    friction: float | None,
) -> list[dict[str, Any]]:
    """Figures of `offline-replay`.

    Raises:
        ConfigError: there is no such car, or a log cannot be used.
        DatasetError: a log cannot be read.
    """
    parameters = load_parameters(car)
    if friction is not None:
        parameters = with_road_friction(parameters, friction)
    drives = [load_drive(log, columns, period_s, window) for log in logs]
    with STDERR.status("driving"):
        results = [replay_drive(parameters, drive) for drive in drives]
    print_table(comparison_table(results), STDOUT)
    return [asdict(one) for comparisons in results for one in comparisons]


def comparison_table(results: Sequence[Sequence[Comparison]]) -> Table:
    """One row for each signal, with a heading for each recording."""
    rows: list[Row] = []
    for comparisons in results:
        of = comparisons[0]
        spins = "1 spin" if of.spins == 1 else f"{of.spins} spins"
        rows.append((f"{of.recording}: {of.compared_s:.1f} s compared, {spins}",))
        rows += [
            (
                f"{one.signal} (by the pedals)" if one.signal == SPEED_RATE else one.signal,
                format_number(one.rms_recorded),
                format_number(one.rms_error, 3),
                format_number(one.error_percent, 3),
                format_number(one.gain, 3),
                NO_VALUE if isnan(one.lag_s) else f"{one.lag_s:.3f}",
                format_number(one.error_at_lag_percent, 3),
                "; ".join(doubts(one)),
            )
            for one in comparisons
        ]
    return Table("", _COLUMNS, tuple(rows), _NOTES)


def doubts(one: Comparison) -> tuple[str, ...]:
    """What the figures of a signal say about its column."""
    found = (
        (one.gain < 0.0, "gain negative: wrong sign?"),
        (0.0 <= one.gain < _GAINS[0] or one.gain > _GAINS[1], "gain far from 1: wrong unit?"),
        (abs(one.lag_s) > LARGEST_LAG_S - 0.5 * PERIOD_S, "lag at the end of its search"),
    )
    return tuple(words for is_so, words in found if is_so)
