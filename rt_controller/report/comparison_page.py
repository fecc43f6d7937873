"""A comparison of controllers for people: one sentence, one table, and a page with an overlay."""

from collections.abc import Mapping
from math import exp, isfinite, log, nan
from typing import NamedTuple

from rt_controller.drive.table import Drive
from rt_controller.report.page import Page, Plot, Section
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number


class FigureColumn(NamedTuple):
    """A figure of `ComparedDrive`, as the table shows it."""

    field: str
    title: str
    unit: str
    per_si: float = 1.0


class ComparedFigures(NamedTuple):
    """Figures of one controller in one scenario, over all seeds."""

    means: Mapping[str, float]
    """by field; NaN if a drive has none"""
    worst: Mapping[str, float]
    failure: str
    """of the first drive that failed or ended early; empty: none did"""


ERROR = FigureColumn("ey_rms_m", "error", "RMS, mm", 1e3)
COLUMNS = (
    ERROR,
    FigureColumn("ey_peak_m", "peak", "mm", 1e3),
    FigureColumn("speed_rms_mps", "speed", "km/h", 3.6),
    FigureColumn("wheel_rate_rms_degps", "wheel", "deg/s"),
    FigureColumn("lateral_jerk_rms_mps3", "aside", "m/s³"),
    FigureColumn("jerk_rms_mps3", "along", "m/s³"),
    FigureColumn("step_p50_us", "step", "ms", 1e-3),
    FigureColumn("work_p50_us", "work", "ms", 1e-3),
)
NOTES = (
    "RMS values: error, lateral, of the car itself; speed, its error; wheel, rate of the steering "
    "wheel; aside and along, jerk of the car in these directions. step: median time of the "
    "processor from frames in to frames out; work: with the preparation in the time before.",
    "Below 8 m/s the law of low speeds drives with all of them.",
)
Compared = Mapping[tuple[str, str], ComparedFigures]
"""by scenario and controller"""


def headline(compared: Compared) -> str:
    """Which controller has the smallest lateral error, in how many scenarios, and who failed."""
    scenarios = list(dict.fromkeys(scenario for scenario, _ in compared))
    names = list(dict.fromkeys(name for _, name in compared))
    best = [name for each in scenarios for name in _best(compared, each, ERROR.field)]
    texts = [
        f"{name} has the smallest lateral error in {best.count(name)} of {len(scenarios)} scenarios"
        for name in names
        if name in best
    ]
    text = f"{'; '.join(texts) or 'No controller finished a drive'}."
    failed = [
        f"{name} in {', '.join(each for each in scenarios if compared[each, name].failure)}"
        for name in names
        if any(compared[each, name].failure for each in scenarios)
    ]
    if failed:
        text += f" Not finished: {'; '.join(failed)}."
    ratios = [
        f"{name} {format_number(ratio, 3)}"
        for name, ratio in mean_ratios(compared).items()
        if name != names[0] and isfinite(ratio)
    ]
    if ratios:
        text += (
            f" Lateral error over that of {names[0]}, geometric mean of the scenarios that both "
            f"finished: {', '.join(ratios)}."
        )
    return text


def mean_ratios(compared: Compared) -> dict[str, float]:
    """Geometric mean of each lateral error over that of the first controller.

    Over the scenarios that both have finished; NaN if there is none.
    """
    names = list(dict.fromkeys(name for _, name in compared))
    found = {}
    for name in names:
        pairs = [
            (compared[each, name], compared[each, names[0]])
            for each in dict.fromkeys(scenario for scenario, _ in compared)
        ]
        errors = [
            (one.means[ERROR.field], first.means[ERROR.field])
            for one, first in pairs
            if not (one.failure or first.failure)
        ]
        logs = [log(one / first) for one, first in errors if one > 0.0 and first > 0.0]
        found[name] = exp(sum(logs) / len(logs)) if logs else nan
    return found


def comparison_table(compared: Compared, seeds: int) -> Table:
    """A row for each controller in each scenario; the best value of a column is marked."""
    rows = list[Row]()
    footnotes = dict[str, int]()
    for scenario in dict.fromkeys(scenario for scenario, _ in compared):
        rows.append((scenario,))
        best = {each.field: _best(compared, scenario, each.field) for each in COLUMNS}
        for (of, name), figures in compared.items():
            if of != scenario:
                continue
            cells = [
                _cell(figures, column, name in best[column.field], seeds) for column in COLUMNS
            ]
            mark = ""
            if figures.failure:
                mark = f" [{footnotes.setdefault(figures.failure, len(footnotes) + 1)}]"
            rows.append((f"{name}{mark}", *cells))
    notes = [f"[{number}] {text}" for text, number in footnotes.items()]
    if seeds > 1:
        notes.append(f"Mean of {seeds} drives with noise of the sensors; second line: the worst.")
    columns = (Column("controller", is_text=True), *(Column(c.title, c.unit) for c in COLUMNS))
    return Table("Controllers in the same scenarios", columns, tuple(rows), (*notes, *NOTES))


def comparison_page(
    compared: Compared, seeds: int, drives: Mapping[str, Mapping[str, Drive]], conditions: str
) -> Page:
    """The page: sentence, table, and the overlay of each scenario, by name."""
    from rt_controller.report.overlay import overlay

    table = comparison_table(compared, seeds)
    sections = tuple(
        Section(
            name,
            (
                Plot(
                    overlay(of_scenario),
                    "Dashed: the path. Shaded: the last input was held, or the car was stopped.",
                ),
            ),
        )
        for name, of_scenario in drives.items()
        if of_scenario
    )
    return Page("Controllers compared", sections, (headline(compared), conditions, table))


def _best(compared: Compared, scenario: str, field: str) -> list[str]:
    """The controllers with the smallest value; several if they are equal to three digits."""
    values = {
        name: float(f"{figures.means[field]:.3g}")
        for (of, name), figures in compared.items()
        if of == scenario and isfinite(figures.means[field]) and not figures.failure
    }
    return [name for name, value in values.items() if value == min(values.values())]


def _cell(figures: ComparedFigures, column: FigureColumn, is_best: bool, seeds: int) -> Cell:
    value = figures.means[column.field] * column.per_si
    if not isfinite(value):
        return Cell(NO_VALUE)
    worst = format_number(figures.worst[column.field] * column.per_si, 3) if seeds > 1 else ""
    return Cell(format_number(value, 3), worst, "good" if is_best else "")
