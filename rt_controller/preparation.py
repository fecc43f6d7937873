"""What is done before a tick: update the QP's matrices, read ahead, and warm the caches."""

from typing import NamedTuple

from rt_controller.realtime.clock import Clock
from rt_controller.realtime.tick_timer import TickTimer
from rt_controller.step import ControlStep

WARM_UP_LEADS_NS = (2_400_000, 1_500_000, 800_000)
"""before a tick: the first dry run has cold caches, the last must end before the tick"""


class Schedule(NamedTuple):
    """How long before a tick each part of its preparation begins."""

    update_matrices_ns: int
    warm_ups_ns: tuple[int, ...]


def schedule_preparation(prepare_ms: float, is_lockstep: bool) -> Schedule | None:
    """The schedule of `--realtime.prepare-ms`; None for 0: nothing is prepared.

    In lockstep there is one warm-up: the solver starts from its solution. More of them would only
    make a step faster.
    """
    prepare_ns = round(prepare_ms * 1e6)
    if prepare_ns == 0:
        return None
    if is_lockstep:
        return Schedule(prepare_ns, WARM_UP_LEADS_NS[:1])
    return Schedule(prepare_ns, tuple(lead for lead in WARM_UP_LEADS_NS if lead < prepare_ns))


def prepare_tick(step: ControlStep, clock: Clock, schedule: Schedule, timer: TickTimer) -> None:
    """Do each part of the preparation for which there is time before the next tick."""
    if clock.sleep_until_before_tick(schedule.update_matrices_ns):
        timer.time_preparation(step.update_matrices)
    took_ns = 0
    for lead_ns in schedule.warm_ups_ns:
        if took_ns > lead_ns:
            return  # the next warm-up would end after the tick too
        if clock.sleep_until_before_tick(lead_ns):
            took_ns = timer.time_reading(step.read_ahead) + timer.time_preparation(step.warm_up)
        else:
            took_ns = 0
