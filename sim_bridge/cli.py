"""`sim-bridge`: a simulated car at the other end of a CAN bus, as a process of its own.

Options and help only; compiler, FMU tools and plots are imported when a command runs.
"""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from pydantic import Field

from rt_controller.contract.timing import LONGEST_S
from rt_controller.settings import CAR_PRIORITY, BusSettings, CarSettings, SharedInterface
from rt_controller.terminal.command_line import new_app, run_command

_Speed = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]

app = new_app(
    "sim-bridge",
    "Simulate a car on a CAN bus: the project's own, an FMU, or CommonRoad's. The summary "
    "goes to stdout, progress and messages to stderr. Exit codes: 0 ok, 1 a validation target was "
    "missed, or a drive of the fault matrix is not ok, 2 usage or configuration, 3 an optional "
    "package or the C compiler is missing, 5 the bus failed, another vehicle is on it, or the "
    "vehicle's watchdog braked the car while it was driven, 7 the plant failed, 8 the drive missed "
    "a limit of its scenario, 9 a log or a result file is incomplete, 130 ended "
    "by Ctrl-C while it was loading.",
    "--bus NAME",
    {
        "Main options": "bus channel scenario car friction faults signals record json",
        "Bus": "bitrate bus-option wait-s priority",
        "Simulated car": "plant plant-mapping friction-right transport-delay actuation-delay",
        "Results": "overwrite quiet",
    },
)


class BridgeOptions(CarSettings, BusSettings):
    """Options of one run of the bridge."""

    bus: SharedInterface | str
    """python-can interface, these or another that other processes reach"""

    signals: Path | None = None
    """mapping file of a car with messages of its own, which the simulated car then has on this bus;
    rt-controller signals gateway translates them"""
    wait_s: Annotated[float, Field(gt=0.0, le=LONGEST_S, allow_inf_nan=False)] = 60.0
    """longest wait for a controller"""
    priority: Annotated[int, Field(ge=0, le=99)] = CAR_PRIORITY
    """SCHED_FIFO priority, where the system allows it; 0: none"""
    record: Path | None = None
    """write all frames to this candump log (.log), or to a new one in this folder"""
    overwrite: bool = False
    """replace an existing log of --record, which otherwise is refused"""
    json_file: Annotated[Path | None, Parameter(name="--json")] = None
    """write the summary to this JSON file"""
    quiet: bool = False
    """no progress on stderr; errors and the result remain"""


@app.default
def run(*, options: Annotated[BridgeOptions, Parameter(name="*")]) -> int:
    """Wait for a controller, simulate the scenario, brake if the controller stops sending."""
    from sim_bridge.run import run_at_terminal

    return run_at_terminal(options)


@app.command
def validate(
    *,
    car: str | None = None,
    html: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> int:
    """Compare the own car with published measurements; 1 if a line missed its target.

    Parameters
    ----------
    car
        drive all tests with this car; default: each test with the car that its targets belong to
    html
        write tables and plots to this page
    json_file
        write the lines to this file: test, name, car, kind, target, reached,
        tolerance, ok, source
    """
    from sim_bridge.validation import command

    return command.validate(car, html, json_file)


@app.command
def fault_matrix(
    *,
    model: str | None = None,
    only: Annotated[tuple[str, ...], Parameter(consume_multiple=True)] = (),
    speed_kmh: Annotated[tuple[_Speed, ...], Parameter(consume_multiple=True)] = (),
    jobs: Annotated[int, Field(ge=1)] | None = None,
    cases: Path | None = None,
    conditions: Annotated[tuple[str, ...], Parameter(consume_multiple=True)] = (),
    sample: bool = False,
    drives: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> int:
    """Drive every fault of the matrix at three speeds, in simulated time; 1 if one is not ok.

    A drive is ok if the fault is detected within 0.5 s or is harmless, the car stays within 1.75 m
    of its true path or stands on it, and the controller does not drive on normally for longer than
    0.3 s at more than 1 m from the path, and no more than 0.2 m farther from it than in the same
    drive without checks.

    Parameters
    ----------
    model
        that the controller plans with: a shipped name, or folder of a bundle; default: mdk-net
    only
        names of the faults to drive; default: all
    speed_kmh
        speeds to drive at; default: 60, 80 and 120
    jobs
        processes that drive at the same time; default: one for each core
    cases
        TOML file with other faults, such as sim_bridge/faults/matrix/variants.toml
    conditions
        names in sim_bridge/faults/matrix/conditions.toml, under each of which the cases are driven
    sample
        some cases of each kind of fault and condition only
    drives
        file with a line of JSON for each drive: what it already has is not driven again
    json_file
        write the rows to this file: fault, speed_mps, mode, detect_ms, max_ey_m, ok, ...
    """
    from sim_bridge.faults.matrix import command

    return command.fault_matrix(
        model, only, speed_kmh, jobs, json_file, cases, conditions, drives, sample
    )


def main() -> None:
    """Entry point of the console script."""
    run_command(app)
