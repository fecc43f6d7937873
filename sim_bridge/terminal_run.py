"""A run of the bridge at the terminal: progress on stderr, summary on stdout, errors raised."""

from contextlib import ExitStack, closing
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from rich.console import Console

from rt_controller.bus.log.recorder import Recorder, open_recorder, require_recordable
from rt_controller.bus.transport import require_interface
from rt_controller.contract.errors import BusError, ConfigError, OutputError, PlantError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import PERIOD_MS
from rt_controller.drive.car_figures import (
    EXIT_LIMIT,
    explain_missed,
    figures_to_json,
    limits_missed,
)
from rt_controller.gateway.braking_cause import BrakingCause
from rt_controller.gateway.vehicle_envelope import FARTHEST_DRIVEN_M, FARTHEST_OFF_PATH_M
from rt_controller.realtime.scheduling import real_time_process
from rt_controller.report.table import Fact, facts_table, print_table
from rt_controller.settings import VIRTUAL
from rt_controller.terminal.command_line import print_error
from rt_controller.terminal.log_summary import log_to_json
from rt_controller.terminal.progress import COMPILING, Line, announce, show, watch
from rt_controller.terminal.stop_signals import stop_on_signals
from rt_controller.terminal.streams import lost_output
from sim_bridge.bridge import Bridge
from sim_bridge.bridge_summary import BridgeSummary
from sim_bridge.scenario_checks import grip_note, steering_note
from sim_bridge.scenario_run import AT_REST_MPS
from sim_bridge.session import open_session

if TYPE_CHECKING:
    from sim_bridge.cli import BridgeOptions

LISTENING_TICKS = 8
"""before the first frame; another vehicle would send in each of them"""


def run_at_terminal(options: "BridgeOptions") -> int:
    """Simulate one mission and print its summary; the exit code of the program.

    Raises:
        ConfigError, MissingExtraError: bus, scenario, plant or log file do not fit.
        BusError: the bus cannot be opened, another vehicle is on it, no controller took the car,
            or while it drove the watchdog braked the car or the bus failed.
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
    require_recordable(options.record, options.overwrite)
    with ExitStack() as signals:
        with ExitStack() as opened:
            # First: the threads that a bus or a log starts inherit the settings of the process.
            opened.enter_context(real_time_process(options.priority))
            recorder = open_recorder(options.record, options.channel, replaces=options.overwrite)
            if recorder is not None:
                opened.callback(recorder.close)
            with announce(COMPILING, options.quiet):
                session = open_session(
                    options,
                    options.scenario,
                    recorder,
                    options,
                    options.faults,
                    signals=options.signals,
                )
            scenario = session.bridge.scenario
            replaced = None if options.friction is None else grip_note(scenario)
            for note in filter(None, (steering_note(scenario), replaced)):
                show(f"note: {note}", options.quiet)
            opened.enter_context(closing(session))
            signals.enter_context(stop_on_signals(session.request_stop))
            thread = session.start(options.priority, LISTENING_TICKS, options.wait_s)
            watch(thread, partial(_line, session.bridge, recorder), options.quiet)
            is_stopped = session.is_stop_requested
        summary = session.bridge.summary()
        if summary.ticks > 0 or is_stopped:
            Console().print(_sentence(summary, is_stopped), highlight=False, soft_wrap=True)
        figures = session.bridge.figures()
        if figures:
            facts = (Fact(figure.name, figure.text) for figure in figures)
            print_table(facts_table(facts, "figures of the scenario"), Console())
        failures = [] if recorder is None else [recorder.explain_failure()]
        output = {
            **asdict(summary),
            **figures_to_json(figures),
            **log_to_json(recorder),
            "lost_output": lost_output(),
        }
        try:
            write_figures(options.json_file, output)
        except OutputError as error:  # what the drive ended with is said all the same
            failures.append(str(error))
        for failure in filter(None, failures):
            print_error("sim-bridge", failure)
        session.bridge.require_readable_bus()
        _require_success(summary, is_stopped, options)
        missed = limits_missed(figures)
        if not missed or is_stopped or summary.watchdog_braked:
            return OutputError.exit_code if any(failures) else 0
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
            f"{_explain_braking(summary)}. The car was braked to {summary.final_speed_mps:.1f} m/s."
        )


def _explain_braking(summary: BridgeSummary) -> str:
    """What the watchdog expected and found."""
    found = summary.braking_text
    if summary.braking_cause == BrakingCause.ACTUATOR_FAILED.name:
        return (
            f"Expected actuators that follow their commands, found that {found}. Check them, or "
            f"the faults of this drive"
        )
    if summary.braking_cause == BrakingCause.LEAVING_PATH.name:
        return (
            f"Expected a car that stays within {FARTHEST_DRIVEN_M:g} m of its path "
            f"({FARTHEST_OFF_PATH_M:g} m in a safe stop), found that {found}. Check the "
            f"controller and its model, the scenario, or the faults of this drive"
        )
    failed = f". Besides, {summary.failed_text}" if summary.failed_actuators else ""
    return (
        f"Expected a command every {PERIOD_MS:g} ms, found {BrakingCause.NO_COMMAND.value} while "
        f"the car was driven{_refused(summary)}{failed}"
    )


def _refused(summary: BridgeSummary) -> str:
    """Which commands were refused, and how often; empty if none were."""
    if not summary.refused_ticks:
        return ": the controller stopped sending"
    listed = ", ".join(f"{ticks} {name}" for name, ticks in summary.refused_ticks.items())
    return f" (ticks with refused commands: {listed})"


def _line(bridge: Bridge, recorder: Recorder | None) -> Line:
    failure = "" if recorder is None else recorder.new_failure()
    if bridge.is_waiting:
        return Line("waiting for a controller", warning=failure)
    return Line("driving", _figures(bridge.summary()), warning=failure)


def _sentence(summary: BridgeSummary, is_stopped: bool) -> str:
    if summary.ticks == 0:
        return "ended before a controller took the car: nothing was driven"
    braked = f"  BRAKED BY THE WATCHDOG: {summary.braking_text}"
    if summary.controller_ended:
        braked = "  the controller ended its drive with a safe stop"
    refused = ", ".join(f"{ticks} {name}" for name, ticks in summary.refused_ticks.items())
    is_released = summary.released and summary.final_speed_mps > AT_REST_MPS
    return (
        _figures(summary)
        + (f"  ticks with refused commands: {refused}" if refused else "")
        + (braked if summary.watchdog_braked else "")
        + ("  THE PLANT FAILED" if summary.plant_failure else "")
        + ("  stopped on request before the end" if is_stopped else "")
        + (f"  released at {summary.final_speed_mps * 3.6:.0f} km/h" if is_released else "")
    )


def _figures(summary: BridgeSummary) -> str:
    return (
        f"{summary.ticks:5d} ticks  {summary.travelled_m:6.1f} m  "
        f"{summary.final_speed_mps * 3.6:5.1f} km/h  lateral error RMS {summary.ey_rms_m:.3f} m, "
        f"peak {summary.ey_peak_m:.3f} m"
    )
