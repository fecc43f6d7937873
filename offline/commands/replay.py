"""`offline-replay`: drive the simulated car with recorded drives, and print the errors."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from offline.commands.options import JsonFile, Logs
from offline.commands.terminal import STDERR, STDOUT
from rt_controller.contract.errors import require_packages
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.terminal.command_line import new_app, run_command
from sim_bridge.plant.shipped_cars import DEFAULT_CAR

if TYPE_CHECKING:
    from offline.evaluation.replay import Comparison
    from rt_controller.report.table import Row, Table

_GAINS = (1.0 / 3.0, 3.0)
"""beyond: km/h instead of m/s changes a gain by 3.6, g by 9.8, degrees by 57"""

app = new_app(
    "offline-replay",
    "Drive the simulated car with the recorded steering and speed of a real one, and print how far "
    "its other signals are from the recorded ones. Nothing is judged. docs/validation.md has the "
    "names of the signals.",
    "MAPPING LOGS",
)
main = partial(run_command, app)


@app.default
def replay(
    mapping: Path,
    logs: Logs,
    *,
    car: str = DEFAULT_CAR,
    friction: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None,
    json_file: JsonFile = None,
) -> None:
    """Compare the simulated car with recorded drives.

    Args:
        mapping: TOML file that maps columns to signals, as for offline-import
        logs: log files, or folders of them
        car: name or file of the car
        friction: of the road of the recording; default: that of the car file
    """
    require_packages("offline,logs", ("pandas",), "offline-replay")
    require_writable(json_file, inputs=(mapping, *logs))
    from offline.evaluation.replay import replay_drive
    from offline.logs.mapping import read_mapping
    from offline.logs.readers.source import find_logs, read_log
    from offline.logs.recorded_drive import recorded_drives, require_signals
    from offline.logs.signal import to_drive
    from rt_controller.report.table import print_table
    from sim_bridge.plant.parameters import load_parameters, with_road_friction

    parameters = load_parameters(car)
    if friction is not None:
        parameters = with_road_friction(parameters, friction)
    columns, _ = read_mapping(mapping)
    require_signals(mapping, columns)
    found = find_logs(logs, columns)
    drives = [recorded_drives(to_drive(read_log(each, columns), columns)) for each in found]
    with STDERR.status("driving"):
        results = [replay_drive(parameters, drive) for parts in drives for drive in parts]
    print_table(comparison_table(results), STDOUT)
    write_figures(json_file, [asdict(one) for comparisons in results for one in comparisons])


def comparison_table(results: "Sequence[Sequence[Comparison]]") -> "Table":
    """One row for each signal, with a heading for each recording."""
    from offline.evaluation.replay import SETTLING_S, SPEED_RATE
    from rt_controller.report.table import NO_VALUE, Column, Table, format_number

    columns = (
        Column("signal", is_text=True),
        Column("RMS recorded"),
        Column("RMS error"),
        Column("error", "%"),
        Column("gain"),
        Column("lag", "s"),
        Column("error at lag", "%"),
        Column("remark", is_text=True),
    )
    notes = (
        f"Open loop: recorded steering and speed; {SETTLING_S:g} s are left out after a start. A "
        f"car that spins is started again.",
        "gain: the car over the recording; lag: the recording after the car. Printed, not judged.",
    )
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
    return Table("", columns, tuple(rows), notes)


def doubts(one: "Comparison") -> tuple[str, ...]:
    """What the figures of a signal say about its column."""
    from offline.evaluation.replay import LARGEST_LAG_S
    from offline.logs.recorded_drive import PERIOD_S

    found = (
        (one.gain < 0.0, "gain negative: wrong sign?"),
        (0.0 <= one.gain < _GAINS[0] or one.gain > _GAINS[1], "gain far from 1: wrong unit?"),
        (abs(one.lag_s) > LARGEST_LAG_S - 0.5 * PERIOD_S, "lag at the end of its search"),
    )
    return tuple(words for is_so, words in found if is_so)
