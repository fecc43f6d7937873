"""How a scenario file may give a value: a number, a table with knots, or a kind with its fields."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import date, time
from functools import reduce
from itertools import pairwise
from operator import or_
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Self

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    Tag,
    model_validator,
)
from pydantic_core import CoreSchema

from sim_bridge.scenario.table import Interpolation, Table, constant, through
from sim_bridge.toml_file import FileTable, Number

MAX_KNOTS = 20_000
NEAREST_KNOTS = 1e-6
TOLERANCE = 1e-9

Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
_Numbers = Annotated[tuple[Number, ...], Field(max_length=MAX_KNOTS)]
_Places = Annotated[
    tuple[Annotated[Number, Field(ge=-1e9, le=1e9)], ...], Field(max_length=MAX_KNOTS)
]


class Knots(FileTable):
    """A value over one of the axes."""

    axis: ClassVar[str]
    value: _Numbers
    interpolation: Interpolation = Interpolation.LINEAR

    @model_validator(mode="after")
    def _require_knots(self) -> Self:
        name, x = self.axis, self.x
        if not x:
            raise ValueError(f"{name}: expected at least one entry, found none")
        if len(x) != len(self.value):
            raise ValueError(
                f"value: expected {len(x)} entries, as {name} has, found {len(self.value)}"
            )
        for before, after in pairwise(x):
            if not after - before >= NEAREST_KNOTS:
                raise ValueError(
                    f"{name}: expected knots that increase by {NEAREST_KNOTS:g} or more, found "
                    f"{after:g} after {before:g}"
                )
        return self

    @property
    def x(self) -> tuple[float, ...]:
        """Places of the knots, in m or s."""
        return tuple(getattr(self, self.axis))

    def table(self) -> Table:
        """The table in the unit of the field."""
        return through(self.x, self.value, self.interpolation)


class OverDistance(Knots):
    """A value over the arc length s."""

    axis = "s_m"
    s_m: _Places


class OverTime(Knots):
    """A value over the time t since the start of the drive."""

    axis = "t_s"
    t_s: _Places


@dataclass(frozen=True, eq=False)
class Written:
    """How a file may give the value of a field: a number, or one of some tables.

    It is the annotation of the field. A value that is not of a file, such as a `Table`, is passed
    to `convert` as it is.
    """

    tables: Mapping[str, type[FileTable]]
    """by their axis (knots over s_m or t_s) or their kind"""
    convert: Callable[[Any], Any]
    """from what was read to the value of the field"""
    limits: str
    """in words"""

    @property
    def forms(self) -> str:
        """What a file may write."""
        axes = {name: f"table over {name}" for name in (OverDistance.axis, OverTime.axis)}
        return ", ".join(("number", *(axes.get(name, name) for name in self.tables)))

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """The number or the table by its tag, then `convert`."""
        members: list[Any] = [
            Annotated[table, Tag(f"({name})")] for name, table in self.tables.items()
        ]
        members += [Annotated[Number, Tag(_NUMBER)], Annotated[Any, Tag(_OBJECT)]]
        expected = f"expected one of these: {self.forms}"
        form: Any = Annotated[
            reduce(or_, members),
            Discriminator(_tag, custom_error_type="form", custom_error_message=expected),
            AfterValidator(self.convert),
        ]
        return handler.generate_schema(form)


_NUMBER, _OBJECT = "(number)", "(object)"


def _tag(raw: Any) -> str | None:
    if isinstance(raw, Mapping):
        return f"({raw.get('kind', 't_s' if 't_s' in raw else 's_m')})"
    if isinstance(raw, int | float):
        return _NUMBER
    is_of_a_file = isinstance(raw, str | list | tuple | date | time | type(None))
    return None if is_of_a_file else _OBJECT


def table_within(
    low: float,
    high: float,
    unit: str = "",
    *,
    factor: float = 1.0,
    tables: Mapping[str, type[FileTable]] = MappingProxyType({"s_m": OverDistance}),
) -> Written:
    """A field that is a `Table` in SI units, with limits in its own `unit`.

    `factor` converts to SI.
    """

    def convert(found: Any) -> Table:
        if isinstance(found, Table):  # of a map, in SI units
            require_within(found.scaled(1.0 / factor), low, high, unit)
            return found
        table = constant(found) if isinstance(found, int | float) else found.table()
        require_within(table, low, high, unit)
        return table if factor == 1.0 else table.scaled(factor)

    span = f"±{high:g}" if low == -high else f"{low:g}..{high:g}"
    return Written(tables, convert, span)


def require_within(table: Table, low: float, high: float, unit: str) -> None:
    """Return if all values of a table are within limits, overshoot between knots included.

    Raises:
        ValueError: otherwise; the message names the place.
    """
    for point in (table.lowest(), table.highest()):
        if not low - TOLERANCE <= point.value <= high + TOLERANCE:
            where = "" if table.is_constant else f" at {point.x:g}"
            limits = f"{low:g}..{high:g} {unit}".rstrip()
            raise ValueError(f"expected {limits}, found {point.value:.6g}{where}")
