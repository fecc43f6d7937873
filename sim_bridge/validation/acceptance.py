"""A line of the acceptance table: what was measured, its goal, and the result of the comparison."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan

# The cars that the targets belong to, by the names of their files.
ALL_WHEEL = "c_class_150kw_awd"
FRONT_WHEEL = "c_class_125kw_fwd"
COMMONROAD = "commonroad_vehicle_2"


@dataclass(frozen=True, slots=True)
class Goal:
    """A target and the range that passes."""

    target: float
    low: float
    high: float
    tolerance: str
    """in words"""


def within(target: float, share: float) -> Goal:
    """A goal with a tolerance on both sides, relative to the target."""
    width = abs(target) * share
    return Goal(target, target - width, target + width, f"±{100.0 * share:g} %")


def near(target: float, width: float, unit: str) -> Goal:
    """A goal with a tolerance on both sides, in the unit of the line."""
    return Goal(target, target - width, target + width, f"±{width:g} {unit}")


def at_most(target: float) -> Goal:
    """A goal whose target is the upper bound."""
    return Goal(target, -inf, target, "at most")


def at_least(target: float) -> Goal:
    """A goal whose target is the lower bound."""
    return Goal(target, target, inf, "at least")


@dataclass(frozen=True, slots=True)
class Line:
    """A measured line of the table."""

    name: str
    unit: str
    reached: float
    goal: Goal | None = None
    """None: reported only"""
    car: str | None = None
    """the car that the goal is for; None: every car"""
    is_judged: bool = True


@dataclass(frozen=True, slots=True)
class LineResult:
    """A line of the table, compared with its goal."""

    test: int
    car: str
    name: str
    unit: str
    target: float | None
    reached: float
    tolerance: str | None
    low: float | None
    """smallest number that passes; None: no bound"""
    high: float | None
    ok: bool | None
    """None: reported, not judged"""


def check(test: int, lines: Iterable[Line], car: str) -> list[LineResult]:
    """The results of a test with `car`; goals for another car are shown but not judged.

    What could not be measured (NaN) fails.
    """
    return [_check(test, line, car) for line in lines]


def _check(test: int, line: Line, car: str) -> LineResult:
    goal, reached = line.goal, float(line.reached)
    if goal is None:
        return LineResult(test, car, line.name, line.unit, None, reached, None, None, None, None)
    is_judged = line.is_judged and line.car in (None, car)
    return LineResult(
        test=test,
        car=car,
        name=line.name,
        unit=line.unit,
        target=goal.target,
        reached=reached,
        tolerance=goal.tolerance,
        low=goal.low if isfinite(goal.low) else None,
        high=goal.high if isfinite(goal.high) else None,
        ok=bool(goal.low <= reached <= goal.high) if is_judged else None,
    )


def has_failed(results: Sequence[LineResult]) -> bool:
    """True if a judged line missed its goal."""
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
