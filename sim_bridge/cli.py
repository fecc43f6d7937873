"""`sim-bridge`: the car at the other end of a CAN bus, as a process of its own.

Heavy rooms (compiler, FMU tools, plots) are imported where they are needed, so that `--help` and
a mistyped option answer at once.
"""

import signal
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter
from rich.console import Console

from rt_controller.bus.recorder import Recorder
from rt_controller.bus.transport import parse_options
from rt_controller.contract.errors import BusError, PlantError, RtControllerError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.realtime.clock import RealtimeClock
from rt_controller.realtime.scheduling import prepare_process, release_process
from sim_bridge.adapters.plants import OWN, PlantChoice
from sim_bridge.priority import FIFO_PRIORITY

if TYPE_CHECKING:
    from sim_bridge.bridge import BridgeSummary
    from sim_bridge.session import BridgeSession

LIVE_INTERVAL_S = 0.5

app = App(
    name="sim-bridge",
    help="Host a car on a CAN bus: the project's own, an FMU, or CommonRoad's. Exit codes: 0 ok, "
    "1 the validation found a miss, 2 usage or configuration, 3 a part is missing, 5 the bus "
    "failed or the controller fell silent, 7 the plant failed.",
)
app.command(
    "sim_bridge.adapters.export:export_fmu",
    name="export-fmu",
    help="Build an FMU of the own car, with its mapping file beside it.",
)
app.command(
    "sim_bridge.validation.command:validate",
    name="validate",
    help="Measure the own car against published manoeuvres.",
)


@app.default
def drive(
    *,
    bus: str,
    channel: str = "rt-controller",
    bitrate: int | None = None,
    bus_option: dict[str, str] | None = None,
    scenario: str = "double_lane_change",
    plant: str = OWN,
    plant_mapping: Path | None = None,
    car: str | None = None,
    friction: float | None = None,
    friction_right: float | None = None,
    wait_s: float = 60.0,
    priority: int = FIFO_PRIORITY,
    record: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
    quiet: bool = False,
) -> None:
    """Wait for a controller, drive the scenario, brake if the controller falls silent.

    Parameters
    ----------
    bus
        python-can interface: socketcan, remote, slcan, vector, … (virtual never leaves a process)
    channel
        the interface's channel, e.g. can0 or ws://127.0.0.1:54701/
    bitrate
        bit/s, where the interface sets it
    bus_option
        further options of the interface, as --bus-option.KEY VALUE
    scenario
        name of a shipped scenario, or the path of a .toml file
    plant
        own, fmu:FILE.fmu (FMI 2 or 3 co-simulation) or commonroad:NUMBER
    plant_mapping
        which variable of the FMU is which signal; default: FILE.toml beside FILE.fmu
    car
        the own car's parameters: a shipped name, or the path of a .toml file
    friction
        of the road, 1 being the road of the tyre's test; default: the scenario's
    friction_right
        of the road under the own car's right wheels, where that is another
    wait_s
        how long to wait for a controller to take the car
    priority
        SCHED_FIFO priority, where the system allows it; 0: do not ask
    record
        write all frames to this candump log
    json_file
        write the summary to this file
    quiet
        no live line
    """
    from sim_bridge.session import open_session

    console = Console(stderr=True)
    require_writable(json_file)
    choice = PlantChoice(plant, plant_mapping, car, friction, friction_right)
    prepare_process(priority)  # first of all: the threads of bus and log inherit it
    recorder = (
        Recorder(
            record,
            channel,
            is_threaded=True,
            epoch_offset_ns=time.time_ns() - time.monotonic_ns(),
        )
        if record
        else None
    )
    with console.status("settling the car (the first start compiles it: about a minute)"):
        options = parse_options(bus_option or {})
        session = open_session(bus, channel, bitrate, options, scenario, recorder, choice)
    summary = _run(session, wait_s, priority, None if quiet else console)
    console.print(_sentence(summary))
    write_figures(json_file, asdict(summary))
    if summary.plant_failure is not None:
        raise PlantError(
            f"Expected a plant that drives to the end, found a failure of {summary.plant_failure}. "
            f"Invalid states were sent from there on; the figures are those of before."
        )
    if summary.ticks == 0:
        raise BusError(
            f"Expected a controller to take the car, found none on channel {channel!r} until "
            f"--wait-s {wait_s:g} or Ctrl-C. Start rt-controller on the same bus and channel."
        )
    if summary.watchdog_braked:
        raise BusError(
            "The controller fell silent: expected a command every 25 ms, found none for 100 ms. "
            f"The car was braked to {summary.final_speed_mps:.1f} m/s."
        )


def main() -> None:
    """Entry point of the console script."""
    try:
        app(sys.argv[1:])
    except RtControllerError as error:
        # No markup: a message may carry brackets, as paths and pip's extras do.
        Console(stderr=True).print(
            f"sim-bridge: {error}", style="red", markup=False, highlight=False
        )
        sys.exit(error.exit_code)


def _run(
    session: "BridgeSession", wait_s: float, priority: int, console: Console | None
) -> "BridgeSummary":
    leave = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: leave.set())
    give_up_s = time.monotonic() + wait_s
    thread = threading.Thread(
        target=session.run,
        args=(RealtimeClock(PERIOD_NS), leave.is_set, priority),
        name="car",
    )
    thread.start()
    while thread.is_alive():
        thread.join(LIVE_INTERVAL_S)
        if session.bridge.is_waiting and time.monotonic() > give_up_s:
            leave.set()
        if console is not None:
            end = "\r" if console.is_terminal and thread.is_alive() else "\n"
            console.print(_live(session), highlight=False, soft_wrap=True, end=end)
    session.close()
    release_process()
    if session.failure is not None:
        raise session.failure
    return session.bridge.summary()


def _live(session: "BridgeSession") -> str:
    if session.bridge.is_waiting:
        return "waiting for a controller"
    return _sentence(session.bridge.summary())


def _sentence(summary: "BridgeSummary") -> str:
    return (
        f"{summary.ticks:5d} ticks  {summary.travelled_m:6.1f} m  "
        f"{summary.final_speed_mps * 3.6:5.1f} km/h  e_y rms {summary.ey_rms_m:.3f} m, "
        f"peak {summary.ey_peak_m:.3f} m"
        + ("  BRAKED BY THE WATCHDOG" if summary.watchdog_braked else "")
        + ("  THE PLANT FAILED" if summary.plant_failure else "")
    )
