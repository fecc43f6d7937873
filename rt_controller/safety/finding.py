"""The failing checks of a tick, combined to one finding: faulty signals, cause, reaction."""

from collections.abc import Sequence
from functools import reduce
from operator import or_
from typing import NamedTuple

from rt_controller.safety.checks import Check, Quantity, Reaction
from rt_controller.safety.isolation import Evidence, Faulty, SignalMask, cause_of, is_jump, isolate
from rt_controller.safety.modes import StopCause

INTEGRATED = (Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M)
"""quantities whose residual may grow over several ticks"""


class Finding(NamedTuple):
    """Result of the failing checks of a tick."""

    faulty: SignalMask
    cause: StopCause
    is_stop: bool


class Windows:
    """Counts for how many ticks in a row each check has been above its threshold."""

    def __init__(
        self, values: list[float], checks: Sequence[Check], groups: Sequence[range]
    ) -> None:
        """`values` are compared, by `Quantity`; each group of quantities is compared at once."""
        self._values = values
        self._groups = {
            group: [(i, *check[1:4], check) for i, check in enumerate(checks) if check[1] in group]
            for group in groups
        }
        self._over = [0] * len(checks)

    def begin(self) -> None:
        """Set all counts to zero."""
        self._over = [0] * len(self._over)

    def failing(self, group: range) -> list[Check]:
        """The checks of a group that have been above their threshold for their window."""
        values, over = self._values, self._over
        found = []
        for i, quantity, threshold, window_ticks, check in self._groups[group]:
            if values[quantity] <= threshold:
                over[i] = 0
                continue
            over[i] += 1
            if over[i] >= window_ticks:
                found.append(check)
        return found


def finding_of(failing: Sequence[Check], signals: Sequence[SignalMask]) -> Finding:
    """One finding for several checks: all their signals, the cause of the first that names one."""
    both = list(zip(failing, signals, strict=True))
    check, faulty = next((pair for pair in both if pair[1]), both[0])
    return Finding(
        reduce(or_, signals),
        cause_of(check, faulty),
        any(each.reaction is Reaction.STOP for each in failing),
    )


def finding_of_state(failing: Sequence[Check], evidence: Evidence, is_repeated: bool) -> Finding:
    """The same for checks of the state, with the signals that are isolated by the evidence.

    Args:
        failing: at least one.
        evidence: of this tick.
        is_repeated: the last states are older ones that arrived again.
    """
    if is_repeated:
        return Finding(Faulty.STATE, StopCause.STATE_OLD, is_stop=True)
    found = finding_of(failing, [isolate(each, evidence) for each in failing])
    if any(each.quantity in INTEGRATED and not is_jump(each, evidence) for each in failing):
        found = found._replace(is_stop=True)  # it grew over several ticks: no outlier
    if found.faulty & Faulty.PLACE == Faulty.PLACE:
        found = found._replace(faulty=found.faulty | Faulty.STATE)  # no single signal
    return found
