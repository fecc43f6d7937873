"""A run of the controller at the terminal: progress on stderr, summary on stdout, exit code."""

from contextlib import ExitStack, closing
from functools import partial
from typing import TYPE_CHECKING

from rich.console import Console

from rt_controller.bus.transport import require_interface
from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import BusError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.loop import Ending
from rt_controller.planner import build_mpc
from rt_controller.realtime.clock import Clock, LockstepClock, RealtimeClock
from rt_controller.report.table import print_table
from rt_controller.safety.modes import BUS_CAUSES, StopCause
from rt_controller.session import ControllerSession
from rt_controller.settings import CAR_PRIORITY
from rt_controller.terminal.command_line import INTERRUPTED, print_error
from rt_controller.terminal.progress import COMPILING, announce, show, watch
from rt_controller.terminal.stop_signals import stop_on_signals
from rt_controller.terminal.summary import live_lines, to_json, to_table, why_late
from rt_controller.terminal.tick_file import write_ticks
from rt_controller.virtual_car import open_virtual_car

if TYPE_CHECKING:
    from rt_controller.terminal.options import RunOptions
    from sim_bridge.session import BridgeSession

PROGRAM = "rt-controller"
VIRTUAL_MISS_SHARE = 0.02
"""of the ticks that may be late on the virtual bus, where only a simulated car depends on them"""
EXIT_DEADLINE = 4
EXIT_SAFE_STOP = 6
_FRAMES = "runs and its frames arrive; the summary counts dropped and missing ones."
_WHAT_TO_CHECK = {
    StopCause.STATE_LOST: f". Check that the vehicle (sim-bridge) {_FRAMES}",
    StopCause.REFERENCE_LOST: f". Check that the path planner (sim-bridge) {_FRAMES}",
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
                clock = LockstepClock(car.bridge.tick) if options.is_lockstep else clock
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
        _write(session, car, options)
        return _exit_code(session, options)


def _write(session: ControllerSession, car: "BridgeSession | None", options: "RunOptions") -> None:
    """Print the summary and write the files that the options name."""
    plant_failure = None if car is None else car.bridge.summary().plant_failure
    if plant_failure is not None:
        print_error(PROGRAM, f"the car's plant failed: {plant_failure}")
    if session.record.deadlines.ticks == 0:
        show("ended before the first tick: nothing was driven")
    print_table(to_table(session), Console())
    write_figures(options.json_file, to_json(session))
    write_ticks(options.ticks, session.record.deadlines)
    if options.plot is not None:
        session.drive().plot(options.plot)


def _exit_code(session: ControllerSession, options: "RunOptions") -> int:
    """0, or the code of what went wrong, printed with its cause first."""
    record, deadlines = session.record, session.record.deadlines
    late = f"{why_late(deadlines)}; " if deadlines.deadline_misses else ""
    if record.ending is Ending.ENDED_AT_ONCE:
        print_error(PROGRAM, record.ending.value)
        return INTERRUPTED
    if record.ending is Ending.SAFE_STOPPED:
        cause = record.result.cause
        print_error(PROGRAM, f"{late}safe stop: {cause.value}{_WHAT_TO_CHECK.get(cause, '')}")
        return BusError.exit_code if cause in BUS_CAUSES else EXIT_SAFE_STOP
    if deadlines.deadline_misses > _allowed_misses(options, deadlines.ticks):
        print_error(
            PROGRAM,
            f"{late}scheduled under {session.guarantees.scheduler}. docs/realtime.md says what to "
            f"grant the loop; --max-misses sets how many are allowed.",
        )
        return EXIT_DEADLINE
    return 0


def _allowed_misses(options: "RunOptions", ticks: int) -> int:
    if options.max_misses is not None:
        return options.max_misses
    return round(VIRTUAL_MISS_SHARE * ticks) if options.is_virtual else 0
