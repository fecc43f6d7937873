"""`sim-bridge validate`: the acceptance table, or recorded drives, from the command line."""

from dataclasses import asdict
from datetime import date
from pathlib import Path

from rich.console import Console

from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.files import write_text
from rt_controller.report.page import require_report_extra
from rt_controller.report.table import Table, print_table
from rt_controller.terminal.progress import announce
from sim_bridge.plant.parameters import load_parameters, with_road_friction
from sim_bridge.plant.shipped_cars import DEFAULT_CAR
from sim_bridge.validation.acceptance import acceptance_table, count_sentence, drive_all
from sim_bridge.validation.page import acceptance_page
from sim_bridge.validation.recording.options import RecordingOptions
from sim_bridge.validation.recording.recording import Window, load_recording
from sim_bridge.validation.recording.replay import replay_recording
from sim_bridge.validation.recording.report import comparison_page, comparison_table

_LEAST_WIDTH = 150
"""of the printed table, also if the output is no terminal"""
_COMPILING = "driving (the first start compiles the car: up to a minute)"


def validate(
    car: str | None = None,
    html: Path | None = None,
    json_file: Path | None = None,
    recorded: RecordingOptions = RecordingOptions(),  # noqa: B008
) -> int:
    """Drive the acceptance tests and print the table; 1 if a line missed its target.

    With recorded drives, compare the car with these instead; nothing is judged then.
    """
    recorded.require_recording()
    require_writable(json_file)
    if html is not None:
        require_writable(html, "--html")
        require_report_extra("--html")
    if recorded.recording:
        return _validate_recordings(car or DEFAULT_CAR, recorded, html, json_file)
    with announce(_COMPILING):
        results, measured = drive_all(car)
    console = _print(acceptance_table(results))
    write_figures(json_file, [asdict(line) for line in results])
    if html is not None:
        title = _dated(f"Acceptance of {Path(car).name if car else 'the shipped cars'}")
        write_text(html, acceptance_page(results, measured, title))
    console.print(count_sentence(results))
    return int(any(line.ok is False for line in results))


def _validate_recordings(
    car: str, options: RecordingOptions, html: Path | None, json_file: Path | None
) -> int:
    """Replay each log with the car and print the comparison; always 0: nothing is judged."""
    parameters = load_parameters(car)
    if options.friction is not None:
        parameters = with_road_friction(parameters, options.friction)
    window = Window(options.from_s, options.to_s)
    recordings = [
        load_recording(log, options.column, options.period_s, window) for log in options.recording
    ]
    with announce(_COMPILING):
        replays = [replay_recording(parameters, recording) for recording in recordings]
    _print(comparison_table(replays))
    figures = [
        asdict(one) | {"compared_s": replay.compared_s, "spins": replay.spins}
        for replay in replays
        for one in replay.comparisons
    ]
    write_figures(json_file, figures)
    if html is not None:
        title = _dated(f"{Path(car).name} against recorded drives")
        write_text(html, comparison_page(replays, title))
    return 0


def _dated(title: str) -> str:
    return f"{title}, {date.today()}"


def _print(table: Table) -> Console:
    console = Console()
    console.width = max(console.width, _LEAST_WIDTH)
    print_table(table, console)
    return console
