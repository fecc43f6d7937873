"""The loop: one control step every period, until the run is over."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.trace import DriveTrace
from rt_controller.model.validity import Excess
from rt_controller.realtime.clock import Clock
from rt_controller.realtime.timing import DeadlineAccount, KernelCounters, MeasuredTick, TickTimer
from rt_controller.safety.modes import BUS_CAUSES, STANDING_MPS
from rt_controller.safety.tick import Tick
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


RELEASE_TICKS = 4
"""of STANDBY at the end of a mission: one frame may be lost, and a car with messages of its own may
send them less often"""
MAX_TICKS_WITHOUT_STATE = round(10.0 / PERIOD_S)
"""after so long in a safe stop without a known speed the car is assumed to be at rest"""
MAX_TICKS_REFUSED = round(5.0 / PERIOD_S)
"""after so long outside the engagement window the run ends"""
URGENT_REQUEST = 3
"""number of the request that ends a drive at once: a supervisor may send two for one stop"""


class Ending(Enum):
    """Why a run ended."""

    MISSION_OVER = "the mission is over"
    STOPPED = "stopped on request"
    ENDED_AT_ONCE = "ended at once by a third request"
    SAFE_STOPPED = "ended in a safe stop"
    REFUSED = "the car was not taken over"
    LOG_ENDED = "the log ends while the car was driven, cause unknown"
    """of a recorded drive only"""


class StopRequest:
    """Requests to end the run: the first stops the car, the third ends the loop at once."""

    def __init__(self) -> None:
        self.times = 0

    def request(self) -> None:
        """Request once more; safe from a signal handler."""
        self.times += 1

    @property
    def is_requested(self) -> bool:
        return self.times > 0

    @property
    def is_urgent(self) -> bool:
        return self.times >= URGENT_REQUEST


@dataclass(slots=True)
class RunRecord:
    """The figures of a run, during the run and after it; preallocated."""

    deadlines: DeadlineAccount
    trace: DriveTrace
    result: Tick = field(default_factory=Tick)
    """of the last step"""
    ending: Ending = Ending.STOPPED
    ticks_by_fault: dict[Fault, int] = field(default_factory=lambda: dict.fromkeys(Fault, 0))
    """ticks whose heartbeat had the fault"""
    first_s_by_fault: dict[Fault, float] = field(default_factory=dict)
    """time of the first of these ticks since that of the run; only of faults that occurred"""
    excess: Excess | None = None
    """what was furthest outside of the training of the model"""
    stop_tick: int | None = None
    """in which the last safe stop began, counted from zero; None: there was none"""
    stop_s: float | None = None
    """time of that tick since the first one"""

    def add(self, result: Tick, scheduled_ns: int) -> None:
        """Add the result of one tick."""
        is_new_stop = result.mode is Mode.SAFE_STOP and self.result.mode is not Mode.SAFE_STOP
        self.result = result
        self.trace.record(result, scheduled_ns)
        if is_new_stop:
            self.stop_tick, self.stop_s = self.trace.last_tick, self.trace.last_s
        excess = result.estimate.excess
        if excess is not None and (self.excess is None or excess.share > self.excess.share):
            self.excess = excess
        for fault in result.faults:
            self.ticks_by_fault[fault] += 1
            self.first_s_by_fault.setdefault(fault, self.trace.last_s)


class FinishedTick(NamedTuple):
    """One tick as the loop ran it: with the calls before it, all that its result depends on."""

    number: int
    """counted from zero"""
    began_ns: int
    """on the clock of the loop"""
    missed_last: bool
    """True if the tick before missed its deadline"""
    result: Tick
    measured: MeasuredTick


def run_loop(
    step: ControlStep,
    clock: Clock,
    record: RunRecord,
    request: StopRequest,
    waits_for_missions: bool = False,
    end_ns: int | None = None,
    schedule: Schedule | None = None,
    kernel_counters: KernelCounters | None = None,
    after_tick: Callable[[FinishedTick], None] = lambda tick: None,
) -> None:
    """Run a step every tick until the mission is over, or a safe stop has brought the car to rest.

    Args:
        step: the control step.
        clock: gives the ticks.
        record: is updated after each step.
        request: stops the car and then ends the loop; an urgent one ends it at once.
        waits_for_missions: at the end of a mission, wait for the next one.
        end_ns: time on `clock` at which the stop is requested; None: never.
        schedule: of the preparation before each tick; None: no preparation.
        kernel_counters: explain late ticks; None: no explanation.
        after_tick: is called after each tick, when its frames have been sent.

    Whatever happens, the last frame that is sent is a safe command, or has released the car.
    """
    timer = TickTimer(clock, record.deadlines, kernel_counters)
    end = EndConditions(record, waits_for_missions)
    is_released = False
    try:
        while not request.is_urgent:
            is_stopping = request.is_requested or (end_ns is not None and clock.now_ns() >= end_ns)
            if is_stopping:
                if record.result.mode is Mode.STANDBY:
                    return
                step.request_stop()
            if schedule is not None:
                prepare_tick(step, clock, schedule, timer)
            tick = timer.wait()
            missed_last = record.deadlines.missed_last
            result = step.run(tick.skipped, missed_last, timer.end_stage)
            measured = timer.record(result.qp_ns, result.qp_iterations)

            record.add(result, tick.scheduled_ns)
            number = record.deadlines.ticks - 1
            after_tick(FinishedTick(number, step.began_ns, missed_last, result, measured))
            if end.are_met(result, is_stopping):
                is_released = result.mode is Mode.STANDBY
                return
        record.ending = Ending.ENDED_AT_ONCE
    finally:
        if not is_released:
            step.send_safe_command()


class EndConditions:
    """Decides after each step whether the run is over, and writes into the record how it ended."""

    def __init__(self, record: RunRecord, waits_for_missions: bool) -> None:
        self._record = record
        self._waits_for_missions = waits_for_missions
        self._has_driven = False
        self._ticks_without_state = 0
        self._ticks_refused = 0
        self._ticks_released = 0

    def are_met(self, result: Tick, is_stopping: bool) -> bool:
        """True if the mission is over, or the car is at rest in a safe stop that ends the run."""
        self._has_driven = self._has_driven or result.mode.drives
        is_known = result.estimate.speed_mps is not None
        self._ticks_without_state = 0 if is_known else self._ticks_without_state + 1
        is_released = result.mode is Mode.STANDBY and self._has_driven
        self._ticks_released = self._ticks_released + 1 if is_released else 0
        if self._ticks_released >= RELEASE_TICKS and not self._waits_for_missions:
            self._record.ending = Ending.MISSION_OVER
            return True
        is_refused = result.cause is StopCause.NOT_ENGAGED
        self._ticks_refused = self._ticks_refused + 1 if is_refused else 0
        if self._ticks_refused > MAX_TICKS_REFUSED and not self._waits_for_missions:
            self._record.ending = Ending.REFUSED
            return True
        if result.mode is not Mode.SAFE_STOP or not self._is_at_rest(result):
            return False
        is_over = is_stopping or not self._waits_for_missions or result.bus_fault in BUS_CAUSES
        if is_over and result.cause is not StopCause.STOP_REQUESTED:
            self._record.ending = Ending.SAFE_STOPPED
        return is_over

    def _is_at_rest(self, result: Tick) -> bool:
        if result.estimate.speed_mps is None:
            return self._ticks_without_state > MAX_TICKS_WITHOUT_STATE
        return abs(result.estimate.speed_mps) < STANDING_MPS
