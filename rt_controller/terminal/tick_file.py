"""The file of `--ticks`: the times of the last ticks as CSV."""

from pathlib import Path

import numpy as np

from rt_controller.contract.errors import OutputError
from rt_controller.contract.files import atomic_write
from rt_controller.realtime.timing import DeadlineAccount, TickTimes


def write_ticks(path: Path | None, deadlines: DeadlineAccount) -> None:
    """Write a CSV row for each of the last ticks, oldest first; None writes nothing.

    Columns: the number of the tick in the run, then the fields of `TickTimes`.

    Raises:
        OutputError: the file cannot be written any more.
    """
    if path is None:
        return
    times = deadlines.last()
    numbers = np.arange(deadlines.ticks - len(times), deadlines.ticks)
    rows = np.column_stack([numbers, times])
    header = ",".join(("tick", *TickTimes._fields))
    formats = ["%d", *["%.1f"] * times.shape[1]]
    try:
        with atomic_write(path) as file:
            np.savetxt(file, rows, fmt=formats, delimiter=",", header=header, comments="")
    except OSError as error:
        raise OutputError(
            f"--ticks {path}: expected a file that can be written, found {error.strerror}. The run "
            f"itself is complete; only this file is missing. Free some space before the next one."
        ) from error
