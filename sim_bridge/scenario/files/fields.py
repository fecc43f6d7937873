"""Field types of scenario files: numbers with limits, and values that may be tables.

A value is a number, a table `{s_m = […], value = […]}` or `{t_s = […], value = […]}`, or, where a
field has generators, `{kind = "…", …}`.
"""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    Tag,
    model_validator,
)

from sim_bridge.scenario.table import Interpolation, Table, constant, increases, through
from sim_bridge.toml_file import FileTable, Number, not_empty

MAX_KNOTS = 20_000
NEAREST_KNOTS, FARTHEST_KNOT = 1e-6, 1e9

Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]


def file_name(path: Path) -> Path:
    """The path of a file.

    Raises:
        ValueError: it names a folder.
    """
    if not path.name:
        raise ValueError(f"expected the name of a file, found {str(path)!r}")
    return path


Knots = Annotated[tuple[Number, ...], Field(max_length=MAX_KNOTS), AfterValidator(not_empty)]


class OverDistance(FileTable):
    """A value over the arc length s."""

    s_m: Knots
    value: Knots
    interpolation: Interpolation = Interpolation.LINEAR

    @model_validator(mode="after")
    def _require_knots(self) -> Self:
        require_knots("s_m", self.s_m, self.value)
        return self

    def table(self) -> Table:
        """The table in the unit of the field."""
        return through(self.s_m, self.value, self.interpolation)


class OverTime(FileTable):
    """A value over the time t since the start of the drive."""

    t_s: Knots
    value: Knots
    interpolation: Interpolation = Interpolation.LINEAR

    @model_validator(mode="after")
    def _require_knots(self) -> Self:
        require_knots("t_s", self.t_s, self.value)
        return self

    def table(self) -> Table:
        """The table in the unit of the field."""
        return through(self.t_s, self.value, self.interpolation)


def require_knots(name: str, x: tuple[float, ...], values: tuple[float, ...]) -> None:
    """Return if there is a value for each knot and the knots increase.

    Raises:
        ValueError: otherwise, or the knots are so near or far that no slope can be computed.
    """
    if len(x) != len(values):
        raise ValueError(f"value: expected {len(x)} entries, as {name} has, found {len(values)}")
    if not increases(x):
        raise ValueError(f"{name}: expected knots that increase, found {_shown(x)}")
    if max(map(abs, x)) > FARTHEST_KNOT:
        raise ValueError(f"{name}: expected knots within {FARTHEST_KNOT:g}, found one beyond")
    nearest = min((after - before for before, after in pairwise(x)), default=NEAREST_KNOTS)
    if nearest < NEAREST_KNOTS:
        raise ValueError(f"{name}: expected knots {NEAREST_KNOTS:g} apart, found {nearest:g}")


NUMBER_TAG, DISTANCE_TAG, TIME_TAG = "(number)", "(over distance)", "(over time)"
"""tags of the forms of a value; in parentheses, so that messages can leave them out"""


def kind_tag(kind: str) -> str:
    """The tag of a generator."""
    return f"({kind})"


def is_tag(part: str | int) -> bool:
    """True if a part of an error's place is a tag and not a field."""
    return isinstance(part, str) and part.startswith("(")


def form_of(raw: Any) -> str | None:
    """The tag of a value as it was read from the file, or is given as an object."""
    if isinstance(raw, Mapping):
        if "kind" in raw:
            return kind_tag(str(raw["kind"]))
        return TIME_TAG if "t_s" in raw else DISTANCE_TAG
    if isinstance(raw, OverTime | OverDistance):
        return TIME_TAG if isinstance(raw, OverTime) else DISTANCE_TAG
    if isinstance(raw, FileTable):
        return kind_tag(str(getattr(raw, "kind", "")))
    return NUMBER_TAG if isinstance(raw, int | float) else None


def forms(expected: str) -> Discriminator:
    """The discriminator of a value; `expected` is what the message says where none fits."""
    return Discriminator(form_of, "scenario_form", f"expected {expected}")


_OVER_S = "a number or a table with s_m and value"
DistanceValue = Annotated[
    Annotated[Number, Tag(NUMBER_TAG)] | Annotated[OverDistance, Tag(DISTANCE_TAG)],
    forms(_OVER_S),
]
TimeValue = Annotated[
    Annotated[Number, Tag(NUMBER_TAG)] | Annotated[OverTime, Tag(TIME_TAG)],
    forms("a number or a table with t_s and value"),
]


def table_of(value: float | OverDistance | OverTime) -> Table:
    """The table of a value."""
    return constant(value) if isinstance(value, int | float) else value.table()


def require_within(table: Table, low: float, high: float, unit: str) -> None:
    """Return if all values of a table are within limits, overshoot between knots included.

    Raises:
        ValueError: otherwise; the message names the place.
    """
    for point in (table.lowest(), table.highest()):
        if not low - 1e-9 <= point.value <= high + 1e-9:
            where = "" if table.is_constant else f" at {point.x:g}"
            raise ValueError(f"expected {low:g}..{high:g}{unit}, found {point.value:.6g}{where}")


def _shown(x: tuple[float, ...]) -> str:
    before, after = next((a, b) for a, b in pairwise(x) if not a < b)
    return f"{after:g} after {before:g}"
