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

app = new_app(
    "sim-bridge",
    "Simulate a car on a CAN bus: the project's own, an FMU, or CommonRoad's. The summary "
    "goes to stdout, progress and messages to stderr. Exit codes: 0 ok, 1 a validation target was "
    "missed, 2 usage or configuration, 3 an optional package or the C compiler is missing, 5 the "
    "bus failed, another vehicle is on it, or the vehicle's watchdog braked the car while "
    "it was driven, 7 the plant failed, 8 the drive missed a limit of its scenario, 9 a log or a "
    "result file is incomplete, 130 ended by Ctrl-C while it was loading.",
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
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> int:
    """Compare the own car with published measurements; 1 if a line missed its target.

    Parameters
    ----------
    car
        drive all tests with this car; default: each test with the car that its targets belong to
    json_file
        write the lines to this file: test, name, car, kind, target, reached,
        tolerance, ok, source
    """
    from sim_bridge.validation import command

    return command.validate(car, json_file)


def main() -> None:
    """Entry point of the console script."""
    run_command(app)
