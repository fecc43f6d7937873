"""`rt-controller`: drive a car over CAN with a learned model."""

import os
import signal
import sys
from pathlib import Path
from typing import Annotated

# numpy's linear algebra would share long horizons out to threads of its own, and the loop would
# wait for those at their rank. It reads this when numpy is imported: before everything below.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from cyclopts import App, Parameter, validators
from cyclopts.config import Toml
from rich.console import Console

from rt_controller.config import (
    BusSettings,
    CarSettings,
    ControllerConfig,
    MpcSettings,
    Pace,
    RealtimeSettings,
)
from rt_controller.contract.errors import BusError, ConfigError, RtControllerError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.loop import Ending
from rt_controller.outcome import StopCause
from rt_controller.realtime.clock import Clock, RealtimeClock
from rt_controller.session import ControllerSession, load_planner, open_session
from rt_controller.summary import live_line, to_json, to_table
from rt_controller.tick_log import write_ticks
from rt_controller.virtual_car import VirtualCar, build_virtual_car

LIVE_INTERVAL_S = 0.5
DEFAULT_MPC = MpcSettings()
DEFAULT_REALTIME = RealtimeSettings()
DEFAULT_CAR = CarSettings()
EXIT_DEADLINE = 4
EXIT_SAFE_STOP = 6
EXIT_BUS = BusError.exit_code
BUS_CAUSES = (StopCause.BUS_FAILED, StopCause.PEER_MISMATCH, StopCause.SECOND_CONTROLLER)

app = App(
    name="rt-controller",
    help="Drive a car over CAN, every 25 ms, with a model learned from data. "
    "Exit codes: 0 ok, 1 internal error, 2 usage, configuration or model, 3 a part is missing, "
    "4 deadlines missed, 5 bus, 6 ended in a safe stop.",
)


@app.default
def run(
    *,
    bus: str,
    channel: str = "rt-controller",
    bitrate: int | None = None,
    bus_option: dict[str, str] | None = None,
    model: Path | None = None,
    car: Annotated[CarSettings, Parameter(name="*")] = DEFAULT_CAR,
    pace: Pace = Pace.REALTIME,
    duration_s: Annotated[float | None, Parameter(validator=validators.Number(gt=0))] = None,
    stay: bool = False,
    wait_s: float = 30.0,
    mpc: MpcSettings = DEFAULT_MPC,
    realtime: RealtimeSettings = DEFAULT_REALTIME,
    record: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    ticks: Path | None = None,
    check: bool = False,
    quiet: bool = False,
) -> int:
    """Join the bus, drive the mission, say how it went.

    Parameters
    ----------
    bus
        python-can interface: socketcan, remote, slcan, vector, …; virtual brings its own car
    channel
        the interface's channel, e.g. can0 or ws://127.0.0.1:54701/
    bitrate
        bit/s, where the interface sets it
    bus_option
        further options of the interface, as --bus-option.KEY VALUE
    model
        folder of a model bundle, as offline-export writes it; default: the one that ships
    car
        what the virtual bus brings along
    pace
        realtime, or lockstep: as fast as possible and the same frames every time (virtual only)
    duration_s
        bring the car to rest and leave after this time
    stay
        stay on the bus when a mission ends, and wait for the next
    wait_s
        how long to wait for the vehicle
    mpc
        the optimal control problem
    realtime
        how the loop runs on this machine
    record
        write all frames to this candump log
    json_file
        write the summary to this file
    ticks
        write the times of every tick of the last hour to this CSV file
    check
        open and check everything, then leave without driving
    quiet
        no live line
    """
    console = Console(stderr=True)
    require_writable(json_file)
    require_writable(ticks, "--ticks")
    config = ControllerConfig(
        bus=BusSettings(interface=bus, channel=channel, bitrate=bitrate, options=bus_option or {}),
        model=model,
        mpc=mpc,
        realtime=realtime if pace is Pace.REALTIME else realtime.model_copy(update={"priority": 0}),
    )
    if pace is Pace.LOCKSTEP and bus != "virtual":
        raise ConfigError(
            f"--pace lockstep: expected --bus virtual, found {bus!r}. Only a car in this process "
            f"can wait for the controller."
        )
    if car != DEFAULT_CAR and bus != "virtual":
        raise ConfigError(
            f"expected a scenario, plant, car or friction with --bus virtual only, found --bus "
            f"{bus!r}. Elsewhere the car is chosen where sim-bridge is started."
        )
    with console.status("loading the model, assembling the QP"):
        planner = load_planner(config)
    virtual: VirtualCar | None = None
    if bus == "virtual":
        with console.status("settling the car (the first start compiles it: about a minute)"):
            virtual = build_virtual_car(config.bus, car)
    try:
        clock: Clock = RealtimeClock(PERIOD_NS) if virtual is None else virtual.clock(pace)
        session = open_session(config, planner, clock, record, pace is Pace.LOCKSTEP)
        try:
            if check:
                console.print(f"{session.model}: everything is in order", highlight=False)
                return 0
            if virtual is not None and pace is Pace.REALTIME:
                virtual.start()
            _drive(session, duration_s, stay, wait_s, None if quiet else console)
        finally:
            session.close()
    finally:
        if virtual is not None:
            virtual.close()
    if virtual is not None and virtual.plant_failure is not None:
        _complain(console, f"the car's plant failed: {virtual.plant_failure}")
    code = _conclude(session, json_file, console)
    write_ticks(ticks, session.record.deadlines)
    return code


