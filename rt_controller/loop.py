"""The 25 ms loop: join the bus, tick, account; one exit for everything that can happen."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import can

from rt_controller.bus.identity import require_same_catalogue
from rt_controller.bus.inbox import Inbox
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.outcome import StepOutcome, StopCause
from rt_controller.realtime.accounting import DeadlineAccount, TickTimes
from rt_controller.realtime.clock import Clock, Tick
from rt_controller.realtime.lateness import TickParts, Witness, explain
from rt_controller.step import STANDING_MPS, ControlStep
from rt_controller.tracking import TrackingAccount

SILENCE_TICKS = round(10.0 / PERIOD_S)
"""a safe stop without any sign of the car ends after this: long enough to stop unseen"""
BEYOND_REPAIR = (
    StopCause.BUS_FAILED,
    StopCause.PEER_MISMATCH,
    StopCause.SECOND_CONTROLLER,
)
"""no waiting on the bus will mend these: the loop ends even where it stays for further missions"""


class Leads(NamedTuple):
    """How long before a tick to do what it need not wait for."""

    prepare_ns: int
    rehearsals_ns: tuple[int, ...]
    """each finds more in the caches than the one before"""


class Spent(NamedTuple):
    """Time that something took."""

    wall_ns: int
    cpu_ns: int
    """of this thread; the rest went to others"""


NOTHING_DONE = Spent(0, 0)


class Ending(Enum):
    """Why a run ended."""

    MISSION_OVER = "the mission is over"
    STOPPED = "stopped on request"
    SAFE_STOPPED = "ended in a safe stop"


class StopRequest:
    """How urgently the loop is asked to end: once, and it stops the car first; twice, at once."""

    def __init__(self) -> None:
        self._times = 0

    def ask(self) -> None:
        """Ask once more; safe from a signal handler."""
        self._times += 1

    @property
    def is_asked(self) -> bool:
        return self._times > 0

    @property
    def is_urgent(self) -> bool:
        return self._times > 1


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
    request: StopRequest,
) -> None:
    """Wait until the vehicle is heard, then set the clock's phase by it.

    Raises:
        BusError: nothing valid within `wait_ns`, the bus cannot be read, or the vehicle speaks
            another message catalogue.
    """
    begun_ns = clock.now_ns()
    while not request.is_asked:
        inbox.drain(bus, clock.now_ns())
        if inbox.last_failure:
            raise BusError(f"The bus cannot be read: {inbox.last_failure}")
        if inbox.foreign_commands > 0:
            raise BusError(
                "Expected to be the only controller on this bus, found commands (ACT_CMD) of "
                "another one. Stop it first, or choose another channel."
            )
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
    request: StopRequest,
    stays: bool = False,
    end_ns: int | None = None,
    leads: Leads | None = None,
    witness: Witness | None = None,
) -> None:
    """Tick until the mission is over, or a safe stop has come to rest.

    A request to stop, or the clock reaching `end_ns`, brings a driving car to rest first. With
    `stays` missions may follow each other. A tick is prepared by its `leads`, as far as they are
    still to come. What a `witness` saw explains late ticks. Whatever happens, the last frame is a
    safe command.
    """
    journal = _Journal(record.deadlines, witness)
    has_driven = False
    silent_ticks = 0
    try:
        while not request.is_urgent:
            is_asked = request.is_asked or (end_ns is not None and clock.now_ns() >= end_ns)
            if is_asked:
                if record.outcome.mode is Mode.STANDBY:
                    return
                step.request_stop()
            prepared = NOTHING_DONE if leads is None else _prepare(step, clock, leads)
            prepared_ns = clock.now_ns()
            tick = clock.wait()
            outcome = step.run(tick.skipped, record.deadlines.missed_last)
            journal.enter(tick, outcome, prepared, prepared_ns, clock.now_ns())

            has_driven = has_driven or outcome.mode is Mode.NOMINAL
            silent_ticks = 0 if outcome.state is not None else silent_ticks + 1
            if outcome.mode is not Mode.STANDBY and outcome.state and outcome.path:
                record.tracking.record(outcome.state.state, outcome.path)

            if outcome.mode is Mode.STANDBY and has_driven and not stays:
                record.ending = Ending.MISSION_OVER
                return
            if outcome.mode is Mode.SAFE_STOP and _is_at_rest(outcome, silent_ticks):
                if outcome.cause is not StopCause.STOP_REQUESTED:
                    record.ending = Ending.SAFE_STOPPED
                if is_asked or not stays or outcome.cause in BEYOND_REPAIR:
                    return
    finally:
        step.leave()


def _prepare(step: ControlStep, clock: Clock, leads: Leads) -> Spent:
    """What it took, without the pauses."""
    spent = _spend(step.prepare, clock, leads.prepare_ns)
    last = NOTHING_DONE
    for lead_ns in leads.rehearsals_ns:
        if last.wall_ns > lead_ns:
            break  # the next one would be too long as well
        last = _spend(step.rehearse, clock, lead_ns)
        spent = Spent(spent.wall_ns + last.wall_ns, spent.cpu_ns + last.cpu_ns)
    return spent


def _spend(action: Callable[[], None], clock: Clock, lead_ns: int) -> Spent:
    """What an action took, so long before the next tick; nothing if that is nearer already."""
    if not clock.approach(lead_ns):
        return NOTHING_DONE
    begun_ns, begun_cpu_ns = time.perf_counter_ns(), time.thread_time_ns()
    action()
    return Spent(time.perf_counter_ns() - begun_ns, time.thread_time_ns() - begun_cpu_ns)


class _Journal:
    """Enters every tick into the account, with what was seen of it."""

    def __init__(self, account: DeadlineAccount, witness: Witness | None) -> None:
        self._account = account
        self._witness = witness
        self._last_done_ns: int | None = None
        self._before = None if witness is None else witness.look()

    def enter(
        self, tick: Tick, outcome: StepOutcome, prepared: Spent, prepared_ns: int, done_ns: int
    ) -> None:
        """One tick, prepared at `prepared_ns` of the loop's clock, its frames gone at `done_ns`."""
        # What was skipped is lateness too: its frames never left.
        late_ns = tick.skipped * PERIOD_NS
        step_ns = outcome.hear_ns + outcome.plan_ns + outcome.answer_ns
        times = TickTimes(
            wake_us=(tick.lateness_ns + late_ns) / 1e3,
            listen_us=outcome.listen_ns / 1e3,
            hear_us=outcome.hear_ns / 1e3,
            plan_us=outcome.plan_ns / 1e3,
            qp_us=outcome.qp_ns / 1e3,
            answer_us=outcome.answer_ns / 1e3,
            step_us=step_ns / 1e3,
            cpu_us=outcome.cpu_ns / 1e3,
            whole_us=(outcome.listen_ns + step_ns) / 1e3,
            prepare_us=(prepared.wall_ns - outcome.listen_ns) / 1e3,
            qp_iterations=outcome.qp_iterations,
        )
        first_ns = tick.scheduled_ns - late_ns
        overrun_ns = 0 if self._last_done_ns is None else max(0, self._last_done_ns - first_ns)
        self._last_done_ns = done_ns
        is_notable = self._account.record(
            times, tick.skipped, done_ns - tick.scheduled_ns + late_ns
        )
        if self._witness is None or self._before is None:
            return
        now = self._witness.look()
        if is_notable:
            bus_us = times.hear_us + times.answer_us
            # What it computed can have made the tick late; what it waited for has other causes.
            prepared_late_ns = min(max(0, prepared_ns - first_ns - overrun_ns), prepared.cpu_ns)
            parts = TickParts(
                times.wake_us,
                times.step_us,
                times.cpu_us,
                times.qp_us,
                bus_us,
                prepared_late_ns / 1e3,
                overrun_ns / 1e3,
            )
            self._account.explain(explain(self._before, now, parts))
        self._before = now


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
    dropped = inbox.counts.crc_errors + inbox.counts.out_of_range
    return (
        f"Expected the vehicle on the bus within {wait_ns / 1e9:g} s, still missing: "
        f"{', '.join(missing)} ({dropped} frames were dropped as damaged or out of range). Start "
        f"sim-bridge on the same bus and channel, or check the wiring."
    )
