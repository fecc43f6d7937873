"""What a line of the acceptance table is, and how it is judged."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Generic, Protocol, TypeVar

Evidence = TypeVar("Evidence")


class Tolerance(Protocol):
    """How far from its target a number may lie."""

    def bounds(self, target: float) -> tuple[float, float]:
        """Lowest and highest number that passes."""
        ...

    def text(self, unit: str) -> str:
        """For people."""
        ...


@dataclass(frozen=True, slots=True)
class Relative:
    """On both sides, a share of the target."""

    share: float

    def bounds(self, target: float) -> tuple[float, float]:
        width = abs(target) * self.share
        return target - width, target + width

    def text(self, unit: str) -> str:
        return f"±{100.0 * self.share:g} %"


@dataclass(frozen=True, slots=True)
class Absolute:
    """On both sides, in the line's unit."""

    width: float

    def bounds(self, target: float) -> tuple[float, float]:
        return target - self.width, target + self.width

    def text(self, unit: str) -> str:
        return f"±{self.width:g} {unit}".rstrip()


@dataclass(frozen=True, slots=True)
class AtMost:
    """The target is an upper bound."""

    def bounds(self, target: float) -> tuple[float, float]:
        return -inf, target

    def text(self, unit: str) -> str:
        return "at most"


@dataclass(frozen=True, slots=True)
class AtLeast:
    """The target is a lower bound."""

    def bounds(self, target: float) -> tuple[float, float]:
        return target, inf

    def text(self, unit: str) -> str:
        return "at least"


@dataclass(frozen=True, slots=True)
class Goal:
    """A target and what still counts as reaching it."""

    target: float
    tolerance: Tolerance


@dataclass(frozen=True, slots=True)
class Line(Generic[Evidence]):
    """A line of the table: what is measured, and the goal it is held against."""

    test: int
    name: str
    unit: str
    reached: Callable[[Evidence], float]
    goal: Goal | Callable[[Evidence], Goal] | None = None
    """None: only reported. A function: the goal is itself measured"""
    car: str | None = None
    """whose goal it is; None: every car's"""
    is_judged: bool = True


@dataclass(frozen=True, slots=True)
class Verdict:
    """A line after the run."""

    test: int
    car: str
    name: str
    unit: str
    target: float | None
    reached: float
    tolerance: str | None
    low: float | None
    """lowest number that passes, None: no bound"""
    high: float | None
    ok: bool | None
    """None: reported, not judged"""


def judge(line: Line[Evidence], evidence: Evidence, car: str) -> Verdict:
    """The verdict on `car`; a goal that belongs to another car is shown and not held against it.

    What could not be measured (NaN) fails.
    """
    reached = float(line.reached(evidence))
    goal = line.goal(evidence) if callable(line.goal) else line.goal
    if goal is None:
        return Verdict(line.test, car, line.name, line.unit, None, reached, None, None, None, None)
    low, high = goal.tolerance.bounds(goal.target)
    is_judged = line.is_judged and line.car in (None, car)
    return Verdict(
        test=line.test,
        car=car,
        name=line.name,
        unit=line.unit,
        target=goal.target,
        reached=reached,
        tolerance=goal.tolerance.text(line.unit),
        low=low if isfinite(low) else None,
        high=high if isfinite(high) else None,
        ok=bool(low <= reached <= high) if is_judged else None,
    )


def has_failed(verdicts: Sequence[Verdict]) -> bool:
    """Whether a judged line missed its goal."""
    return any(verdict.ok is False for verdict in verdicts)


def line_of(verdicts: Sequence[Verdict], name: str) -> Verdict:
    """The verdict of this name."""
    return next(verdict for verdict in verdicts if verdict.name == name)


def target_of(verdicts: Sequence[Verdict], name: str) -> float:
    """What the line of this name aims at; NaN if it is only reported."""
    target = line_of(verdicts, name).target
    return nan if target is None else target