def main() -> None:
    """Entry point of the console script."""
    try:
        sys.exit(app.meta(sys.argv[1:]))
    except RtControllerError as error:
        _complain(Console(stderr=True), str(error))
        sys.exit(error.exit_code)


@app.meta.default
def _with_config_file(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    config: Path | None = None,
) -> int:
    """Read settings from a TOML file first; what the command line says goes over it.

    Parameters
    ----------
    config
        TOML file with the same names as the options, e.g. a table [mpc.tolerance]
    """
    if config is not None and not config.is_file():
        raise ConfigError(f"--config {config}: expected a TOML file, found none.")
    app.config = () if config is None else (Toml(config, must_exist=True),)
    code = app(tokens)
    return code if isinstance(code, int) else 0


def _drive(
    session: ControllerSession,
    duration_s: float | None,
    stay: bool,
    wait_s: float,
    console: Console | None,
) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: session.leave())
    thread = session.start(duration_s, stay, wait_s)
    was_joined = False
    while thread.is_alive():
        thread.join(LIVE_INTERVAL_S)
        if console is None:
            continue
        if session.is_joined and not was_joined:
            console.print(session.guarantees.sentence(), highlight=False)
        was_joined = session.is_joined
        # On a terminal the line is written over, in a log there is one after the other.
        end = "\r" if console.is_terminal and thread.is_alive() else "\n"
        console.print(live_line(session.record), highlight=False, soft_wrap=True, end=end)
    if session.failure is not None:
        raise session.failure


def _conclude(session: ControllerSession, json_file: Path | None, console: Console) -> int:
    record = session.record
    console.print(to_table(session))
    write_figures(json_file, to_json(session))
    if record.ending is Ending.SAFE_STOPPED:
        cause = record.outcome.cause
        _complain(console, f"safe stop: {cause.value}")
        return EXIT_BUS if cause in BUS_CAUSES else EXIT_SAFE_STOP
    misses = record.deadlines.deadline_misses
    if misses > 0:
        _complain(
            console,
            f"{misses} of {record.deadlines.ticks} ticks missed their deadline under "
            f"{session.guarantees.scheduler}: see docs/realtime.md for what to grant the loop.",
        )
        return EXIT_DEADLINE
    return 0


def _complain(console: Console, message: str) -> None:
    # No markup: a message may carry brackets, as paths and pip's extras do.
    console.print(f"rt-controller: {message}", style="red", markup=False, highlight=False)
