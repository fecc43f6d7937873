"""One run of the controller: everything opened and checked first, then the loop in its thread."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from threading import Thread

import can

from rt_controller.bus.identity import require_same_catalogue
from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.messages import REFERENCE, STATE, VEHICLE_IDENTITY
from rt_controller.bus.receive import Inbox
from rt_controller.bus.transport import close_bus
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import BusError
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.planner import Planner
from rt_controller.drive.table import Drive
from rt_controller.drive.trace import DriveTrace
from rt_controller.loop import FinishedTick, RunRecord, StopRequest, run_loop, schedule_preparation
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_node
from rt_controller.realtime.clock import Clock, LockstepClock
from rt_controller.realtime.scheduling import NO_GUARANTEES, real_time_process, set_thread_priority
from rt_controller.realtime.timing import DeadlineAccount, KernelCounters
from rt_controller.recording.journal import BUS_FAILURE, TickRecord, describe_run
from rt_controller.safety.checks import Check
from rt_controller.settings import BusSettings

LONGEST_LOCKSTEP_WAIT_NS = 5_000_000_000
"""in simulated time the vehicle sends from the first period on, if it ever does"""


def wait_for_vehicle(
    bus: can.BusABC, inbox: Inbox, clock: Clock, phase_ns: int, wait_ns: int, request: StopRequest
) -> None:
    """Return when state, path and identity were received, or a stop is requested.

    The clock's ticks are then `phase_ns` after the vehicle's frames.

    Raises:
        BusError: nothing valid within `wait_ns`, the bus cannot be read, another controller is
            on it, or the vehicle uses another message catalogue.
    """
    began_ns = clock.now_ns()
    if isinstance(clock, LockstepClock):
        wait_ns = min(wait_ns, LONGEST_LOCKSTEP_WAIT_NS)
    while not request.is_requested:
        inbox.drain(bus, clock.now_ns())
        inbox.require_readable()
        if inbox.foreign_frames > 0:
            raise BusError(
                "Expected to be the only controller on this bus, found frames of "
                "another one. Stop it first, or choose another channel."
            )
        now_ns = clock.now_ns()
        peer, state = inbox.newest(VEHICLE_IDENTITY), inbox.newest_valid(STATE, now_ns)
        if peer is not None:
            require_same_catalogue(peer.content)
            if state is not None and inbox.newest_valid(REFERENCE, now_ns) is not None:
                clock.align(state.arrival_ns + phase_ns)
                return
        if clock.now_ns() - began_ns > wait_ns:
            raise BusError(_missing_frames(inbox, wait_ns))
        clock.poll()


def _missing_frames(inbox: Inbox, wait_ns: int) -> str:
    received = {
        "IDENT_VEHICLE": inbox.newest(VEHICLE_IDENTITY),
        "a complete STATE_A/B/C": inbox.newest(STATE),
        "a complete REF_PATH/REF_SPEED": inbox.newest(REFERENCE),
    }
    missing = ", ".join(name for name, newest in received.items() if newest is None)
    dropped = inbox.counts.crc_errors + inbox.counts.out_of_range
    return (
        f"Expected the vehicle on the bus within {wait_ns / 1e9:g} s, still missing: {missing} "
        f"({dropped} frames were dropped as damaged or out of range). Start sim-bridge on the same "
        f"bus and channel, or check the wiring."
    )


RECORDED_TICKS = round(3600.0 / PERIOD_S)
"""times and states of the last hour are kept"""


class ControllerSession:
    """An open bus, a controller on it, and the record of the run."""

    def __init__(
        self,
        bus_settings: BusSettings,
        config: ControllerConfig,
        bundle: Bundle,
        planner: Planner,
        clock: Clock,
        log: Path | None = None,
        replaces: bool = False,
        checks: Sequence[Check] | None = None,
    ) -> None:
        """Open bus and log, and check that the solver is fast enough; nothing is sent yet.

        Args:
            bus_settings: the bus to join.
            config: settings of the loop.
            bundle: the model that the checks predict with.
            planner: used by this session only.
            clock: of the loop; a `LockstepClock` makes the run independent of the machine.
            log: what the drive is recorded to, with a journal beside it; None: it is not.
            replaces: replace an existing log.
            checks: of plausibility.

        Raises:
            ConfigError: the log file cannot be written or exists already, or this machine is too
                slow.
            BusError: the bus cannot be opened.
        """
        self._settings, self._clock = config.realtime, clock
        self.is_lockstep = isinstance(clock, LockstepClock)
        """in simulated time: the system grants nothing and need not"""
        # Simulated time needs no rank among the threads of this machine, no locked memory, and no
        # interpreter without a garbage collector: to prepare that takes longer than a short drive.
        self._priority = 0 if self.is_lockstep else config.realtime.priority
        if not self.is_lockstep:  # a time limit would make the result depend on the machine
            planner.limit_solve_time(round(config.realtime.solve_budget_ms * 1e6))
        self.planner = planner
        self.model = f"{bundle.name} {bundle.sha256[:8]}"
        """that the checks predict with: its name, and the first digits of its hash"""
        self.record = RunRecord(
            DeadlineAccount(RECORDED_TICKS, round(config.realtime.deadline_ms * 1e6)),
            DriveTrace(RECORDED_TICKS),
        )
        self.failure: BaseException | None = None
        """the exception that ended the loop, for the main thread to raise"""
        self.is_joined = False
        """True after the vehicle was found"""
        self.stop_values: tuple[float, ...] = ()
        """of the checks, by `Quantity`, in the tick in which the last safe stop began"""
        self.observe: Callable[[ControllerSession], None] = lambda session: None
        """called after each tick; `record` has its result, `supervisor` the values of its checks"""
        self._request = StopRequest()
        self._thread: Thread | None = None
        self._receive_failures = 0
        with ExitStack() as opened:
            self.guarantees = NO_GUARANTEES
            if not self.is_lockstep:
                # First: the threads that a bus or a log starts inherit the settings of the process.
                self.guarantees = opened.enter_context(real_time_process(self._priority))
            bus = bus_settings.open_bus()
            opened.callback(close_bus, bus)
            self._bus = bus
            header = describe_run(config, bundle, planner.max_iterations)
            self.recorder: Recorder | None = None
            if log is not None:
                self.recorder = opened.enter_context(
                    Recorder(
                        log,
                        bus_settings.channel,
                        is_lockstep=self.is_lockstep,
                        replaces=replaces,
                        journal=header.model_dump(),
                    )
                )
            self.inbox, self.outbox, self._step, self.supervisor = build_node(
                self._bus, config, bundle, planner, clock, self.recorder, self._record_call, checks
            )
            self._opened = opened.pop_all()

    def start(self, duration_s: float | None, waits_for_missions: bool, wait_s: float) -> Thread:
        """Run the loop in a thread of its own, with its real-time priority.

        Args:
            duration_s: bring the car to rest after this time; None: at the end of the mission.
            waits_for_missions: at the end of a mission, wait for the next one.
            wait_s: longest wait for the vehicle.
        """
        self._thread = Thread(
            target=self._run, args=(duration_s, waits_for_missions, wait_s), name="control"
        )
        self._thread.start()
        return self._thread

    @property
    def stop_requests(self) -> int:
        """Number of requests to end."""
        return self._request.times

    def request_stop(self) -> None:
        """Request the loop to end: the first request stops the car, the third ends at once."""
        self._request.request()

    def drive(self) -> Drive:
        """The drive so far as a table; at most the last hour of it."""
        record = self.record
        return replace(
            record.trace.drive(self.planner.name, record.ending.value),
            stop_cause=record.result.cause.name,
            stop_tick=record.stop_tick,
            stop_s=record.stop_s,
        )

    def close(self) -> None:
        """Close the log and the bus, and undo the settings of the process.

        A loop that still runs, after an exception in the main thread, brings the car to rest first.
        """
        if self._thread is not None and self._thread.is_alive():
            self.request_stop()
            self._thread.join()
        self._opened.close()

    def _record_call(self, name: str) -> None:
        if self.recorder is not None:
            self.recorder.record_event(name)

    def _after_tick(self, tick: FinishedTick) -> None:
        self.observe(self)
        if tick.number == self.record.stop_tick:
            self.stop_values = tuple(self.supervisor.values)
        recorder, failures = self.recorder, self.inbox.counts.receive_failures
        if recorder is None:
            return
        if failures > self._receive_failures:
            recorder.record_event(BUS_FAILURE)
        self._receive_failures = failures
        result, measured = tick.result, tick.measured
        record = TickRecord(
            tick.number,
            tick.began_ns,
            measured.scheduled_ns,
            measured.skipped,
            tick.missed_last,
            result.mode,
            result.cause,
            result.control,
            int(result.faults),
            recorder.dropped,
            measured.sent_after_ns / 1e3,
            None if measured.cause is None else measured.cause.value,
            {name: round(value, 1) for name, value in measured.times._asdict().items()},
        )
        recorder.record_event(record.to_json())

    def _run(self, duration_s: float | None, waits_for_missions: bool, wait_s: float) -> None:
        settings, clock = self._settings, self._clock
        try:
            self.guarantees = set_thread_priority(self._priority, settings.cpu, self.guarantees)
            phase_ns, wait_ns = round(settings.phase_ms * 1e6), round(wait_s * 1e9)
            wait_for_vehicle(self._bus, self.inbox, clock, phase_ns, wait_ns, self._request)
            self.is_joined = True
            end_ns = None if duration_s is None else clock.now_ns() + round(duration_s * 1e9)
            schedule = schedule_preparation(settings.prepare_ms, self.is_lockstep)
            with ExitStack() as opened:
                counters = None
                if not self.is_lockstep:
                    counters = opened.enter_context(closing(KernelCounters()))
                run_loop(
                    self._step,
                    clock,
                    self.record,
                    self._request,
                    waits_for_missions=waits_for_missions,
                    end_ns=end_ns,
                    schedule=schedule,
                    kernel_counters=counters,
                    after_tick=self._after_tick,
                )
        except BaseException as error:
            self.failure = error
