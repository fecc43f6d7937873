"""The acceptance table for the terminal and the HTML page with its figures."""

from itertools import groupby

from rt_controller.report.page import Page, Part, Plot, Section, render_page
from rt_controller.report.table import Cell, Column, Row, Table
from sim_bridge.validation.acceptance import LineResult, count_sentence
from sim_bridge.validation.measurements import Measurements

_COLUMNS = (
    Column("line", is_text=True),
    Column("target"),
    Column("reached"),
    Column("tolerance"),
    Column("unit", is_text=True),
    Column("", is_text=True),
)
_MARKS = {
    True: Cell("ok", status="good"),
    False: Cell("MISSED", status="bad"),
    None: Cell("reported", status="faint"),
}
_CHAPTERS = {
    1: (
        "Numerics",
        "Checks that hold for any car: wheel loads at rest, a mirrored run, half the integration "
        "step, and no gain of energy while coasting.",
    ),
    2: (
        "Steady-state cornering",
        "80 km/h, the steering wheel turns at 2 deg/s. Slopes are taken up to 0.3 g; the dashed "
        "lines have the target's slope.",
    ),
    3: (
        "Lane change at the limit",
        "120 km/h, 3.5 m to the left within 25 m and back, road friction 0.85, a driver with "
        "preview. Dashed: the peaks of the reference car.",
    ),
    4: (
        "Cross-check",
        "The multi-body model of commonroad-vehicle-models against this plant with the same "
        "parameters: 22.2 m/s, ramps of the road wheel.",
    ),
    5: (
        "Step steer and frequency response",
        "Steps to 4 m/s² and sines of 15 deg at the steering wheel.",
    ),
    6: (
        "Sine with dwell",
        "80 km/h, 0.7 Hz, 0.5 s of constant angle in the second peak. The car has no stability "
        "control, so this is reported and not judged.",
    ),
    7: ("Braking and acceleration", "150 N at the pedal from 100 km/h; full throttle from rest."),
}
"""title and text by test"""


def acceptance_table(results: list[LineResult]) -> Table:
    """The lines with a heading for each test and car."""
    rows: list[Row] = []
    for (test, car), lines in groupby(results, key=lambda line: (line.test, line.car)):
        rows.append((f"test {test}, {car}",))
        rows += [
            (
                line.name,
                "" if line.target is None else f"{line.target:.4g}",
                f"{line.reached:.4g}",
                line.tolerance or "",
                line.unit,
                _MARKS[line.ok],
            )
            for line in lines
        ]
    return Table("", _COLUMNS, tuple(rows))


def acceptance_page(measured: Measurements) -> str:
    """The whole page as HTML, with a section for each test.

    Raises:
        MissingExtraError: the extra `report` is not installed.
    """
    from sim_bridge.validation.figures import figures_of

    sections = []
    for test, (title, text) in _CHAPTERS.items():
        lines = [line for line in measured.results if line.test == test]
        if lines:
            plots = (Plot(figure) for figure in figures_of(test, measured))
            parts: tuple[Part, ...] = (text, acceptance_table(lines), *plots)
            sections.append(Section(f"{test} · {title}", parts))
    introduction = (f"{count_sentence(measured.results)}.",)
    return render_page(Page("Acceptance of the car", tuple(sections), introduction))
