"""The acceptance table of `acceptance.toml`, and the comparison of measured values with it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from math import nan
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, TypeAdapter, model_validator

from rt_controller.mapping.toml_file import parse

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
    is_judged_with_tyre_file: bool = True
    """False: the formula of a tyre file need not meet it; for such a car it is reported"""
    source: str | None = None
    """where the target comes from, in words; None: that of the test"""
    fitted: bool = False
    """a number of the car file, or of the test driver, was chosen with regard to this target"""


class AcceptanceTest(BaseModel):
    """One test of the table."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str
    text: str
    source: str | None = None
    """of the targets of all lines that state none of their own"""
    lines: tuple[Line, ...]

    @model_validator(mode="after")
    def _has_a_source_for_each_target(self) -> Self:
        without = [line.name for line in self.lines if line.target is not None and not line.source]
        if without and not self.source:
            raise ValueError(
                f"test {self.title!r}: expected a source for each line with a target, found none "
                f"for {', '.join(without)}. Add it to the line, or to the test."
            )
        return self


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
    is_within: bool | None
    """within the bounds, judged or not; None without a target, or if it is for another car"""
    source: str | None
    """of the target, in words; None without a target"""
    fitted: bool
    """the car was fitted to this target"""


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
    has_tyre_file: bool = False,
) -> list[LineResult]:
    """The results of a test with `car`; targets for another car are shown but not judged.

    What could not be measured (NaN) fails.

    Args:
        reached: measured values by the names of the lines.
        reference: values of the reference model, by the same names.
        is_main: False leaves out the lines whose targets are for one car.
        has_tyre_file: True if the forces of the tyres are from a `.tir` file.
    """
    return [
        check_line(
            test,
            line,
            reached[line.name],
            car,
            (reference or {}).get(line.name, nan),
            TESTS[test].source,
            has_tyre_file,
        )
        for line in TESTS[test].lines
        if is_main or line.car is None
    ]


def check_line(
    test: int,
    line: Line,
    reached: float,
    car: str,
    reference: float = nan,
    test_source: str | None = None,
    has_tyre_file: bool = False,
) -> LineResult:
    """The result of one line; `test_source` is the source of a line that states none."""
    reached = float(reached)
    target = reference if line.target == "reference" else line.target
    low = high = tolerance = source = ok = is_within = None
    if target is not None:
        source = line.source or test_source
        low, high, tolerance = _range(line, target)
        if line.car in (None, car):
            is_within = (low is None or low <= reached) and (high is None or reached <= high)
            is_judged = line.is_judged and (line.is_judged_with_tyre_file or not has_tyre_file)
            ok = is_within if is_judged else None
    return LineResult(
        test=test,
        car=car,
        name=line.name,
        unit=line.unit,
        target=target,
        reached=reached,
        tolerance=tolerance,
        low=low,
        high=high,
        ok=ok,
        is_within=is_within,
        source=source,
        fitted=line.fitted,
    )


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
    """How many judged lines pass, how many were not fitted, and how many are only reported."""
    judged = [line for line in results if line.ok is not None]
    passed = sum(line.ok is True for line in judged)
    free = [line for line in judged if not line.fitted]
    free_passed = sum(line.ok is True for line in free)
    reported = [line for line in results if line.ok is None]
    missed = sum(line.is_within is False for line in reported)
    return (
        f"{passed} of {len(judged)} judged lines pass. {len(free)} of {len(judged)} judged lines "
        f"were not fitted; {free_passed} of these pass. {len(reported)} lines are reported only; "
        f"{missed} of these miss a target"
    )


def result_of(results: Sequence[LineResult], name: str) -> LineResult:
    """The result of the line with this name."""
    return next(result for result in results if result.name == name)


def target_of(results: Sequence[LineResult], name: str) -> float:
    """The target of the line with this name; NaN if it is only reported."""
    target = result_of(results, name).target
    return nan if target is None else target
