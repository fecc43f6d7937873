"""Faults of a scenario: what is wrong on the bus, when, and for how long.

They are faults of the vehicle's end: frames that are missing, late or wrong. `docs/safety.md` lists
how the controller and the watchdog of the vehicle react.
"""

from enum import StrEnum
from math import ceil
from typing import NamedTuple

from rt_controller.contract.timing import MISSION_PERIOD_TICKS, PERIOD_S


class FaultKind(StrEnum):
    """What is wrong."""

    STATE_LOST = "state_lost"
    """the three frames of the state are not sent"""
    STATE_INVALID = "state_invalid"
    """the state is marked as invalid"""
    STATE_FROZEN = "state_frozen"
    """the state at the beginning of the fault is repeated with new stamps"""
    STATE_DELAYED = "state_delayed"
    """each state is sent `delay_s` late, with the stamp of its sample"""
    STATE_OFFSET = "state_offset"
    """`value` is added to the signal `signal` of the state"""
    STATE_NOISE = "state_noise"
    """normally distributed noise with the standard deviation `value` is added to `signal`"""
    REFERENCE_LOST = "reference_lost"
    """path and speed are not sent"""
    PREVIEW_LOST = "preview_lost"
    """the curvature of the road ahead is not sent"""
    MISSION_LOST = "mission_lost"
    """the mission is not sent"""
    COMMAND_LOST = "command_lost"
    """commands do not reach the vehicle: its watchdog brakes after 100 ms"""


DELAYS = frozenset({FaultKind.STATE_DELAYED})
"""kinds with a `delay_s`"""
DISTORTIONS = frozenset({FaultKind.STATE_OFFSET, FaultKind.STATE_NOISE})
"""kinds with a `signal` and a `value`"""


LEAST_TICKS = {FaultKind.STATE_FROZEN: 2, FaultKind.MISSION_LOST: MISSION_PERIOD_TICKS}
"""shortest faults that have an effect; of the other kinds: one tick"""


class Fault(NamedTuple):
    """One fault."""

    kind: FaultKind
    ticks: range
    """of the drive: 1 is the first one after the car was first driven"""
    signal: str = ""
    """field of `VehicleState`"""
    value: float = 0.0
    """in the unit of the signal"""
    delay_ticks: int = 0
    seed: int = 0
    """of the noise"""


def ticks_between(start_s: float, duration_s: float) -> range:
    """The ticks t with start_s <= t * PERIOD_S < start_s + duration_s.

    Those of a fault that starts at 0 are one later: in tick 0 no car is driven yet.
    """
    first, end = (ceil(round(s / PERIOD_S, 6)) for s in (start_s, start_s + duration_s))
    late = max(1 - first, 0)
    return range(first + late, end + late)
