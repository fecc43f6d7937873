"""`rt-controller replay`: the commands of a recorded drive computed again, and the differences."""

from collections import Counter
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from threadpoolctl import threadpool_limits

from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.drive.scenario import EXIT_LIMIT
from rt_controller.loop import Ending
from rt_controller.recording.replay import (
    FRAME,
    Difference,
    Replay,
    differences,
    read_recorded_drive,
)
from rt_controller.report.table import Column, Table, print_table
from rt_controller.terminal.command_line import print_error
from rt_controller.terminal.progress import announce, show

if TYPE_CHECKING:
    from rt_controller.terminal.options import ReplayOptions

PROGRAM = "rt-controller replay"
SHOWN = 20
"""differences on the terminal; the JSON file has all"""


def replay_at_terminal(log: Path, options: "ReplayOptions") -> int:
    """Replay a log, print what differs; the exit code of the program."""
    require_writable(options.json_file, inputs=(log,))
    require_writable(options.mcap, "--mcap", suffix=".mcap")
    found: list[Difference] = []
    with (
        announce(f"replaying {log}", options.quiet),
        threadpool_limits(1, "blas"),
        ExitStack() as opened,
    ):
        drive = read_recorded_drive(log)
        replay = opened.enter_context(closing(Replay(drive, options.model)))
        file = None
        if options.mcap is not None:
            from rt_controller.recording.mcap import McapFile

            file = opened.enter_context(closing(McapFile(options.mcap, options.overwrite)))
        for tick in replay.ticks():
            found += differences(tick)
            if file is not None:
                file.add(tick, replay.planner)
    changed = drive.header.changed_versions()
    for change in changed:
        show(f"note: {change}", options.quiet)
    ticks, missing_from = len(drive.driven), drive.incomplete_from
    differing = len({each.tick for each in found})
    if found:
        print_table(_to_table(found), Console())
    print(f"{log}: {ticks} ticks replayed, {differing} with another command")
    if drive.ends_in_drive:
        show(f"note: {Ending.LOG_ENDED.value}", options.quiet)
    figures = {
        "log": str(drive.path),
        "model": drive.header.model,
        "recorded_with": drive.header.packages,
        "changed_versions": changed,
        "ticks": ticks,
        "ticks_with_other_command": differing,
        "incomplete_from_tick": missing_from,
        "ends_in_drive": drive.ends_in_drive,
        "is_identical": not found and missing_from is None,
        "differences_by_signal": dict(Counter(each.signal for each in found)),
        "differences": [each._asdict() for each in found],
    }
    write_figures(options.json_file, figures)
    if missing_from is not None:
        print_error(
            PROGRAM,
            f"{log}: expected all frames of the drive, found some missing from tick "
            f"{missing_from} on: the queue or the disk was full. Later ticks cannot be compared; "
            f"record to a disk with more room",
        )
    if file is not None and file.failure:
        print_error(PROGRAM, f"{options.mcap}: expected room for the file, found {file.failure}")
    return EXIT_LIMIT if found or missing_from is not None else 0


def _to_table(found: list[Difference]) -> Table:
    columns = (
        Column("tick"),
        *(Column(title, is_text=True) for title in ("signal", "recorded", "replayed")),
    )
    explained = {each.tick for each in found if each.signal != FRAME}
    shown = [each for each in found if each.signal != FRAME or each.tick not in explained]
    rows = tuple(
        (str(tick), signal, *(f"{v:.6g}" if isinstance(v, float) else str(v) for v in values))
        for tick, signal, *values in shown[:SHOWN]
    )
    more = (f"and {len(shown) - SHOWN} more; --json lists all",) if len(shown) > SHOWN else ()
    return Table("commands that differ", columns, rows, more)
