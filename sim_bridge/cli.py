"""`sim-bridge`: a simulated car at the other end of a CAN bus, as a process of its own.

Progress goes to stderr, the summary to stdout. Bus, car and FMU tools are imported when a command
runs.
"""

from contextlib import ExitStack, closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from pydantic import Field
from rich.console import Console

from rt_controller.contract.errors import BusError, ConfigError, OutputError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import LONGEST_S
from rt_controller.drive.scenario import EXIT_LIMIT, explain_missed, figures_to_json, limits_missed
from rt_controller.settings import CAR_PRIORITY, VIRTUAL, BusSettings, CarSettings, SharedInterface
from rt_controller.terminal.command_line import new_app, print_error, run_command
from rt_controller.terminal.progress import SETTLING, Line, announce, show, watch
from rt_controller.terminal.stop_signals import stop_on_signals

if TYPE_CHECKING:
    from rt_controller.bus.log.recorder import Recorder
    from sim_bridge.bridge import Bridge

PROGRAM = "sim-bridge"
LISTENING_TICKS = 8
"""before the first frame; another vehicle would send in each of them"""

app = new_app(
    PROGRAM,
    "Simulate a car on a CAN bus: the project's own, an FMU, or CommonRoad's. The summary "
    "goes to stdout, progress and messages to stderr. Exit codes: 0 ok, 1 a validation target was "
    "missed, 2 usage or configuration, 3 an optional package or the C compiler is missing, 5 the "
    "bus failed, another vehicle is on it, or the vehicle's watchdog braked the car while "
    "it was driven, 7 the plant failed, 8 the drive missed a limit of its scenario, 9 a log or a "
    "result file is incomplete, 130 ended by Ctrl-C while it was loading.",
    "--bus NAME",
    {
        "Main options": "bus channel scenario car friction faults signals record json",
        "Bus": "bitrate bus-option wait-s priority",
        "Simulated car": "plant plant-mapping friction-right transport-delay actuation-delay",
        "Results": "overwrite quiet",
    },
)


class BridgeOptions(CarSettings, BusSettings):
    """Options of one run of the bridge."""

    bus: SharedInterface | str
    """python-can interface, these or another that other processes reach"""

    signals: Path | None = None
    """mapping file of a car with messages of its own, which the simulated car then has on this bus;
    rt-controller signals gateway translates them"""
    wait_s: Annotated[float, Field(gt=0.0, le=LONGEST_S, allow_inf_nan=False)] = 60.0
    """longest wait for a controller"""
    priority: Annotated[int, Field(ge=0, le=99)] = CAR_PRIORITY
    """SCHED_FIFO priority, where the system allows it; 0: none"""
    record: Path | None = None
    """write all frames to this candump log (.log), or to a new one in this folder"""
    overwrite: bool = False
    """replace an existing log of --record, which otherwise is refused"""
    json_file: Annotated[Path | None, Parameter(name="--json")] = None
    """write the summary to this JSON file"""
    quiet: bool = False
    """no progress on stderr; errors and the result remain"""


@app.default
def run(*, options: Annotated[BridgeOptions, Parameter(name="*")]) -> int:
    """Wait for a controller, simulate the scenario, brake if the controller stops sending."""
    from rt_controller.bus.log.recorder import Recorder, require_recordable
    from rt_controller.realtime.scheduling import real_time_process
    from sim_bridge.scenario_checks import notes
    from sim_bridge.session import open_session

    if options.bus == VIRTUAL:
        raise ConfigError(
            "--bus virtual: expected an interface that other processes reach, found one that stays "
            "in this process. Use --bus local for both programs, or rt-controller --bus virtual "
            "alone, which simulates the car itself."
        )
    require_writable(options.json_file)
    require_recordable(options.record, options.overwrite)
    options.require_openable()
    with ExitStack() as signals:
        with ExitStack() as opened:
            # First: the threads that a bus or a log starts inherit the settings of the process.
            opened.enter_context(real_time_process(options.priority))
            log, recorder = options.record, None
            if log is not None:
                recorder = Recorder(
                    log, options.channel, is_lockstep=False, replaces=options.overwrite
                )
                opened.enter_context(recorder)
            with announce(SETTLING, options.quiet):
                session = open_session(
                    options,
                    options.scenario,
                    recorder,
                    options,
                    options.faults,
                    signals=options.signals,
                )
            for note in notes(session.bridge.scenario, options.friction is not None):
                show(f"note: {note}", options.quiet)
            opened.enter_context(closing(session))
            signals.enter_context(stop_on_signals(session.request_stop))
            thread = session.start(options.priority, LISTENING_TICKS, options.wait_s)
            watch(thread, partial(_line, session.bridge, recorder), options.quiet)
            is_stopped = session.is_stop_requested
        return _end(session.bridge, is_stopped, recorder, options)


def _line(bridge: "Bridge", recorder: "Recorder | None") -> Line:
    failure = "" if recorder is None else recorder.new_failure()
    if bridge.is_waiting:
        return Line("waiting for a controller", warning=failure)
    return Line("driving", bridge.summary().figures_text, warning=failure)


def _end(
    bridge: "Bridge", is_stopped: bool, recorder: "Recorder | None", options: BridgeOptions
) -> int:
    """Print the summary of a run and write its file; the exit code.

    Raises:
        BusError: no controller took the car, or while it drove the watchdog braked the car or the
            bus failed.
        PlantError: the plant failed during the drive.
    """
    from rt_controller.bus.log.recorder import log_to_json
    from rt_controller.report.table import Fact, facts_table, print_table, print_text

    summary, figures = bridge.summary(), bridge.figures()
    if summary.ticks > 0 or is_stopped:
        print_text(summary.text(is_stopped), Console())
    if figures:
        facts = (Fact(figure.name, figure.text) for figure in figures)
        print_table(facts_table(facts, "figures of the scenario"), Console())
    output = {**asdict(summary), **figures_to_json(figures), **log_to_json(recorder)}
    failures = [] if recorder is None else [recorder.explain_failure()]
    try:
        write_figures(options.json_file, output)
    except OutputError as error:  # what the drive ended with is said all the same
        failures.append(str(error))
    for failure in filter(None, failures):
        print_error(PROGRAM, failure)
    bridge.require_readable_bus()
    summary.require_success()
    if summary.ticks == 0 and not is_stopped:
        raise BusError(
            f"Expected a controller to take the car, found none on channel {options.channel!r} "
            f"within --wait-s {options.wait_s:g} s. Start rt-controller on the same bus and "
            f"channel."
        )
    missed = limits_missed(figures)
    if not missed or is_stopped or summary.watchdog_braked:
        return OutputError.exit_code if any(failures) else 0
    print_error(PROGRAM, explain_missed(missed))
    return EXIT_LIMIT


@app.command
def validate(
    *, car: str | None = None, json_file: Annotated[Path | None, Parameter(name="--json")] = None
) -> int:
    """Compare the own car with published measurements; 1 if a line missed its target.

    Parameters
    ----------
    car
        drive all tests with this car; default: each test with the car that its targets belong to
    json_file
        write the lines to this file: test, name, car, kind, target, reached,
        tolerance, ok, source
    """
    from rt_controller.report.table import print_table
    from sim_bridge.validation.acceptance import acceptance_table, count_sentence, drive_all

    require_writable(json_file)
    with announce("driving"):
        results = drive_all(car)
    console = Console(emoji=False)
    print_table(acceptance_table(results), console)
    write_figures(json_file, [line._asdict() for line in results])
    console.print(count_sentence(results))
    return int(any(line.ok is False for line in results))


def main() -> None:
    """Entry point of the console script."""
    run_command(app)
