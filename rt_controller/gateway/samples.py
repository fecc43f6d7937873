"""The newest value of each signal of the car, with the time of its measurement."""

from collections.abc import Mapping, Sequence
from math import isnan
from typing import NamedTuple

from rt_controller.contract.timing import PERIOD_S
from rt_controller.mapping.dbc_signals import Source
from rt_controller.mapping.slots import Slot

LONGEST_GAP_PERIODS = 3.5
"""longest gap in cycle times of the DBC: two lost samples are bridged, as in offline-import"""
LONGEST_GAP_S = 0.1
"""of a message without a cycle time"""


class Sample(NamedTuple):
    """One value in SI, and when it was measured; NaN: the car sent none that may be used."""

    value: float
    measured_ns: int


class Samples:
    """The newest samples; one that is older than its longest gap is missing."""

    def __init__(self, slots: Sequence[Slot], sources: Mapping[str, Source]) -> None:
        self._newest: dict[str, tuple[Sample, int]] = {}
        self._delay_ns = {slot.name: round(1e9 * slot.column.delay_s) for slot in slots}
        self._gap_ns = {
            slot.name: round(1e9 * longest_gap_s(slot, sources[slot.name])) for slot in slots
        }

    def add(self, values: Mapping[str, float], arrival_ns: int) -> None:
        """Add the values of one frame, by slot."""
        for name, value in values.items():
            sample = Sample(value, arrival_ns - self._delay_ns[name])
            self._newest[name] = sample, arrival_ns

    def newest(self, name: str, now_ns: int) -> Sample | None:
        """The newest sample of a slot; None: not mapped, none yet, or too old."""
        found = self._newest.get(name)
        if found is None or now_ns - found[1] > self._gap_ns[name]:
            return None
        return found[0]

    def has(self, name: str) -> bool:
        """True if the slot is mapped."""
        return name in self._gap_ns

    def is_on(self, name: str, now_ns: int) -> bool | None:
        """Whether a slot of 0 or 1 is on; None: missing."""
        found = self.newest(name, now_ns)
        return None if found is None or isnan(found.value) else found.value > 0.5


def longest_gap_s(slot: Slot, source: Source) -> float:
    """Time without a new sample after which a slot is missing."""
    if slot.column.longest_gap_s is not None:
        return slot.column.longest_gap_s
    cycle_ms = source.message.cycle_time
    if not cycle_ms:
        return LONGEST_GAP_S
    return max(LONGEST_GAP_PERIODS * 1e-3 * cycle_ms, 2.0 * PERIOD_S)
