"""`rt-controller`: drive a car over CAN with a learned model. Options and help; no heavy import."""

import os
from pathlib import Path
from typing import Annotated, Literal

# numpy's linear algebra would share long horizons out to threads of its own, and the loop would
# wait for those at their rank. It reads this when numpy is imported: before everything below.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from cyclopts import App, Parameter
from pydantic import Field

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import LONGEST_S
from rt_controller.terminal.command_line import new_app, run_command
from rt_controller.terminal.options import RunOptions, read_config_file

_Bitrate = Annotated[int, Field(gt=0)]

app = new_app(
    "rt-controller",
    "Drive a car over CAN, once a control period, with a model learned from data. The summary "
    "goes to stdout, progress and messages to stderr. Exit codes: 0 ok, 1 internal error, 2 usage, "
    "configuration or model, 3 an optional package is missing, 4 deadlines missed, 5 bus, 6 ended "
    "in a safe stop, or the vehicle braked by itself, 7 the simulated plant failed, 8 the "
    "simulated drive missed a limit of its scenario, 9 a log or a result file is "
    "incomplete, 130 ended at once by a third Ctrl-C, or by one while it was loading.",
    "--bus NAME",
    {
        "Main options": "bus channel scenario car model controller duration-s record seeds results "
        "html plot json config",
        "Bus": "bitrate bus-option wait-s stay check",
        "Simulated car (--bus virtual)": "plant plant-mapping friction friction-right "
        "transport-delay actuation-delay faults pace",
        "Results": "overwrite ticks quiet verbose max-misses",
    },
)


@app.default
def run(*, options: Annotated[RunOptions, Parameter(name="*")]) -> int:
    """Join the bus, drive the mission, print a summary."""
    from rt_controller.terminal.run import run_at_terminal

    return run_at_terminal(options)


signals = App(
    name="signals", help="A car with its own messages: check its mapping file, or translate."
)
app.command(signals)


@signals.command
def check(
    file: Path,
    log: Path | None = None,
    *,
    bus: str | None = None,
    channel: str = "rt-controller",
    bitrate: _Bitrate | None = None,
    listen_s: Annotated[float, Field(gt=0.0, le=LONGEST_S, allow_inf_nan=False)] = 10.0,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    quiet: bool = False,
) -> int:
    """Say which mapped signals arrive, how often and in which range; 8 if something is wrong.

    Parameters
    ----------
    file
        mapping file, see docs/own-car.md
    log
        CAN log to read: .blf, .asc, .log (candump), .trc
    bus
        or the python-can interface to listen to
    channel
        of the interface
    bitrate
        in bit/s, where the interface sets it
    listen_s
        how long to listen
    json_file
        write the report to this JSON file
    quiet
        no progress on stderr
    """
    from rt_controller.settings import BusSettings
    from rt_controller.terminal.signals import check_at_terminal

    settings = bus and BusSettings(bus=bus, channel=channel, bitrate=bitrate)
    return check_at_terminal(file, log, settings or None, listen_s, json_file, quiet)


