"""Slots: each signal that a car sends or receives, by the name of its place in the mapping file."""

from collections.abc import Iterator
from typing import NamedTuple

from rt_controller.contract.signals import VEHICLE
from rt_controller.mapping.car_signals import DrivingMapping, SwitchMapping
from rt_controller.mapping.quantity import limits_of, quantity_of_name, si_unit_of_name
from rt_controller.mapping.tables import ColumnMapping, SignalMapping
from rt_controller.mapping.units import find_unit

_INFINITE = (float("-inf"), float("inf"))
_SLOPE = "c1"
"""of the path: a ratio, or for small angles the angle"""
_UNITS = {
    **{signal.name: signal.unit for signal in (*VEHICLE.states, *VEHICLE.inputs)},
    **{signal.name: signal.unit for signal in VEHICLE.exogenous},
    "x": "m",
    "y": "m",
    "yaw": "rad",
}


class Slot(NamedTuple):
    """One signal of the car."""

    name: str
    """table and field: "states.vx_mps", "pose.yaw", "commands.throttle" """
    column: ColumnMapping
    si: str
    """SI unit"""
    plausible: tuple[float, float]
    """in SI"""
    on: frozenset[int] | None = None
    """raw values of a switch that mean 1, all others 0; None: its value is in SI"""


def measured_slots(mapping: DrivingMapping) -> tuple[Slot, ...]:
    """What the car sends: states, inputs, curvature, pose, reference, mission."""
    return tuple(_measured(mapping))


def command_slots(mapping: DrivingMapping) -> tuple[Slot, ...]:
    """What the car receives."""
    return tuple(
        _slot("commands", name, column)
        for name, column in mapping.commands
        if isinstance(column, ColumnMapping)
    )


def driving_slot(mapping: DrivingMapping) -> tuple[Slot, ...]:
    """The first constant of [messages] by which driving and standby differ, as "driving"; or none.

    Its value is 1 while the controller drives and 0 in standby.
    """
    for name, message in mapping.messages.items():
        for signal, driving in message.driving.items():
            standby = message.standby.get(signal, driving)
            if driving != standby:
                factor = 1.0 / (driving - standby)
                column = ColumnMapping(
                    column=f"{name}.{signal}", unit="1", factor=factor, offset=-standby * factor
                )
                return (Slot("driving", column, "1", _INFINITE),)
    return ()


def _measured(mapping: DrivingMapping) -> Iterator[Slot]:
    for table in ("states", "inputs", "exogenous"):
        for name, signal in getattr(mapping, table).items():
            yield _slot(table, name, signal)
    if mapping.pose is not None:
        for name, column in zip(("x", "y", "yaw"), mapping.pose_columns, strict=True):
            yield _slot("pose", name, column)
    for table in ("reference", "mission"):
        for name, value in getattr(mapping, table):
            if isinstance(value, ColumnMapping):
                yield _slot(table, name, value)


def _slot(table: str, name: str, column: ColumnMapping) -> Slot:
    si = _UNITS.get(name) or si_unit_of_name(name) or "1"
    unit = find_unit(column.unit) if name == _SLOPE and column.unit else None
    if unit is not None and unit.si == "rad":
        si = "rad"
    limits = limits_of(quantity_of_name(name), si)
    plausible = (limits.low, limits.high) if table in ("states", "inputs") else _INFINITE
    if isinstance(column, SignalMapping) and column.plausible is not None:
        plausible = column.plausible
    on = column.on if isinstance(column, SwitchMapping) else None
    return Slot(f"{table}.{name}", column, si, plausible, frozenset(on) if on else None)
