"""`rt-controller replay`: the commands of a recorded drive computed again, and the differences."""

from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any

from rich.console import Console
from threadpoolctl import threadpool_limits

from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.drive.car_figures import EXIT_LIMIT
from rt_controller.node import build_mpc
from rt_controller.recording.header import (
    changed_versions,
    load_recorded_model,
    recorded_config,
)
from rt_controller.recording.recorded_drive import RecordedDrive, read_recorded_drive
from rt_controller.recording.replay import Difference, Replay, differences
from rt_controller.report.table import Column, Table, print_table
from rt_controller.terminal.command_line import print_error
from rt_controller.terminal.progress import announce, show

PROGRAM = "rt-controller replay"
EXIT_DIFFERENT = EXIT_LIMIT
SHOWN = 20
"""differences on the terminal; the JSON file has all"""


def open_replay(drive: RecordedDrive, model: str | Path | None) -> Replay:
    """The controller that the header of a recorded drive describes.

    Raises:
        ArtifactError: the model cannot be used.
        ConfigError: this version has other settings, or the model has changed since.
    """
    config = recorded_config(drive.header)
    bundle = load_recorded_model(drive.header, model)
    mpc = build_mpc(bundle, config.mpc, drive.header["max_iterations"])
    return Replay(drive, config, bundle, mpc)


def replay_at_terminal(
    log: Path, model: str | Path | None, json_file: Path | None, is_quiet: bool
) -> int:
    """Replay a log, print what differs; the exit code of the program.

    Raises:
        ConfigError, ArtifactError, MissingExtraError: the drive cannot be replayed.
    """
    require_writable(json_file)
    found: list[Difference] = []
    with announce(f"replaying {log}", is_quiet), threadpool_limits(1, "blas"):
        drive = read_recorded_drive(log)
        with closing(open_replay(drive, model)) as replay:
            for tick in replay.ticks():
                found += differences(tick)
    for change in changed_versions(drive.header):
        show(f"note: {change}", is_quiet)
    ticks, missing_from = drive.driven_ticks, drive.incomplete_from
    differing = len({each.tick for each in found})
    if found:
        print_table(_to_table(found), Console())
    print(f"{log}: {ticks} ticks replayed, {differing} with another command")
    write_figures(json_file, _to_json(drive, found))
    if missing_from is not None:
        print_error(
            PROGRAM,
            f"{log}: expected all frames of the drive, found some missing from tick "
            f"{missing_from} on: the queue or the disk was full. Later ticks cannot be compared; "
            f"record to a disk with more room",
        )
    return EXIT_DIFFERENT if found or missing_from is not None else 0


def _to_json(drive: RecordedDrive, found: list[Difference]) -> dict[str, Any]:
    return {
        "log": str(drive.path),
        "model": drive.header["model"],
        "recorded_with": drive.header["packages"],
        "changed_versions": changed_versions(drive.header),
        "ticks": drive.driven_ticks,
        "ticks_with_other_command": len({each.tick for each in found}),
        "incomplete_from_tick": drive.incomplete_from,
        "is_identical": not found and drive.incomplete_from is None,
        "differences_by_signal": dict(Counter(each.signal for each in found)),
        "differences": [each._asdict() for each in found],
    }


def _to_table(found: list[Difference]) -> Table:
    columns = (
        Column("tick"),
        Column("signal", is_text=True),
        Column("recorded", is_text=True),
        Column("replayed", is_text=True),
    )
    rows = tuple(tuple(map(str, each)) for each in found[:SHOWN])
    more = (f"and {len(found) - SHOWN} more; --json lists all",) if len(found) > SHOWN else ()
    return Table("commands that differ", columns, rows, more)
