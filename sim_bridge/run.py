"""A run of the bridge at the terminal: progress on stderr, summary on stdout, errors raised."""

from contextlib import ExitStack, closing
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from rich.console import Console

from rt_controller.bus.log.recorder import (
    Recorder,
    log_to_json,
    require_recordable,
)
from rt_controller.bus.transport import require_interface
from rt_controller.contract.errors import BusError, ConfigError, OutputError, PlantError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import PERIOD_MS
from rt_controller.drive.scenario import (
    EXIT_LIMIT,
    explain_missed,
    figures_to_json,
    limits_missed,
)
from rt_controller.realtime.scheduling import real_time_process
from rt_controller.report.table import Fact, facts_table, print_table
from rt_controller.settings import VIRTUAL
from rt_controller.terminal.command_line import print_error
from rt_controller.terminal.progress import SETTLING, Line, announce, show, watch
from rt_controller.terminal.stop_signals import stop_on_signals
from rt_controller.vehicle.braking_cause import BrakingCause
from rt_controller.vehicle.vehicle_envelope import FARTHEST_DRIVEN_M, FARTHEST_OFF_PATH_M
from sim_bridge.bridge import Bridge, BridgeSummary
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
            recorder = None
            if options.record is not None:
                recorder = opened.enter_context(
                    Recorder(
                        options.record,
                        options.channel,
                        is_lockstep=False,
                        replaces=options.overwrite,
                    )
                )
            with announce(SETTLING, options.quiet):
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
        output = {
            **asdict(summary),
            **figures_to_json(figures),
            **log_to_json(recorder),
        }
        failures = [] if recorder is None else [recorder.explain_failure()]
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
    if not summary.watchdog_braked or summary.controller_ended:
        return
    found = f"that {summary.braking_text}"
    match BrakingCause[summary.braking_cause or "NO_COMMAND"]:
        case BrakingCause.ACTUATOR_FAILED:
            expected = "actuators that follow their commands"
            remedy = "Check them, or the faults of this drive"
        case BrakingCause.LEAVING_PATH:
            expected = (
                f"a car that stays within {FARTHEST_DRIVEN_M:g} m of its path "
                f"({FARTHEST_OFF_PATH_M:g} m in a safe stop)"
            )
            remedy = "Check the controller and its model, the scenario, or the faults of this drive"
        case _:
            expected, found = f"a command every {PERIOD_MS:g} ms", summary.braking_text
            refused = _refused(summary)
            remedy = f"There were {refused}" if refused else "The controller stopped sending"
    raise BusError(
        f"Expected {expected}, found {found}. {remedy}. The car was braked to "
        f"{summary.final_speed_mps:.1f} m/s."
    )


def _line(bridge: Bridge, recorder: Recorder | None) -> Line:
    failure = "" if recorder is None else recorder.new_failure()
    if bridge.is_waiting:
        return Line("waiting for a controller", warning=failure)
    return Line("driving", _figures(bridge.summary()), warning=failure)


def _sentence(summary: BridgeSummary, is_stopped: bool) -> str:
    if summary.ticks == 0:
        return "ended before a controller took the car: nothing was driven"
    braked = f"BRAKED BY THE WATCHDOG: {summary.braking_text}"
    if summary.controller_ended:
        braked = "the controller ended its drive with a safe stop"
    is_released = summary.released and summary.final_speed_mps > AT_REST_MPS
    parts = (
        _figures(summary),
        _refused(summary),
        summary.watchdog_braked and braked,
        summary.plant_failure and "THE PLANT FAILED",
        is_stopped and "stopped on request before the end",
        is_released and f"released at {summary.final_speed_mps * 3.6:.0f} km/h",
    )
    return "  ".join(part for part in parts if part)


def _refused(summary: BridgeSummary) -> str:
    """Which commands were refused, and how often; empty if none were."""
    listed = ", ".join(f"{ticks} {name}" for name, ticks in summary.refused_ticks.items())
    return f"ticks with refused commands: {listed}" if listed else ""


def _figures(summary: BridgeSummary) -> str:
    return (
        f"{summary.ticks:5d} ticks  {summary.travelled_m:6.1f} m  "
        f"{summary.final_speed_mps * 3.6:5.1f} km/h  lateral error RMS {summary.ey_rms_m:.3f} m, "
        f"peak {summary.ey_peak_m:.3f} m"
    )
