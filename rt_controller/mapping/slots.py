"""Slots: each signal that a car sends or receives, by the name of its place in the mapping file."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import VEHICLE
from rt_controller.mapping.quantity import Quantity, quantity_of_name
from rt_controller.mapping.tables import ColumnMapping, DrivingMapping, SignalMapping, SwitchMapping
from rt_controller.mapping.units import find_unit, near_units, si_unit_of_name

_UNITS = {**VEHICLE.units, "x": "m", "y": "m", "yaw": "rad"}


class Slot(NamedTuple):
    """One signal of the car."""

    name: str
    """table and field: "states.vx_mps", "pose.yaw", "commands.throttle" """
    column: ColumnMapping
    si: str
    """SI unit; empty: that of the mapping or of the file"""
    quantity: Quantity = Quantity.OTHER
    """whose limits a measurement keeps"""
    plausible: tuple[float, float] | None = None
    """in SI, as the mapping gives it; then neither those limits nor the range of the DBC count"""
    on: frozenset[int] | None = None
    """raw values of a switch that mean 1; None: its value is in SI"""
    off: frozenset[int] | None = None
    """raw values that mean 0; all others are not known. None: see `Measurement`"""


def measured_slots(mapping: DrivingMapping) -> tuple[Slot, ...]:
    """What the car sends: states, inputs, curvature, pose, reference, mission."""
    poses = zip(("x", "y", "yaw"), mapping.pose_columns, strict=False)
    tables = {
        **{name: getattr(mapping, name).items() for name in ("states", "inputs", "exogenous")},
        "pose": poses,
        "reference": mapping.reference,
        "mission": mapping.mission,
    }
    return tuple(slot for name, table in tables.items() for slot in slots_of(name, table))


def command_slots(mapping: DrivingMapping) -> tuple[Slot, ...]:
    """What the car receives."""
    return tuple(slots_of("commands", mapping.commands))


def driving_slot(mapping: DrivingMapping) -> tuple[Slot, ...]:
    """The first constant of [messages] by which driving and standby differ, as "driving"; or none.

    Its value is 1 while the controller drives and 0 in standby.
    """
    for name, message in mapping.messages.items():
        for signal, driving in message.driving.items():
            standby = message.standby.get(signal, driving)
            if driving != standby:
                factor = 1.0 / (driving - standby)
                offset = -standby * factor
                column = f"{name}.{signal}"
                mapped = ColumnMapping(column=column, unit="1", factor=factor, offset=offset)
                return (Slot("driving", mapped, "1"),)
    return ()


def slots_of(table: str, columns: Iterable[tuple[str, object]]) -> Iterator[Slot]:
    """The slots of a table; of the table "signals", those of a log, any unit may be wanted."""
    for name, column in columns:
        if not isinstance(column, ColumnMapping):  # a constant
            continue
        si = _UNITS.get(name) or si_unit_of_name(name) or ("" if table == "signals" else "1")
        unit = find_unit(column.unit) if column.unit else None
        # c1 is a slope: a ratio, or for small angles the angle; a position may be geographic.
        if name in ("c1", "x", "y") and unit is not None and unit.si == "rad":
            si = "rad"
        quantity, plausible = Quantity.OTHER, None
        if isinstance(column, SignalMapping):
            plausible = column.plausible
            if table in ("states", "inputs", "signals"):
                quantity = column.quantity or quantity_of_name(name)
        on, off = (column.on, column.off) if isinstance(column, SwitchMapping) else (None, None)
        yield Slot(
            f"{table}.{name}",
            column,
            si,
            quantity,
            plausible,
            None if on is None else frozenset(on),
            None if off is None else frozenset(off),
        )


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
        column: mapping of the signal `name`.
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
            f"{name}; {near_units(own or '', si)}."
        )
    if si and unit.si != si:
        raise DatasetError(
            f"{where}: expected a unit that is converted to {si} as in the name {name}, found "
            f"{own or column.unit}, which is converted to {unit.si}. Name another column, "
            f"or write the unit in the mapping."
        )
    factor = column.sign * unit.factor
    offset = factor * column.offset + column.sign * unit.offset
    return Scaling(unit.si, factor * column.factor, offset)
