"""The 25 ms loop: join the bus, tick, account; one exit for everything that can happen."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import can

from rt_controller.bus.identity import require_same_catalogue
from rt_controller.bus.inbox import Inbox
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.realtime.accounting import DeadlineAccount, TickTimes
from rt_controller.realtime.clock import Clock
from rt_controller.step import STANDING_MPS, ControlStep, StepOutcome
from rt_controller.tracking import TrackingAccount

SILENCE_TICKS = round(3.0 / PERIOD_S)
"""a safe stop without any sign of the car ends after this"""


class Ending(Enum):
    """Why a run ended."""

    MISSION_OVER = "the mission is over"
    STOPPED = "stopped on request"
    SAFE_STOPPED = "ended in a safe stop"


@dataclass(slots=True)
class RunRecord:
    """What is known of a run, while it goes on and afterwards; preallocated."""

    deadlines: DeadlineAccount
    tracking: TrackingAccount
    outcome: StepOutcome
    ending: Ending = Ending.STOPPED


def join(
    bus: can.BusABC,
    inbox: Inbox,
    clock: Clock,
    phase_ns: int,
    wait_ns: int,
    should_stop: Callable[[], bool],
) -> None:
    """Wait until the vehicle is heard, then set the clock's phase by it.

    Raises:
        BusError: nothing valid within `wait_ns`, the bus cannot be read, or the vehicle speaks
            another message catalogue.
    """
    begun_ns = clock.now_ns()
    while not should_stop():
        inbox.drain(bus, clock.now_ns())
        if inbox.last_failure:
            raise BusError(f"The bus cannot be read: {inbox.last_failure}")
        if inbox.peer is not None:
            require_same_catalogue(inbox.peer)
            if inbox.state is not None and inbox.reference is not None:
                clock.align(inbox.state.arrival_ns + phase_ns)
                return
        if clock.now_ns() - begun_ns > wait_ns:
            raise BusError(_unheard(inbox, wait_ns))
        clock.linger()


def drive(
    step: ControlStep,
    clock: Clock,
    record: RunRecord,
    should_stop: Callable[[], bool],
    stays: bool,
) -> None:
    """Tick until stopped, the mission is over, or a safe stop has come to rest.

    With `stays` only `should_stop` ends the loop. Whatever happens, the last frame is a safe
    command.
    """
    has_driven = False
    silent_ticks = 0
    try:
        while not should_stop():
            tick = clock.wait()
            begun_ns = time.perf_counter_ns()
            outcome = step.run(record.deadlines.missed_last)
            done_ns = time.perf_counter_ns()

            record.deadlines.record(
                TickTimes(
                    wake_us=tick.lateness_ns / 1e3,
                    step_us=(done_ns - begun_ns) / 1e3,
                    qp_us=outcome.qp_ns / 1e3,
                    qp_iterations=outcome.qp_iterations,
                ),
                tick.skipped,
                clock.now_ns() - tick.scheduled_ns,
            )
            has_driven = has_driven or outcome.mode is Mode.NOMINAL
            silent_ticks = 0 if outcome.state is not None else silent_ticks + 1
            if outcome.mode is not Mode.STANDBY and outcome.state and outcome.path:
                record.tracking.record(outcome.state.state, outcome.path)

            if not stays and has_driven and outcome.mode is Mode.STANDBY:
                record.ending = Ending.MISSION_OVER
                return
            if not stays and outcome.mode is Mode.SAFE_STOP and _is_at_rest(outcome, silent_ticks):
                record.ending = Ending.SAFE_STOPPED
                return
    finally:
        step.stop()


def _is_at_rest(outcome: StepOutcome, silent_ticks: int) -> bool:
    if outcome.state is None:
        return silent_ticks > SILENCE_TICKS
    return abs(outcome.state.state.vx_mps) < STANDING_MPS


def _unheard(inbox: Inbox, wait_ns: int) -> str:
    missing = [
        what
        for what, heard in (
            ("IDENT_VEHICLE", inbox.peer),
            ("a complete STATE_A/B/C", inbox.state),
            ("a complete REF_PATH/REF_SPEED", inbox.reference),
        )
        if heard is None
    ]
    return (
        f"Expected the vehicle on the bus within {wait_ns / 1e9:g} s, found no valid "
        f"{', no '.join(missing)} (so far: {inbox.counts}). Start sim-bridge on the same bus and "
        f"channel, or check the wiring."
    )