@signals.command
def gateway(
    file: Path,
    *,
    bus: str,
    channel: str = "rt-controller",
    bitrate: _Bitrate | None = None,
    car_bus: str,
    car_channel: str,
    car_bitrate: _Bitrate | None = None,
    model: str | None = None,
    priority: Annotated[int, Field(ge=0, le=99)] = 50,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> int:
    """Translate between a car with its own messages and a bus of rt-controller, until Ctrl-C.

    It limits the commands once more, and brakes the car along its path if they stop for 100 ms.

    Parameters
    ----------
    file
        mapping file, see docs/own-car.md
    bus
        python-can interface on which rt-controller is
    channel
        of that interface
    bitrate
        of that interface, in bit/s
    car_bus
        python-can interface on which the car is
    car_channel
        of that interface
    car_bitrate
        of that interface, in bit/s
    model
        name or folder of a model, for the estimate of a lateral speed that is not measured
    priority
        SCHED_FIFO priority, where the system allows it; 0: none
    json_file
        write the counts to this JSON file
    """
    from rt_controller.settings import BusSettings
    from rt_controller.terminal.signals import gateway_at_terminal

    contract = BusSettings(bus=bus, channel=channel, bitrate=bitrate)
    car = BusSettings(bus=car_bus, channel=car_channel, bitrate=car_bitrate)
    return gateway_at_terminal(file, contract, car, model, priority, json_file)


@app.command
def replay(
    log: Path,
    *,
    tick: Annotated[int, Field(ge=0)] | None = None,
    model: str | Path | None = None,
    mcap: Path | None = None,
    overwrite: bool = False,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    quiet: bool = False,
) -> int:
    """Compute the commands of a recorded drive again, from its frames, and list the differences.

    Exit codes: 0 every command is identical, 8 some differ or frames are missing in the log.

    Parameters
    ----------
    log
        log that --record wrote, with its .journal beside it
    tick
        replay up to this tick, from 0, and show it as `explain` does
    model
        another model, to see what it would have commanded; default: the recorded one
    mcap
        write decoded signals, plan and cause of every replayed tick to this MCAP file
    overwrite
        replace an existing file of --mcap
    json_file
        write the result to this JSON file
    quiet
        no progress on stderr
    """
    from rt_controller.terminal.replay import replay_at_terminal

    if tick is not None and mcap is not None:
        raise ConfigError(
            "--tick: expected no --mcap beside it, found both. Leave one of them out."
        )
    if tick is not None:
        return explain(log, tick=tick, model=model, json_file=json_file, quiet=quiet)
    return replay_at_terminal(log, model, mcap, overwrite, json_file, quiet)


@app.command
def explain(
    log: Path,
    *,
    tick: Annotated[int, Field(ge=0)] | None = None,
    model: str | Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    quiet: bool = False,
) -> int:
    """Show one tick of a recorded drive: what happened, why, and what to do.

    Mode, cause and remedy, state, path, command, the checks with their margins, and the times of
    the stages.

    Parameters
    ----------
    log
        log that --record wrote, with its .journal beside it
    tick
        number of the tick, from 0; default: the one in which the last safe stop began
    model
        another model; default: the recorded one
    json_file
        write the same to this JSON file
    quiet
        no progress on stderr
    """
    from rt_controller.terminal.explain import explain_at_terminal

    return explain_at_terminal(log, tick, model, json_file, quiet)


@app.command
def compare(
    *controllers: str,
    scenario: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = (
        "double_lane_change",
    ),
    seeds: Annotated[int, Field(ge=0, le=1000)] = 0,
    plant: str = "own",
    car: str | None = None,
    friction: float | None = None,
    faults: Path | None = None,
    backend: Literal["loky", "dask", "ray"] = "loky",
    address: str | None = None,
    jobs: int = -1,
    html: Path | None = None,
    plot: Path | None = None,
    results: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    quiet: bool = False,
) -> int:
    """Drive the same scenarios with several controllers, in simulated time, on all cores.

    One table has lateral error, speed error, rate of the wheel, jerk and time of a step.
    Needs the extra compare. A drive that failed or was stopped is named below the table;
    exit code 6 if there is no other.

    Parameters
    ----------
    controllers
        mdk-net, mdk-net-small, mdk-net-paper, lti, folders of bundles, stanley, bicycle-mpc, or
        own control laws as MODULE:CLASS or FILE.py:CLASS
    scenario
        one or several, each a shipped one or the path of a .toml or .xodr file
    seeds
        number of drives of each scenario, each with other noise of the sensors; 0: one without
    plant
        own, fmu:FILE.fmu, commonroad:NUMBER or model:BUNDLE
    car
        parameters of the own car: a shipped name, or the path of a .toml file
    friction
        of the road; default: the scenario's
    faults
        faults of bus and actuators, a .toml file
    backend
        where the drives run: processes of this machine, a Dask or a Ray cluster
    address
        HOST:PORT of the cluster; default: a new one on this machine
    jobs
        processes; -1 is one per core
    html
        write this page: the table, and an overlay of the drives of each scenario
    plot
        draw the overlay of the first scenario into this file: .png, .svg or .pdf
    results
        keep every finished drive in this file; after an interruption the same command goes on
    json_file
        write the figures of all drives to this JSON file
    quiet
        no progress on stderr
    """
    from rt_controller.simulation import car_settings_of
    from rt_controller.terminal.compare import compare_at_terminal

    conditions = car_settings_of(plant=plant, car=car, friction=friction, faults=faults)
    return compare_at_terminal(
        controllers,
        scenario,
        seeds,
        conditions,
        backend,
        address,
        jobs,
        html,
        plot,
        results,
        json_file,
        quiet,
    )


@app.command
def report(
    log: Path,
    second: Path | None = None,
    *,
    output: Path | None = None,
    model: str | Path | None = None,
    overwrite: bool = False,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    quiet: bool = False,
) -> int:
    """Write a page about a recorded drive, or about two side by side: a HTML file of its own.

    What happened, why, and what to do; the drive from above, signals and checks against their
    bounds, times of the steps, faults.

    Parameters
    ----------
    log
        log that --record wrote, with its .journal beside it
    second
        a log to compare it with
    output
        file of the page; default: the name of the log with .html
    model
        another model; default: the recorded one
    overwrite
        replace an existing page
    json_file
        write the figures to this JSON file
    quiet
        no progress on stderr
    """
    from rt_controller.terminal.report import report_at_terminal

    logs = [log] if second is None else [log, second]
    return report_at_terminal(logs, model, output, json_file, overwrite, quiet)


@app.meta.default
def _with_config_file(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    config: Path | None = None,
) -> int:
    """Read settings from a TOML file first; options on the command line override it.

    Parameters
    ----------
    config
        TOML file with the same names as the options, e.g. a table [mpc.tolerance]
    """
    app.config = () if config is None else (read_config_file(config),)
    code = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    return code if isinstance(code, int) else 0


def main() -> None:
    """Entry point of the console script."""
    run_command(app)
