"""What the units and the clock of the logs could be compared with, and what with nothing."""

from collections.abc import Sequence

from offline.logs.checks.motion import TIME_SCALE_NAME, TURNING_NAME, Measure, has_known_geometry
from offline.logs.checks.pairs import Relation
from offline.logs.checks.unit_check import Proportion
from offline.logs.mapping import LogMapping
from rt_controller.mapping.quantity import Quantity

_TURNING = (Quantity.SPEED, Quantity.YAW_RATE, Quantity.STEERING)
_SIDESLIP = (Quantity.SPEED, Quantity.LATERAL_SPEED, Quantity.YAW_RATE)


def find_unchecked(
    mapping: LogMapping, proportions: Sequence[Proportion], measures: Sequence[Measure]
) -> tuple[str, ...]:
    """What no other signal of the logs confirms: names of signals, and the period of the rows."""
    measured = {each.name for each in measures}
    same = [p for p in proportions if p.relation is Relation.SAME_MOTION and p.is_reliable]
    confirmed = {name for name in mapping.signals for each in same if name in each.response}
    if TURNING_NAME in measured and has_known_geometry(mapping):
        confirmed |= {mapping.name_of(quantity) or "" for quantity in _TURNING}
    if TIME_SCALE_NAME in measured:
        confirmed |= {mapping.name_of(quantity) or "" for quantity in _SIDESLIP}
    unchecked = [f"unit of {name}" for name in mapping.signals if name not in confirmed]
    clocks = [column.time or mapping.time for column in mapping.every_column]
    has_rows_only = mapping.can is None and any(not (c.column or c.file) for c in clocks)
    if has_rows_only and not same and TIME_SCALE_NAME not in measured:
        unchecked.insert(0, "period of the rows")
    return tuple(unchecked)
