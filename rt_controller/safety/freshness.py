"""Is what we were told still true? Judged by arrival on the monotonic clock.

A state counts for the tick that first sees it and for no other; paths and missions live longer.
"""

from rt_controller.contract.timing import PERIOD_NS

REFERENCE_MAX_AGE_NS = 3 * PERIOD_NS
"""a path stays true for longer than a state: it lies still while the car moves along it"""


def is_fresh(arrival_ns: int, now_ns: int, max_age_ns: int) -> bool:
    """Whether something that arrived at `arrival_ns` is young enough at `now_ns`."""
    return 0 <= now_ns - arrival_ns <= max_age_ns
