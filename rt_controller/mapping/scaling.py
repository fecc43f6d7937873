"""Conversion of the numbers of a column to SI: sign, factor, offset and unit together."""

from typing import NamedTuple

from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.tables import ColumnMapping
from rt_controller.mapping.units import find_unit, near_units


class Scaling(NamedTuple):
    """SI value = factor * number + offset."""

    si: str
    factor: float
    offset: float


def scaling_of(
    where: str, own: str | None, column: ColumnMapping, name: str, si: str | None
) -> Scaling:
    """The conversion of a column, in the unit of the mapping or else in that of the file.

    A factor may convert to another quantity, such as bar at the wheel to N at the pedal: then the
    unit of the mapping is that of the product, and the unit of the file does not count.

    Args:
        where: file and column, for messages.
        own: unit that the file gives; None: none.
        column: its mapping.
        name: of the signal.
        si: unit that the signal must have in SI; None: any.

    Raises:
        DatasetError: no unit, or one that does not fit.
    """
    of_file = find_unit(own) if own is not None else None
    of_mapping = find_unit(column.unit) if column.unit is not None else None
    if of_mapping and of_file and of_mapping != of_file:
        is_other = of_mapping.si != of_file.si
        if not is_other or column.factor == 1.0:
            hint = f"; or write a factor that converts {own} to {column.unit}" if is_other else ""
            raise DatasetError(
                f"{where}: expected numbers in {column.unit} as the mapping says of {name}, found "
                f"{column.column!r} in {own}, as the file says. Correct the unit in the mapping or "
                f"in that file{hint}. All logs of one import need the same units."
            )
    unit = of_mapping or of_file
    if unit is None:
        found = repr(own) if own else "no unit in the file"
        raise DatasetError(
            f"{where}: expected a unit, found {found} and none in the mapping. Write unit for "
            f"{name}; {near_units(own or '')}."
        )
    if si and unit.si != si:
        raise DatasetError(
            f"{where}: expected a unit that is converted to {si} as in the name {name}, found "
            f"{own or column.unit}, which is converted to {unit.si}. Name another column, "
            f"or write the unit in the mapping."
        )
    sign = column.sign
    return Scaling(
        unit.si,
        sign * unit.factor * column.factor,
        sign * (unit.factor * column.offset + unit.offset),
    )
