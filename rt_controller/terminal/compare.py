"""`rt-controller compare`: the same scenarios with several controllers, and what differs."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console

from rt_controller.comparison import ComparedDrive, Comparison, compare
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.revision import source_revision
from rt_controller.report.comparison_page import comparison_page, comparison_table, headline
from rt_controller.report.drive_figure import require_figure_file, write_figure
from rt_controller.report.page import require_report_extra, save_page
from rt_controller.report.table import print_table, print_text
from rt_controller.settings import CarSettings
from rt_controller.simulation import car_settings_of
from rt_controller.terminal.progress import show
from rt_controller.terminal.run import EXIT_SAFE_STOP
from sim_bridge.campaign import Backend

if TYPE_CHECKING:
    from rt_controller.terminal.options import CompareOptions


def compare_at_terminal(controllers: Sequence[str], options: "CompareOptions") -> int:
    """Drive, print the table, write the files; the exit code of the program."""
    car = car_settings_of(
        plant=options.plant, car=options.car, friction=options.friction, faults=options.faults
    )
    scenarios, seeds, html, plot = options.scenario, options.seeds, options.html, options.plot
    require_writable(options.json_file, inputs=scenarios)
    require_writable(options.results, "--results", inputs=scenarios)
    if html is not None:
        require_report_extra("--html")
        require_writable(html, "--html", suffix=".html")
    if plot is not None:
        require_writable(plot, "--plot")
        require_figure_file(plot, moves=False)
    done, count = 0, len(controllers) * len(scenarios) * max(seeds, 1)

    def report(row: ComparedDrive) -> None:
        nonlocal done
        done += 1
        seed = f", seed {row.seed}" if row.seed else ""
        text = row.failure or f"lateral error RMS {1e3 * row.ey_rms_m:.3g} mm"
        text = f"{done} of {count}: {row.controller} in {row.scenario}{seed}: {text}"
        show(text, options.quiet)

    try:
        comparison = compare(
            controllers,
            scenarios,
            seeds=seeds,
            car=car,
            backend=Backend(options.backend, options.address, options.jobs),
            results=options.results,
            on_progress=report,
        )
    except KeyboardInterrupt:
        if options.results is not None:
            text = f"{done} of {count} drives are in {options.results}: the same command goes on"
            show(text, options.quiet)
        raise
    console, compared = Console(emoji=False), comparison.by_scenario()
    print_text(headline(compared), console)
    print_table(comparison_table(compared, seeds), console)
    write_figures(options.json_file, comparison_figures(comparison, car))
    if html is not None:
        drives = {name: comparison.first_drives(name) for name in comparison.scenarios}
        page = comparison_page(compared, seeds, drives, _conditions(car))
        show(save_page(page, html, "--html"), options.quiet)
    if plot is not None:
        write_figure(plot, comparison.plot())
    return EXIT_SAFE_STOP if all(row.failure for row in comparison.rows) else 0


def comparison_figures(comparison: Comparison, car: CarSettings) -> dict[str, Any]:
    """All rows, and the conditions of the drives, for `--json`."""
    conditions = car.model_dump(mode="json", exclude={"scenario"})
    return {"revision": source_revision(), "conditions": conditions, "drives": comparison.figures()}


def _conditions(car: CarSettings) -> str:
    chosen = car.model_dump(mode="json", exclude_defaults=True, exclude={"scenario"})
    listed = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in chosen.items())
    return f"Drives in simulated time with {listed or 'the default car'}."
