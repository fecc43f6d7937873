"""A run of the bridge at the terminal: progress on stderr, summary on stdout, errors raised."""

import signal
import threading
import time
from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.console import Console

from rt_controller.bus.recorder import Recorder
from rt_controller.bus.transport import parse_options
from rt_controller.contract.errors import BusError, PlantError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import COMMAND_TIMEOUT_S, PERIOD_MS, PERIOD_NS
from rt_controller.realtime.clock import RealtimeClock
from rt_controller.realtime.scheduling import prepare_process, release_process
from sim_bridge.bridge import BridgeSummary
from sim_bridge.session import BridgeSession, open_session

if TYPE_CHECKING:
    from sim_bridge.cli import BridgeOptions

LIVE_INTERVAL_S = 0.5


def run_at_terminal(options: "BridgeOptions") -> None:
    """Simulate one mission and print its summary.

    Raises:
        ConfigError, MissingExtraError: scenario, plant or log file do not fit.
        BusError: the bus cannot be opened, or no controller took the car, or it stopped sending.
        PlantError: the plant failed during the drive.
    """
    progress = Console(stderr=True)
    require_writable(options.json_file)
    session = _open(options, progress)
    summary = _simulate(session, options, None if options.quiet else progress)
    Console().print(_sentence(summary), highlight=False, soft_wrap=True)
    write_figures(options.json_file, asdict(summary))
    _require_success(summary, options)


def _open(options: "BridgeOptions", progress: Console) -> BridgeSession:
    # First of all: the threads that a bus or a log start inherit what the process is granted.
    prepare_process(options.priority)
    recorder = None
    if options.record is not None:
        epoch_offset_ns = time.time_ns() - time.monotonic_ns()
        recorder = Recorder(
            options.record, options.channel, is_threaded=True, epoch_offset_ns=epoch_offset_ns
        )
    with progress.status("settling the car (the first start compiles it: about a minute)"):
        return open_session(
            options.bus,
            options.channel,
            options.bitrate,
            parse_options(options.bus_option),
            options.scenario,
            recorder,
            options,
        )


def _simulate(
    session: BridgeSession, options: "BridgeOptions", progress: Console | None
) -> BridgeSummary:
    leave = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: leave.set())
    wait_until_s = time.monotonic() + options.wait_s
    thread = threading.Thread(
        target=session.run,
        args=(RealtimeClock(PERIOD_NS), leave.is_set, options.priority),
        name="car",
    )
    thread.start()
    while thread.is_alive():
        thread.join(LIVE_INTERVAL_S)
        if session.bridge.is_waiting and time.monotonic() > wait_until_s:
            leave.set()
        if progress is not None:
            end = "\r" if progress.is_terminal and thread.is_alive() else "\n"
            is_waiting = session.bridge.is_waiting
            text = "waiting for a controller" if is_waiting else _sentence(session.bridge.summary())
            progress.print(text, highlight=False, soft_wrap=True, end=end)
    session.close()
    release_process()
    if session.failure is not None:
        raise session.failure
    return session.bridge.summary()


def _require_success(summary: BridgeSummary, options: "BridgeOptions") -> None:
    if summary.plant_failure is not None:
        raise PlantError(
            f"Expected a plant that drives to the end, found a failure of {summary.plant_failure}. "
            f"Invalid states were sent from there on; the figures end before it."
        )
    if summary.ticks == 0:
        raise BusError(
            f"Expected a controller to take the car, found none on channel {options.channel!r} "
            f"until --wait-s {options.wait_s:g} or Ctrl-C. Start rt-controller on the same bus and "
            f"channel."
        )
    if summary.watchdog_braked:
        raise BusError(
            f"Expected a command every {PERIOD_MS:g} ms, found none for "
            f"{1e3 * COMMAND_TIMEOUT_S:g} ms: the controller stopped sending. The car was braked "
            f"to {summary.final_speed_mps:.1f} m/s."
        )


def _sentence(summary: "BridgeSummary") -> str:
    return (
        f"{summary.ticks:5d} ticks  {summary.travelled_m:6.1f} m  "
        f"{summary.final_speed_mps * 3.6:5.1f} km/h  e_y rms {summary.ey_rms_m:.3f} m, "
        f"peak {summary.ey_peak_m:.3f} m"
        + ("  BRAKED BY THE WATCHDOG" if summary.watchdog_braked else "")
        + ("  THE PLANT FAILED" if summary.plant_failure else "")
    )
