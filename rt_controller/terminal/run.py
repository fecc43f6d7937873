"""A run of the controller at the terminal: progress on stderr, summary on stdout, exit code."""

import signal
from typing import TYPE_CHECKING

from rich.console import Console

from rt_controller.config import Pace
from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import BusError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.loop import Ending
from rt_controller.planner import build_planner
from rt_controller.realtime.accounting import write_ticks
from rt_controller.realtime.clock import Clock, RealtimeClock
from rt_controller.safety.modes import BUS_CAUSES
from rt_controller.session import ControllerSession, open_session
from rt_controller.terminal.command_line import print_error
from rt_controller.terminal.summary import live_line, to_json, to_table, why_late
from rt_controller.virtual_car import VirtualCar, build_virtual_car

if TYPE_CHECKING:
    from rt_controller.terminal.options import RunOptions

PROGRAM = "rt-controller"
LIVE_INTERVAL_S = 0.5
VIRTUAL_MISS_SHARE = 0.02
"""of the ticks that may be late on the virtual bus, where only a simulated car depends on them"""
EXIT_DEADLINE = 4
EXIT_SAFE_STOP = 6


def run_at_terminal(options: "RunOptions") -> int:
    """Drive one mission and print its summary; the exit code of the program.

    Raises:
        ConfigError, ArtifactError, MissingExtraError, BusError: found before the first tick.
    """
    options.require_consistent()
    require_writable(options.json_file)
    require_writable(options.ticks, "--ticks")
    if options.plot is not None:
        require_writable(options.plot, "--plot")
        from rt_controller.report.drive_figure import require_figure_file

        require_figure_file(options.plot)
    progress = Console(stderr=True)
    config = options.controller()
    with progress.status("loading the model, assembling the QP"):
        planner = build_planner(Bundle.load(config.model), config.mpc)
    car: VirtualCar | None = None
    if options.is_virtual:
        with progress.status("settling the car (the first start compiles it: about a minute)"):
            car = build_virtual_car(config.bus, options)
    try:
        clock: Clock = RealtimeClock(PERIOD_NS) if car is None else car.clock(options.pace)
        is_lockstep = options.pace is Pace.LOCKSTEP
        session = open_session(config, planner, clock, options.record, is_lockstep)
        try:
            if options.check:
                progress.print(f"{session.model}: no error found", highlight=False)
                return 0
            if car is not None and not is_lockstep:
                car.start()
            _drive(session, options, None if options.quiet else progress)
        finally:
            session.close()
    finally:
        if car is not None:
            car.close()
    if car is not None and car.plant_failure is not None:
        print_error(PROGRAM, f"the car's plant failed: {car.plant_failure}")
    Console().print(to_table(session))
    write_figures(options.json_file, to_json(session))
    write_ticks(options.ticks, session.record.deadlines)
    if options.plot is not None:
        session.drive().plot(options.plot)
    return _exit_code(session, options)


def _drive(session: ControllerSession, options: "RunOptions", progress: Console | None) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: session.request_stop())
    thread = session.start(options.duration_s, options.stay, options.wait_s)
    was_joined = False
    while thread.is_alive():
        thread.join(LIVE_INTERVAL_S)
        if progress is None:
            continue
        if session.is_joined and not was_joined:
            progress.print(session.guarantees.sentence(), highlight=False)
        was_joined = session.is_joined
        # On a terminal the line is overwritten, in a log each one stays.
        end = "\r" if progress.is_terminal and thread.is_alive() else "\n"
        progress.print(live_line(session.record), highlight=False, soft_wrap=True, end=end)
    if session.failure is not None:
        raise session.failure


def _exit_code(session: ControllerSession, options: "RunOptions") -> int:
    """0, or the code of what went wrong, printed with its cause first."""
    record, deadlines = session.record, session.record.deadlines
    late = f"{why_late(deadlines)}; " if deadlines.deadline_misses else ""
    if record.ending is Ending.SAFE_STOPPED:
        cause = record.result.cause
        print_error(PROGRAM, f"{late}safe stop: {cause.value}")
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
