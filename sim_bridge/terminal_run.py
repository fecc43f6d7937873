"""A run of the bridge at the terminal: progress on stderr, summary on stdout, errors raised."""

from contextlib import ExitStack, closing
from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.console import Console

from rt_controller.bus.recorder import open_recorder
from rt_controller.bus.transport import require_interface
from rt_controller.car_figures import (
    EXIT_LIMIT,
    explain_missed,
    figures_to_json,
    limits_missed,
)
from rt_controller.contract.errors import BusError, ConfigError, PlantError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import COMMAND_TIMEOUT_S, PERIOD_MS
from rt_controller.realtime.scheduling import real_time_process
from rt_controller.settings import VIRTUAL
from rt_controller.terminal.command_line import print_error
from rt_controller.terminal.progress import COMPILING, Line, announce, show, watch
from rt_controller.terminal.stop_signals import stop_on_signals
from sim_bridge.bridge import Bridge, BridgeSummary
from sim_bridge.session import open_session
from sim_bridge.steering_needs import steering_note

if TYPE_CHECKING:
    from sim_bridge.cli import BridgeOptions

LISTENING_TICKS = 8
"""before the first frame; another vehicle would send in each of them"""


def run_at_terminal(options: "BridgeOptions") -> int:
    """Simulate one mission and print its summary; the exit code of the program.

    Raises:
        ConfigError, MissingExtraError: bus, scenario, plant or log file do not fit.
        BusError: the bus cannot be opened, another vehicle is on it, no controller took the car,
            or the controller stopped sending while it drove.
        PlantError: the plant failed during the drive.
    """
    if options.bus == VIRTUAL:
        raise ConfigError(
            "--bus virtual: expected an interface that other processes reach, found one that stays "
            "in this process. Use --bus local for both programs, or rt-controller --bus virtual "
            "alone, which simulates the car itself."
        )
    require_interface(options.bus)
    require_writable(options.json_file)
    with ExitStack() as signals:
        with ExitStack() as opened:
            # First: the threads that a bus or a log starts inherit the settings of the process.
            opened.enter_context(real_time_process(options.priority))
            recorder = open_recorder(options.record, options.channel)
            if recorder is not None:
                opened.callback(recorder.close)
            with announce(COMPILING, options.quiet):
                session = open_session(options, options.scenario, recorder, options)
            note = steering_note(session.bridge.scenario)
            if note is not None:
                show(f"note: {note}", options.quiet)
            opened.enter_context(closing(session))
            signals.enter_context(stop_on_signals(session.request_stop))
            thread = session.start(options.priority, LISTENING_TICKS, options.wait_s)
            watch(thread, lambda: _line(session.bridge), options.quiet)
            is_stopped = session.is_stop_requested
        summary = session.bridge.summary()
        if summary.ticks > 0 or is_stopped:
            Console().print(_sentence(summary, is_stopped), highlight=False, soft_wrap=True)
        figures = session.bridge.figures()
        for figure in figures:
            Console().print(f"{figure.name}: {figure.text}", highlight=False)
        write_figures(options.json_file, {**asdict(summary), **figures_to_json(figures)})
        _require_success(summary, is_stopped, options)
        missed = limits_missed(figures)
        if not missed or is_stopped or summary.watchdog_braked:
            return 0
        print_error("sim-bridge", explain_missed(missed))
        return EXIT_LIMIT


def _require_success(summary: BridgeSummary, is_stopped: bool, options: "BridgeOptions") -> None:
    if summary.plant_failure is not None:
        raise PlantError(
            f"Expected a plant that drives to the end, found a failure of {summary.plant_failure}. "
            f"Invalid states were sent from there on; the figures end before it."
        )
    if summary.ticks == 0 and not is_stopped:
        raise BusError(
            f"Expected a controller to take the car, found none on channel {options.channel!r} "
            f"within --wait-s {options.wait_s:g} s. Start rt-controller on the same bus and "
            f"channel."
        )
    if summary.watchdog_braked and not summary.controller_ended:
        raise BusError(
            f"Expected a command every {PERIOD_MS:g} ms, found none for "
            f"{1e3 * COMMAND_TIMEOUT_S:g} ms: the controller stopped sending while it drove. The "
            f"car was braked to {summary.final_speed_mps:.1f} m/s."
        )


def _line(bridge: Bridge) -> Line:
    if bridge.is_waiting:
        return Line("waiting for a controller")
    return Line("driving", _figures(bridge.summary()))


def _sentence(summary: BridgeSummary, is_stopped: bool) -> str:
    if summary.ticks == 0:
        return "ended before a controller took the car: nothing was driven"
    braked = "  BRAKED BY THE WATCHDOG"
    if summary.controller_ended:
        braked = "  the controller ended its drive with a safe stop"
    return (
        _figures(summary)
        + (braked if summary.watchdog_braked else "")
        + ("  THE PLANT FAILED" if summary.plant_failure else "")
        + ("  stopped on request before the end" if is_stopped else "")
    )


def _figures(summary: BridgeSummary) -> str:
    return (
        f"{summary.ticks:5d} ticks  {summary.travelled_m:6.1f} m  "
        f"{summary.final_speed_mps * 3.6:5.1f} km/h  lateral error RMS {summary.ey_rms_m:.3f} m, "
        f"peak {summary.ey_peak_m:.3f} m"
    )
