"""A run of the controller at the terminal: progress on stderr, summary on stdout, exit code."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from functools import partial
from typing import TYPE_CHECKING

from rich.console import Console

from rt_controller.bus.log.recorder import require_recordable
from rt_controller.bus.messages import STATE
from rt_controller.contract.errors import BusError, OutputError, PlantError, RtControllerError
from rt_controller.contract.faults import StopCause
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.control.planner import Planner
from rt_controller.controllers import law_error
from rt_controller.drive.scenario import (
    EXIT_LIMIT,
    CarFigure,
    explain_missed,
    figures_to_json,
    limits_missed,
)
from rt_controller.drive.table import PredictedPath
from rt_controller.loop import Ending
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.model.validation import explain_missing_plans
from rt_controller.node import build_planner, choose_low_speed_car, plan_at_constant_speed
from rt_controller.realtime.clock import Clock, LockstepClock, RealtimeClock
from rt_controller.report.table import Fact, facts_table, print_table, print_text
from rt_controller.safety.modes import BUS_CAUSES, RECOVERABLE_BUS_CAUSES
from rt_controller.session import ControllerSession
from rt_controller.settings import CAR_PRIORITY
from rt_controller.simulation import (
    car_error,
    driven_scenario,
    finished_drive,
    named_scenario,
    open_virtual_car,
    record_predictions,
    scenario_notes,
)
from rt_controller.terminal.command_line import print_error
from rt_controller.terminal.entry import INTERRUPTED
from rt_controller.terminal.progress import SETTLING, announce, show, watch
from rt_controller.terminal.stop_message import (
    TIME_CAUSES,
    VEHICLE_KNOWS,
    begin_of_stop,
    explain_braking,
    explain_busy,
    explain_stop,
    failed_checks,
)
from rt_controller.terminal.stop_signals import stop_on_signals
from rt_controller.terminal.summary import (
    NOT_ENGAGED,
    driven_to_json,
    explain_end_at_once,
    fault_sentences,
    live_lines,
    to_json,
    to_table,
    verdict,
    why_late,
    write_ticks,
)
from rt_controller.vehicle.braking_cause import BrakingCause

if TYPE_CHECKING:
    from rt_controller.terminal.options import RunOptions
    from sim_bridge.session import BridgeSession

PROGRAM = "rt-controller"
VIRTUAL_MISS_SHARE = 0.02
"""of the ticks that may be late on the virtual bus, where only a simulated car depends on them"""
EXIT_DEADLINE = 4
EXIT_SAFE_STOP = 6
NO_COMMAND = BrakingCause.NO_COMMAND.value


def run_at_terminal(options: "RunOptions") -> int:
    """Drive one mission and print its summary; the exit code of the program."""
    options.require_consistent()
    require_writable(options.json_file)
    require_writable(options.ticks, "--ticks")
    if options.plot is not None:
        require_writable(options.plot, "--plot")
        from rt_controller.report.drive_figure import require_figure_file

        require_figure_file(options.plot)
    require_recordable(options.record, options.overwrite)
    options.require_openable()
    scenario = named_scenario(options) if options.is_virtual else None
    with announce("loading the model, assembling the QP", options.quiet):
        folder = find_model(options.model)
        bundle = load_bundle(folder)
        planner = build_planner(bundle, options)
    missing = explain_missing_plans(bundle, folder)
    if missing:
        show(f"note: {missing}", options.quiet)
    with ExitStack() as signals:
        with ExitStack() as opened:
            car: BridgeSession | None = None
            clock: Clock = RealtimeClock()
            if options.is_virtual:
                with announce(SETTLING, options.quiet):
                    car = opened.enter_context(
                        closing(open_virtual_car(options, options, scenario=scenario))
                    )
                clock = LockstepClock(car.tick) if options.is_lockstep else clock
                known = choose_low_speed_car(bundle, options.low_speed)
                for note in scenario_notes(car, options.friction, bundle, known):
                    show(f"note: {note}", options.quiet)
            log = None if options.check else options.record
            session = ControllerSession(
                options, options, bundle, planner, clock, log, options.overwrite
            )
            opened.callback(session.close)
            horizons = record_predictions(session) if options.is_lockstep and options.plot else []
            if options.check:
                return _check(planner)
            signals.enter_context(stop_on_signals(session.request_stop))
            if car is not None and not options.is_lockstep:
                car.start(CAR_PRIORITY)
            thread = session.start(options.duration_s, options.stay, options.wait_s)
            watch(thread, partial(next, live_lines(session)), options.quiet)
            if session.failure is not None:  # a law that fails at once never drives
                raise law_error(planner) or session.failure
        figures = () if car is None else car.bridge.figures()
        is_complete = _write(session, car, figures, horizons, options)
        code = _exit_code(session, car, figures, options)
        failure = law_error(planner)
        if failure is not None and not code:  # the car went on with the next input
            print_error(PROGRAM, str(failure))
            code = failure.exit_code
        code = code if code or is_complete else OutputError.exit_code
        # After a failed plant the controller ends in a safe stop; the exit code names the plant.
        is_failed = car is not None and car.bridge.summary().plant_failure is not None
        return PlantError.exit_code if is_failed and code != INTERRUPTED else code


def _check(planner: Planner) -> int:
    """Plan a constant speed, and say that there is no error."""
    plan_at_constant_speed(planner)
    show(f"{planner.name}: no error found")
    return 0


def _write(
    session: ControllerSession,
    car: "BridgeSession | None",
    figures: Sequence[CarFigure],
    horizons: Sequence[PredictedPath],
    options: "RunOptions",
) -> bool:
    """Print the summary and write the files that the options name; False if one is incomplete."""
    plant_failure = None if car is None else car.bridge.summary().plant_failure
    if plant_failure is not None:
        print_error(PROGRAM, f"the car's plant failed: {plant_failure}")
    error = None if car is None else car_error(car)
    braking, console = _vehicle_braking(session, car), Console(emoji=False)
    for sentence in (verdict(session.record, error, braking), *fault_sentences(session.record)):
        print_text(sentence, console)
    print_table(to_table(session, error, braking, options.verbose), console)
    if figures:
        facts = (Fact(figure.name, figure.text) for figure in figures)
        print_table(facts_table(facts, "figures of the scenario"), console)
    scenario = None if car is None else driven_scenario(car)
    output = {
        "driven": driven_to_json(options, scenario),
        **to_json(session, error),
        **figures_to_json(figures),
        "vehicle_braking_cause": None if car is None else _braking_cause(car),
    }

    def plot() -> None:
        if options.plot is not None:
            drive = session.drive() if car is None else finished_drive(session, car, horizons)
            drive.plot(options.plot)

    failures = [] if session.recorder is None else [session.recorder.explain_failure()]
    for write in (
        partial(write_figures, options.json_file, output),
        partial(write_ticks, options.ticks, session.record.deadlines),
        plot,
    ):
        try:
            write()
        except RtControllerError as refused:
            failures.append(str(refused))
    for failure in filter(None, failures):
        print_error(PROGRAM, failure)
    return not any(failures)


def _braking_cause(car: "BridgeSession") -> str | None:
    """Name of the cause; None also if the car brakes because the controller ended its stop."""
    summary = car.bridge.summary()
    return None if summary.controller_ended else summary.braking_cause


def _vehicle_braking(session: ControllerSession, car: "BridgeSession | None") -> str:
    """Why the vehicle brakes by itself, for people; empty if it does not."""
    if car is not None:
        return car.bridge.summary().braking_text if _braking_cause(car) else ""
    state = session.inbox.newest(STATE)
    return VEHICLE_KNOWS if state is not None and state.content.is_watchdog_braking else ""


def _exit_code(
    session: ControllerSession,
    car: "BridgeSession | None",
    figures: Sequence[CarFigure],
    options: "RunOptions",
) -> int:
    """0, or the code of what went wrong, printed with its cause first."""
    record, deadlines = session.record, session.record.deadlines
    late = f"{why_late(deadlines)}; " if deadlines.deadline_misses else ""
    allowed_misses = _allowed_misses(options, deadlines.ticks)
    if record.ending is Ending.ENDED_AT_ONCE:
        print_error(PROGRAM, explain_end_at_once(record.result.estimate.speed_mps))
        return INTERRUPTED
    if record.ending is Ending.REFUSED:
        print_error(PROGRAM, NOT_ENGAGED)
        return EXIT_SAFE_STOP
    cause, bus_fault = record.result.cause, record.result.bus_fault
    braking = _vehicle_braking(session, car)
    faults = () if car is None else car.bridge.faults_so_far()
    is_stop = record.ending is Ending.SAFE_STOPPED or bus_fault in BUS_CAUSES
    text = ""
    if is_stop:
        failed = failed_checks(session)
        stop = explain_stop(cause, session.inbox, faults, bus_fault, failed, braking)
        text = f"{begin_of_stop(session)}: {stop}"
    elif braking:
        text = f"{record.ending.value}; {explain_braking(braking)}"
    busy = ""
    if options.is_virtual and not options.is_lockstep and not faults:
        is_of_time = {cause, bus_fault} <= TIME_CAUSES and braking in ("", NO_COMMAND)
        busy = explain_busy(session, allowed_misses, bool(braking), "" if is_of_time else text)
    if is_stop:
        failure, text = law_error(session.planner), busy or f"{late}{text}"
        if failure is not None:  # the first cause, then what the law did in the stop
            is_first = cause is StopCause.SOLVER_FAILED
            text = str(failure) if is_first else f"{text.rstrip('.')}. Then {failure}"
        print_error(PROGRAM, text)
        is_bus = {cause, bus_fault} & {*BUS_CAUSES, *RECOVERABLE_BUS_CAUSES}
        return BusError.exit_code if is_bus else EXIT_SAFE_STOP
    if braking:
        print_error(PROGRAM, busy or f"{late}{text}")
        return EXIT_SAFE_STOP
    if deadlines.deadline_misses > allowed_misses:
        print_error(
            PROGRAM,
            busy
            or f"{late}scheduled under {session.guarantees.scheduler}. docs/realtime.md says what "
            f"to grant the loop; --max-misses sets how many are allowed.",
        )
        return EXIT_DEADLINE
    missed = limits_missed(figures) if record.ending is Ending.MISSION_OVER else ()
    if missed:
        print_error(PROGRAM, explain_missed(missed))
    return EXIT_LIMIT if missed else 0


def _allowed_misses(options: "RunOptions", ticks: int) -> int:
    if options.max_misses is not None:
        return options.max_misses
    return round(VIRTUAL_MISS_SHARE * ticks) if options.is_virtual else 0
