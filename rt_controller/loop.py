"""The loop: one control step every period, until the run is over."""

from dataclasses import dataclass, field
from enum import Enum

from rt_controller.bus.catalogue import Fault
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive_trace import DriveTrace
from rt_controller.preparation import Schedule, prepare_tick
from rt_controller.realtime.accounting import DeadlineAccount
from rt_controller.realtime.clock import Clock
from rt_controller.realtime.kernel_counters import KernelCounters
from rt_controller.realtime.tick_timer import TickTimer
from rt_controller.safety.modes import BUS_CAUSES, STANDING_MPS, StopCause
from rt_controller.step import ControlStep, StepResult

MAX_TICKS_WITHOUT_STATE = round(10.0 / PERIOD_S)
"""after so long a safe stop without any state the car is taken to be at rest"""


class Ending(Enum):
    """Why a run ended."""

    MISSION_OVER = "the mission is over"
    STOPPED = "stopped on request"
    ENDED_AT_ONCE = "ended at once by a second request; the last frame was a safe command"
    SAFE_STOPPED = "ended in a safe stop"


class StopRequest:
    """Requests to end the run: the first stops the car, the second ends the loop at once."""

    def __init__(self) -> None:
        self._times = 0

    def request(self) -> None:
        """Request once more; safe from a signal handler."""
        self._times += 1

    @property
    def is_requested(self) -> bool:
        return self._times > 0

    @property
    def is_urgent(self) -> bool:
        return self._times > 1


@dataclass(slots=True)
class RunRecord:
    """The figures of a run, during the run and after it; preallocated."""

    deadlines: DeadlineAccount
    trace: DriveTrace
    result: StepResult = field(default_factory=StepResult)
    """of the last step"""
    ending: Ending = Ending.STOPPED
    ticks_by_fault: dict[Fault, int] = field(default_factory=lambda: dict.fromkeys(Fault, 0))
    """ticks whose heartbeat had the fault"""

    def add(self, result: StepResult, scheduled_ns: int) -> None:
        """Add the result of one tick."""
        self.result = result
        self.trace.record(result, scheduled_ns)
        for fault in result.faults:
            self.ticks_by_fault[fault] += 1


def run_loop(
    step: ControlStep,
    clock: Clock,
    record: RunRecord,
    request: StopRequest,
    waits_for_missions: bool = False,
    end_ns: int | None = None,
    schedule: Schedule | None = None,
    kernel_counters: KernelCounters | None = None,
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

    Whatever happens, the last frame that is sent is a safe command, or has released the car.
    """
    timer = TickTimer(clock, record.deadlines, kernel_counters)
    end = _EndConditions(record, waits_for_missions)
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
            result = step.run(tick.skipped, record.deadlines.missed_last, timer.end_stage)
            timer.record(result.qp_ns, result.qp_iterations)

            record.add(result, tick.scheduled_ns)
            if end.are_met(result, is_stopping):
                is_released = result.mode is Mode.STANDBY
                return
        record.ending = Ending.ENDED_AT_ONCE
    finally:
        if not is_released:
            step.send_safe_command()


class _EndConditions:
    """Decides after each step whether the run is over, and writes into the record how it ended."""

    def __init__(self, record: RunRecord, waits_for_missions: bool) -> None:
        self._record = record
        self._waits_for_missions = waits_for_missions
        self._has_driven = False
        self._ticks_without_state = 0

    def are_met(self, result: StepResult, is_stopping: bool) -> bool:
        """True if the mission is over, or the car is at rest in a safe stop that ends the run."""
        self._has_driven = self._has_driven or result.mode.drives
        self._ticks_without_state = 0 if result.state else self._ticks_without_state + 1
        if result.mode is Mode.STANDBY and self._has_driven and not self._waits_for_missions:
            self._record.ending = Ending.MISSION_OVER
            return True
        if result.mode is not Mode.SAFE_STOP or not self._is_at_rest(result):
            return False
        is_over = is_stopping or not self._waits_for_missions or result.cause in BUS_CAUSES
        if is_over and result.cause is not StopCause.STOP_REQUESTED:
            self._record.ending = Ending.SAFE_STOPPED
        return is_over

    def _is_at_rest(self, result: StepResult) -> bool:
        if result.state is None:
            return self._ticks_without_state > MAX_TICKS_WITHOUT_STATE
        return abs(result.state.state.vx_mps) < STANDING_MPS
