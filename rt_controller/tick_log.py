"""The times of the last ticks as a table, for whoever wants to look at them one by one."""

from pathlib import Path

import numpy as np

from rt_controller.contract.errors import RtControllerError
from rt_controller.realtime.accounting import DeadlineAccount, TickTimes


def write_ticks(path: Path | None, deadlines: DeadlineAccount) -> None:
    """A CSV file with a row for each of the last ticks, oldest first; None writes nothing.

    Columns: the tick's number in the run, then those of `TickTimes`.

    Raises:
        RtControllerError: the place that was there before the run is not there any more.
    """
    if path is None:
        return
    times = deadlines.last()
    numbers = np.arange(deadlines.ticks - len(times), deadlines.ticks)
    header = ",".join(("tick", *TickTimes._fields))
    formats = ["%d", *["%.1f"] * times.shape[1]]
    try:
        np.savetxt(
            path,
            np.column_stack([numbers, times]),
            fmt=formats,
            delimiter=",",
            header=header,
            comments="",
        )
    except OSError as error:
        raise RtControllerError(
            f"--ticks {path}: expected room for the times, found {error.strerror}. The run itself "
            f"is done; only this file is missing."
        ) from error
