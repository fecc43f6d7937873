"""A run of the controller at the terminal: progress on stderr, summary on stdout, exit code."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from functools import partial
from typing import TYPE_CHECKING, Any

from rich.console import Console

from rt_controller.bus.catalogue import REFERENCE, STATE
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Message
from rt_controller.bus.transport import require_interface
from rt_controller.car_figures import (
    EXIT_LIMIT,
    CarFigure,
    explain_missed,
    figures_to_json,
    limits_missed,
)
from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import BusError, PlantError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.loop import Ending
from rt_controller.planner import build_mpc, choose_low_speed_car
from rt_controller.realtime.clock import Clock, LockstepClock, RealtimeClock
from rt_controller.report.table import Fact, facts_table, print_table
from rt_controller.safety.modes import BUS_CAUSES, StopCause
from rt_controller.session import ControllerSession
from rt_controller.settings import CAR_PRIORITY
from rt_controller.terminal.command_line import INTERRUPTED, print_error
from rt_controller.terminal.progress import COMPILING, announce, show, watch
from rt_controller.terminal.stop_signals import stop_on_signals
from rt_controller.terminal.summary import (
    driven_to_json,
    live_lines,
    to_json,
    to_table,
    why_late,
)
from rt_controller.terminal.tick_file import write_ticks
from rt_controller.virtual_car import driven_scenario, open_virtual_car, steering_note

if TYPE_CHECKING:
    from rt_controller.terminal.options import RunOptions
    from sim_bridge.session import BridgeSession

PROGRAM = "rt-controller"
VIRTUAL_MISS_SHARE = 0.02
"""of the ticks that may be late on the virtual bus, where only a simulated car depends on them"""
EXIT_DEADLINE = 4
EXIT_SAFE_STOP = 6
_SENDERS = {
    StopCause.STATE_LOST: "the vehicle",
    StopCause.REFERENCE_LOST: "the path planner",
}
_MESSAGES: dict[StopCause, Message[Any]] = {
    StopCause.STATE_INVALID: STATE,
    StopCause.REFERENCE_INVALID: REFERENCE,
}


def run_at_terminal(options: "RunOptions") -> int:
    """Drive one mission and print its summary; the exit code of the program.

    Raises:
        ConfigError, ArtifactError, MissingExtraError, BusError: found before the first tick.
    """
    options.require_consistent()
    require_interface(options.bus)
    require_writable(options.json_file)
    require_writable(options.ticks, "--ticks")
    if options.plot is not None:
        require_writable(options.plot, "--plot")
        from rt_controller.report.drive_figure import require_figure_file

        require_figure_file(options.plot)
    with announce("loading the model, assembling the QP", options.quiet):
        bundle = Bundle.load(options.model)
        mpc = build_mpc(bundle, options.mpc)
    with ExitStack() as signals:
        with ExitStack() as opened:
            car: BridgeSession | None = None
            clock: Clock = RealtimeClock()
            if options.is_virtual:
                with announce(COMPILING, options.quiet):
                    car = opened.enter_context(closing(open_virtual_car(options, options)))
                clock = LockstepClock(car.tick) if options.is_lockstep else clock
                note = steering_note(car, choose_low_speed_car(bundle, options.low_speed).geometry)
                if note is not None:
                    show(f"note: {note}", options.quiet)
            session = ControllerSession(options, options, bundle, mpc, clock, options.record)
            opened.callback(session.close)
            if options.check:
                Console(stderr=True).print(f"{session.model}: no error found", highlight=False)
                return 0
            signals.enter_context(stop_on_signals(session.request_stop))
            if car is not None and not options.is_lockstep:
                car.start(CAR_PRIORITY)
            thread = session.start(options.duration_s, options.stay, options.wait_s)
            watch(thread, partial(next, live_lines(session)), options.quiet)
            if session.failure is not None:
                raise session.failure
        figures = () if car is None else car.bridge.figures()
        _write(session, car, figures, options)
        code = _exit_code(session, car, figures, options)
        # A safe stop is the right answer to a failed plant; the failure is what a person looks for.
        is_failed = car is not None and car.bridge.summary().plant_failure is not None
        return PlantError.exit_code if is_failed and code != INTERRUPTED else code


def _write(
    session: ControllerSession,
    car: "BridgeSession | None",
    figures: Sequence[CarFigure],
    options: "RunOptions",
) -> None:
    """Print the summary and write the files that the options name."""
    plant_failure = None if car is None else car.bridge.summary().plant_failure
    if plant_failure is not None:
        print_error(PROGRAM, f"the car's plant failed: {plant_failure}")
    if session.record.deadlines.ticks == 0:
        show("ended before the first tick: nothing was driven")
    print_table(to_table(session), Console())
    if figures:
        facts = (Fact(figure.name, figure.text) for figure in figures)
        print_table(facts_table(facts, "figures of the scenario"), Console())
    scenario = None if car is None else driven_scenario(car)
    write_figures(
        options.json_file,
        {
            "driven": driven_to_json(options, scenario),
            **to_json(session),
            **figures_to_json(figures),
        },
    )
    write_ticks(options.ticks, session.record.deadlines)
    if options.plot is not None:
        drive = session.drive()
        if scenario is not None:
            drive = drive.of_scenario(scenario, tuple(figures))
        drive.plot(options.plot)


def _exit_code(
    session: ControllerSession,
    car: "BridgeSession | None",
    figures: Sequence[CarFigure],
    options: "RunOptions",
) -> int:
    """0, or the code of what went wrong, printed with its cause first."""
    record, deadlines = session.record, session.record.deadlines
    late = f"{why_late(deadlines)}; " if deadlines.deadline_misses else ""
    if record.ending is Ending.ENDED_AT_ONCE:
        print_error(PROGRAM, record.ending.value)
        return INTERRUPTED
    if record.ending is Ending.SAFE_STOPPED:
        cause = record.result.cause
        faults = () if car is None else car.bridge.faults_so_far()
        print_error(PROGRAM, f"{late}safe stop: {explain_stop(cause, session.inbox, faults)}")
        return BusError.exit_code if cause in BUS_CAUSES else EXIT_SAFE_STOP
    if deadlines.deadline_misses > _allowed_misses(options, deadlines.ticks):
        print_error(
            PROGRAM,
            f"{late}scheduled under {session.guarantees.scheduler}. docs/realtime.md says what to "
            f"grant the loop; --max-misses sets how many are allowed.",
        )
        return EXIT_DEADLINE
    missed = limits_missed(figures)
    if missed and record.ending is Ending.MISSION_OVER:
        print_error(PROGRAM, explain_missed(missed))
        return EXIT_LIMIT
    return 0


def explain_stop(cause: StopCause, inbox: Inbox, faults: Sequence[str]) -> str:
    """Why the car was stopped, with what to check; `faults` are those the scenario asked for."""
    text = cause.value
    if cause in _MESSAGES:
        text = f"{text}. {inbox.explain_out_of_range(_MESSAGES[cause])}."
    if faults:
        return f"{text.rstrip('.')}. The scenario asked for {', '.join(faults)}."
    if cause in _SENDERS:
        return (
            f"{text}. Check that {_SENDERS[cause]} (sim-bridge) runs and its frames arrive; the "
            f"summary counts dropped and missing ones."
        )
    return text


def _allowed_misses(options: "RunOptions", ticks: int) -> int:
    if options.max_misses is not None:
        return options.max_misses
    return round(VIRTUAL_MISS_SHARE * ticks) if options.is_virtual else 0
