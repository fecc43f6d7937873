"""`sim-bridge`: the nonlinear car at the other end of a CAN bus, as a process of its own."""

import signal
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from rich.console import Console

from rt_controller.bus.recorder import Recorder
from rt_controller.contract.errors import BusError, RtControllerError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.realtime.clock import RealtimeClock
from rt_controller.realtime.scheduling import attend
from sim_bridge.bridge import BridgeSummary
from sim_bridge.session import FIFO_PRIORITY, BridgeSession, open_session

LIVE_INTERVAL_S = 0.5

app = App(
    name="sim-bridge",
    help="Host the nonlinear car on a CAN bus. Exit codes: 0 ok, 2 usage or configuration, "
    "3 a part is missing, 5 the bus failed or the controller fell silent.",
)


@app.default
def drive(
    *,
    bus: str,
    channel: str = "rt-controller",
    bitrate: int | None = None,
    bus_option: dict[str, str] | None = None,
    scenario: str = "double_lane_change",
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
    console = Console(stderr=True)
    require_writable(json_file)
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
        session = open_session(bus, channel, bitrate, bus_option or {}, scenario, recorder)
    summary = _run(session, wait_s, priority, None if quiet else console)
    console.print(_sentence(summary))
    write_figures(json_file, asdict(summary))
    if summary.ticks == 0:
        raise BusError(
            f"Expected a controller to take the car within {wait_s:g} s, found none on channel "
            f"{channel!r}. Start rt-controller on the same bus and channel."
        )
    if summary.watchdog_braked:
        raise BusError(
            "The controller fell silent: expected a command every 25 ms, found none for 100 ms. "
            f"The car was braked to {summary.final_speed_mps:.1f} m/s."
        )


def main() -> None:
    """Entry point of the console script."""
    try:
        app()
    except RtControllerError as error:
        Console(stderr=True).print(f"[red]sim-bridge:[/red] {error}", highlight=False)
        sys.exit(error.exit_code)


def _run(
    session: BridgeSession, wait_s: float, priority: int, console: Console | None
) -> BridgeSummary:
    leave = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: leave.set())
    give_up_s = time.monotonic() + wait_s
    thread = threading.Thread(
        target=session.run,
        args=(RealtimeClock(PERIOD_NS), leave.is_set, priority),
        name="car",
    )
    attend(priority)
    thread.start()
    while thread.is_alive():
        thread.join(LIVE_INTERVAL_S)
        if session.bridge.is_waiting and time.monotonic() > give_up_s:
            leave.set()
        if console is not None:
            end = "\r" if console.is_terminal and thread.is_alive() else "\n"
            console.print(_live(session), highlight=False, soft_wrap=True, end=end)
    session.close()
    if session.failure is not None:
        raise session.failure
    return session.bridge.summary()


def _live(session: BridgeSession) -> str:
    if session.bridge.is_waiting:
        return "waiting for a controller"
    return _sentence(session.bridge.summary())


def _sentence(summary: BridgeSummary) -> str:
    return (
        f"{summary.ticks:5d} ticks  {summary.travelled_m:6.1f} m  "
        f"{summary.final_speed_mps * 3.6:5.1f} km/h  e_y rms {summary.ey_rms_m:.3f} m, "
        f"peak {summary.ey_peak_m:.3f} m"
        + ("  BRAKED BY THE WATCHDOG" if summary.watchdog_braked else "")
    )
