"""`sim-bridge`: a simulated car at the other end of a CAN bus, as a process of its own.

Options and help only; compiler, FMU tools and plots are imported when a command runs.
"""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from pydantic import Field

from rt_controller.contract.errors import require_packages
from rt_controller.settings import CAR_PRIORITY, BusSettings, CarSettings, SharedInterface
from rt_controller.terminal.command_line import new_app, run_command
from sim_bridge.plant.parameters import DEFAULT_CAR

app = new_app(
    "sim-bridge",
    "Simulate a car on a CAN bus: the project's own, an FMU, or CommonRoad's. The summary "
    "goes to stdout, progress and messages to stderr. Exit codes: 0 ok, 1 a validation target was "
    "missed, 2 usage or configuration, 3 an optional package is missing, 5 the bus failed, "
    "another vehicle is on it, or the controller stopped sending while it drove, 7 the plant "
    "failed, 130 ended by Ctrl-C while it was loading.",
    "--bus NAME",
)


class BridgeOptions(CarSettings, BusSettings):
    """Options of one run of the bridge."""

    bus: SharedInterface | str
    """python-can interface, these or another that other processes reach"""

    wait_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 60.0
    """longest wait for a controller"""
    priority: Annotated[int, Field(ge=0, le=99)] = CAR_PRIORITY
    """SCHED_FIFO priority, where the system allows it; 0: do not ask"""
    record: Path | None = None
    """write all frames to this candump log"""
    json_file: Annotated[Path | None, Parameter(name="--json")] = None
    """write the summary to this JSON file"""
    quiet: bool = False
    """no progress on stderr; errors and the result remain"""


@app.default
def run(*, options: Annotated[BridgeOptions, Parameter(name="*")]) -> None:
    """Wait for a controller, simulate the scenario, brake if the controller stops sending."""
    _require_compiler()
    from sim_bridge.terminal_run import run_at_terminal

    run_at_terminal(options)


@app.command
def export_fmu(file: Path = Path("car.fmu"), *, car: str = DEFAULT_CAR) -> None:
    """Build an FMU of the own car (FMI 2 co-simulation), with its mapping file beside it.

    A process that loads the FMU needs a Python with rt-controller[sim]; the
    car's parameters are inside.

    Parameters
    ----------
    file
        where to write the FMU
    car
        the car's parameters: a shipped name, or the path of a .toml file
    """
    _require_compiler()
    from sim_bridge.adapters import export

    export.export_fmu(file, car)


@app.command
def validate(
    *,
    car: str | None = None,
    html: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    quick: bool = False,
) -> int:
    """Compare the own car with published measurements; 1 if a line missed its target.

    Parameters
    ----------
    car
        drive all tests with this car; default: each test with the car that its targets belong to
    html
        write tables and plots to this page
    json_file
        write the lines to this file: test, name, car, target, reached, tolerance, ok
    quick
        leave out the slowest sines of the frequency response; all lines are judged
    """
    _require_compiler()
    from sim_bridge.validation import command

    return command.validate(car, html, json_file, quick)


def _require_compiler() -> None:
    require_packages("sim", ("numba",), "sim-bridge")


def main() -> None:
    """Entry point of the console script."""
    run_command(app)
