"""Drives with a vehicle and a controller, each in a process of its own, and their figures."""

import json
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.processes import program, start, start_bus_server
from rt_controller.contract.errors import BusError
from rt_controller.contract.faults import StopCause
from rt_controller.contract.timing import PERIOD_S
from rt_controller.realtime.timing import SOLVE_FIELDS, Histogram

SPEED_KMH = 80.0
SPACING_M = 400.0
_HEAD = """\
name = "slalom"
speed_kmh = {speed}
curvature_per_m = 0.001
duration_s = {duration}
road_friction = 0.85
"""
_MOVE = """
[[moves]]
start_m = {start}
length_m = 60.0
to_m = {to}
"""


def write_slalom(file: Path, ticks: int) -> None:
    """Write a scenario of so many ticks: regular lane changes on a constant curve."""
    duration_s = ticks * PERIOD_S
    moves = int(duration_s * SPEED_KMH / 3.6 / SPACING_M) + 1
    text = _HEAD.format(speed=SPEED_KMH, duration=duration_s)
    for k in range(moves):
        text += _MOVE.format(start=25.0 + k * SPACING_M, to=0.0 if k % 2 else 3.5)
    file.write_text(text)


Ticks = NDArray[np.void]
"""(ticks,), structured: the fields of `TickTimes` and the number of the tick"""


class CadenceRun(NamedTuple):
    """One drive."""

    summary: dict[str, Any]
    """as `rt-controller --json` writes it"""
    ticks: Ticks


def aggregate(drives: Sequence[CadenceRun]) -> dict[str, Any]:
    """Percentiles of each time over all ticks, counts, and the worst tick of any drive.

    A stall of the host ends a drive, not the count.
    """
    summaries = [drive.summary for drive in drives]
    ticks = np.concatenate([drive.ticks for drive in drives])
    fields = [name for name in ticks.dtype.names or () if name != "tick"]
    return {
        **{key: summaries[0][key] for key in ("model", "scheduler", "memory_locked")},
        "ticks": len(ticks),
        "drives": len(drives),
        "safe_stops": sum(summary["ending"] == "SAFE_STOPPED" for summary in summaries),
        "deadline_misses": sum(summary["deadline_misses"] for summary in summaries),
        "skipped_ticks": sum(summary["skipped_ticks"] for summary in summaries),
        "worst_tick": max(
            (summary["worst_tick"] for summary in summaries),
            key=lambda worst: float(worst["late_us"]),
        ),
        **{field: _percentiles(ticks, field) for field in fields},
    }


def _percentiles(ticks: Ticks, field: str) -> dict[str, float]:
    histogram = Histogram()
    counted = ticks[ticks["qp_iterations"] > 0.0] if field in SOLVE_FIELDS else ticks
    for value in counted[field].tolist():
        histogram.add(value)
    return histogram.percentiles()._asdict()


TIMEOUT_S = 60.0
STALL_CAUSES = (
    StopCause.STATE_LOST.name,
    StopCause.REFERENCE_LOST.name,
    StopCause.MISSION_LOST.name,
    StopCause.VEHICLE_BRAKING.name,
)
"""why a drive stops if the host does not run its processes for some time"""


class Transport(StrEnum):
    """How frames go from process to process."""

    LOCAL = "local"
    """shared memory"""
    REMOTE = "remote"
    """python-can-remote, with a server process"""


def drive_in_real_time(
    ticks: int, options: Sequence[str], transport: Transport, car_cpu: int, controller_cpu: int
) -> CadenceRun:
    """A slalom of so many ticks.

    The vehicle, and the server if there is one, run on one core, the controller on the other. If
    the host stalls for long, the drive ends early in a safe stop.

    Raises:
        BusError: the drive ended early for another reason.
    """
    with tempfile.TemporaryDirectory() as name, ExitStack() as running:
        folder = Path(name)
        scenario = folder / "slalom.toml"
        write_slalom(scenario, ticks)
        channel = f"cadence-{folder.name}"
        if transport is Transport.REMOTE:
            _, channel = start_bus_server(folder / "bus.log", running, car_cpu)
        bus = ("--bus", transport.value, "--channel", channel, "--quiet")
        car_log, controller_log = folder / "car.log", folder / "controller.log"
        start(
            *program("sim_bridge.cli", *bus, "--scenario", str(scenario)),
            log=car_log,
            cpu=car_cpu,
            running=running,
        )
        summary_file, ticks_file = folder / "controller.json", folder / "ticks.csv"
        controller = start(
            *program("rt_controller.cli", *bus, "--realtime.cpu", str(controller_cpu)),
            *("--model-trial", "off"),
            *("--json", str(summary_file), "--ticks", str(ticks_file), *options),
            log=controller_log,
            running=running,
        )
        controller.wait(ticks * PERIOD_S + TIMEOUT_S)
        if not summary_file.exists():
            raise BusError(controller_log.read_text()[-1000:])
        summary: dict[str, Any] = json.loads(summary_file.read_text())
        if summary["ending"] != "MISSION_OVER" and summary["stop_cause"] not in STALL_CAUSES:
            raise BusError(
                f"expected a complete drive, found {summary['ending']} after "
                f"{summary['ticks']} ticks.\n{car_log.read_text()[-1000:]}"
            )
        times = np.genfromtxt(ticks_file, delimiter=",", names=True)
        return CadenceRun(summary, np.atleast_1d(times))
