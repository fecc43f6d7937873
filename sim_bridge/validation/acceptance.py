"""The acceptance table of `acceptance.toml`: driven, compared with its targets, and printed."""

from collections.abc import Sequence
from functools import cache
from importlib import resources
from itertools import groupby
from math import isfinite
from typing import Literal, NamedTuple

from pydantic import TypeAdapter

from rt_controller.mapping.toml_file import parse
from rt_controller.report.table import Cell, Column, Row, Table, format_number
from sim_bridge.plant.parameters import load_parameters
from sim_bridge.toml_file import FileTable
from sim_bridge.validation.lateral import LATERAL
from sim_bridge.validation.longitudinal import LONGITUDINAL
from sim_bridge.validation.run import Measured

Kind = Literal["measured", "regulation", "implementation check"]
_TABLE = "acceptance.toml"
_NO_VALUE = "no such value in this drive"
MANOEUVRES = {each.__name__: each for each in (*LATERAL, *LONGITUDINAL)}
"""by the name that the table uses"""


class Line(FileTable):
    """A line of the table; without a target it is reported only. The file says what is what."""

    name: str
    unit: str = ""
    target: float | None = None
    share: float | None = None
    width: float | None = None
    bound: Literal["at most", "at least"] | None = None
    any_car: bool = False
    not_judged: str | None = None
    kind: Kind | None = None
    source: str | None = None
    fitted: bool = False


class AcceptanceTest(FileTable):
    """A manoeuvre, the cars that drive it, and the lines with its values."""

    title: str
    manoeuvre: str
    cars: tuple[str, ...]
    kind: Kind
    text: str
    source: str | None = None
    lines: tuple[Line, ...]


class LineResult(NamedTuple):
    """A line of the table, compared with its target."""

    test: int
    car: str
    name: str
    unit: str
    kind: Kind
    target: float | None
    reached: float  # NaN if the drive does not contain it
    tolerance: str | None  # in words
    low: float | None  # smallest number that passes; None: no bound
    high: float | None
    ok: bool | None  # None: reported, not judged
    is_within: bool | None  # of the bounds, judged or not; None if there is nothing to compare
    not_judged: str | None  # why a line with a target is not judged
    source: str | None  # of the target, in words
    fitted: bool  # the car was fitted to this target


def _load_table() -> dict[int, AcceptanceTest]:
    text = (resources.files("sim_bridge") / "validation" / _TABLE).read_text("utf-8")
    tests = parse(text, TypeAdapter(dict[str, tuple[AcceptanceTest, ...]]), _TABLE)["tests"]
    return dict(enumerate(tests, 1))


TESTS = _load_table()
"""by the number of the test"""


def drive_all(car: str | None = None) -> list[LineResult]:
    """The lines of all tests, driven with `car` or the cars of each test.

    Raises:
        ConfigError: there is no such car.
    """

    @cache
    def drive(manoeuvre: str, name: str) -> Measured:
        return MANOEUVRES[manoeuvre](load_parameters(name))

    results: list[LineResult] = []
    for number, test in TESTS.items():
        for name in (car,) if car else test.cars:
            one = drive(test.manoeuvre, name)
            results += [check_line(number, test, line, one[line.name], name) for line in test.lines]
    return results


def check_line(
    number: int, test: AcceptanceTest, line: Line, reached: float, car: str
) -> LineResult:
    """The result of one line; a target for another car and a value that is NaN are not judged."""
    reached, target = float(reached), line.target
    low = high = tolerance = source = ok = is_within = not_judged = None
    if target is not None:
        source = line.source or test.source
        low, high, tolerance = _range(line, target)
        if not isfinite(reached):
            not_judged = _NO_VALUE
        elif not line.any_car and car not in test.cars:
            not_judged = "target of another car"
        else:
            is_within = (low is None or low <= reached) and (high is None or reached <= high)
            not_judged = line.not_judged
            ok = is_within if not_judged is None else None
    identity = (number, car, line.name, line.unit, line.kind or test.kind)
    judgement = (low, high, ok, is_within, not_judged)
    return LineResult(*identity, target, reached, tolerance, *judgement, source, line.fitted)


def _range(line: Line, target: float) -> tuple[float | None, float | None, str]:
    """Smallest and largest value that pass, and the tolerance in words."""
    if line.bound is not None:
        is_most = line.bound == "at most"
        return None if is_most else target, target if is_most else None, line.bound
    if line.share is not None:
        width, tolerance = abs(target) * line.share, f"±{100.0 * line.share:g} %"
    else:
        width = line.width or 0.0
        tolerance = f"±{width:g} {line.unit}".strip()
    return target - width, target + width, tolerance


def count_sentence(results: Sequence[LineResult]) -> str:
    """How many judged lines pass, how many were not fitted, and how many are only reported."""
    judged = [line for line in results if line.ok is not None]
    free = [line for line in judged if not line.fitted]
    missed = sum(line.ok is None and line.is_within is False for line in results)
    return (
        f"{sum(line.ok is True for line in judged)} of {len(judged)} judged lines pass. "
        f"{len(free)} of {len(judged)} judged lines were not fitted; "
        f"{sum(line.ok is True for line in free)} of these pass. {len(results) - len(judged)} "
        f"lines are not judged; {missed} of these are outside the range of their target"
    )


def acceptance_table(results: Sequence[LineResult]) -> Table:
    """The lines with a heading for each test and car."""
    numbers = ("reached", "target", "tolerance")
    heads = ("line", "", *numbers, "unit", "kind", "remark")
    columns = [Column(h, "", h not in numbers, "short" if h == "unit" else "") for h in heads]
    rows: list[Row] = []
    for (test, car), lines in groupby(results, key=lambda line: (line.test, line.car)):
        rows.append((f"{test} · {TESTS[test].title}, {car}",))
        for line in lines:
            numbers = (
                format_number(line.reached),
                "" if line.target is None else format_number(line.target),
                line.tolerance or "",
            )
            remarks = ["fitted"] * line.fitted
            remarks += [f"not judged: {line.not_judged}"] if line.not_judged else []
            words = (line.unit, line.kind, "; ".join(remarks))
            rows.append((line.name, _mark(line), *numbers, *words))
    return Table("", tuple(columns), tuple(rows))


def _mark(line: LineResult) -> Cell:
    """Whether the line passes; of a line that is not judged, where it lies."""
    if line.ok is not None:
        return Cell("ok", status="good") if line.ok else Cell("MISSED", status="bad")
    place = {None: "reported", True: "inside", False: "outside"}[line.is_within]
    return Cell(place, status="faint")
