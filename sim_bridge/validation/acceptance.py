"""The acceptance table of `acceptance.toml`, and the comparison of measured values with it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from math import nan
from typing import Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter

from sim_bridge.toml_file import parse

_TABLE = "acceptance.toml"


class Line(BaseModel):
    """A line of the table; without a target it is reported only."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    unit: str = ""
    target: float | Literal["reference"] | None = None
    """"reference": measured with the reference model"""
    share: float | None = None
    """tolerance on both sides, relative to the target"""
    width: float | None = None
    """tolerance on both sides, in the unit of the line"""
    bound: Literal["at most", "at least"] | None = None
    """the target is the largest or the smallest value that passes"""
    car: str | None = None
    """the car that the target is for; None: every car"""
    is_judged: bool = True


class AcceptanceTest(BaseModel):
    """One test of the table."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str
    text: str
    lines: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class LineResult:
    """A line of the table, compared with its target."""

    test: int
    car: str
    name: str
    unit: str
    target: float | None
    reached: float
    tolerance: str | None
    """in words"""
    low: float | None
    """smallest number that passes; None: no bound"""
    high: float | None
    ok: bool | None
    """None: reported, not judged"""


def _load_table() -> dict[int, AcceptanceTest]:
    text = (resources.files("sim_bridge") / "validation" / _TABLE).read_text("utf-8")
    tests = parse(text, TypeAdapter(dict[str, tuple[AcceptanceTest, ...]]), _TABLE)["tests"]
    return dict(enumerate(tests, 1))


TESTS = _load_table()
"""by the number of the test"""


def check(
    test: int,
    reached: Mapping[str, float],
    car: str,
    reference: Mapping[str, float] | None = None,
    is_main: bool = True,
) -> list[LineResult]:
    """The results of a test with `car`; targets for another car are shown but not judged.

    What could not be measured (NaN) fails.

    Args:
        reached: measured values by the names of the lines.
        reference: values of the reference model, by the same names.
        is_main: False leaves out the lines whose targets are for one car.
    """
    return [
        check_line(test, line, reached[line.name], car, (reference or {}).get(line.name, nan))
        for line in TESTS[test].lines
        if is_main or line.car is None
    ]


def check_line(
    test: int, line: Line, reached: float, car: str, reference: float = nan
) -> LineResult:
    """The result of one line."""
    reached = float(reached)
    target = reference if line.target == "reference" else line.target
    if target is None:
        return LineResult(test, car, line.name, line.unit, None, reached, None, None, None, None)
    low, high, tolerance = _range(line, target)
    ok = None
    if line.is_judged and line.car in (None, car):
        ok = (low is None or low <= reached) and (high is None or reached <= high)
    return LineResult(test, car, line.name, line.unit, target, reached, tolerance, low, high, ok)


def _range(line: Line, target: float) -> tuple[float | None, float | None, str]:
    """Smallest and largest value that pass, and the tolerance in words."""
    if line.bound == "at most":
        return None, target, line.bound
    if line.bound == "at least":
        return target, None, line.bound
    if line.share is not None:
        width, tolerance = abs(target) * line.share, f"±{100.0 * line.share:g} %"
    else:
        width = line.width or 0.0
        tolerance = f"±{width:g} {line.unit}"
    return target - width, target + width, tolerance


def has_failed(results: Sequence[LineResult]) -> bool:
    """True if a judged line missed its target."""
    return any(result.ok is False for result in results)


def count_sentence(results: Sequence[LineResult]) -> str:
    """How many lines pass and how many are only reported."""
    passed = sum(line.ok is True for line in results)
    judged = sum(line.ok is not None for line in results)
    return f"{passed} of {judged} lines pass, {len(results) - judged} reported"


def result_of(results: Sequence[LineResult], name: str) -> LineResult:
    """The result of the line with this name."""
    return next(result for result in results if result.name == name)


def target_of(results: Sequence[LineResult], name: str) -> float:
    """The target of the line with this name; NaN if it is only reported."""
    target = result_of(results, name).target
    return nan if target is None else target
