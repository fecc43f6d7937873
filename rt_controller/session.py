"""One run of the controller: everything opened and checked first, then the loop in its thread."""

import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread

import can

from rt_controller.bus.identity import model_hash
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.recorder import Recorder
from rt_controller.bus.transport import close_bus, open_bus, parse_options
from rt_controller.config import ControllerConfig, RealtimeSettings
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.plan_buffer import PlanBuffer
from rt_controller.drive import Drive
from rt_controller.drive_trace import DriveTrace
from rt_controller.handshake import wait_for_vehicle
from rt_controller.loop import RunRecord, StopRequest, run_loop
from rt_controller.planner import Planner
from rt_controller.preparation import schedule_preparation
from rt_controller.realtime.accounting import DeadlineAccount
from rt_controller.realtime.clock import Clock
from rt_controller.realtime.kernel_counters import KernelCounters
from rt_controller.realtime.scheduling import (
    NO_GUARANTEES,
    Guarantees,
    ProcessSettings,
    prepare_process,
    release_process,
    set_thread_priority,
)
from rt_controller.step import ControlStep
from rt_controller.tracking import TrackingAccount

RECORDED_TICKS = round(3600.0 / PERIOD_S)
"""times and states of the last hour are kept"""


@dataclass(slots=True)
class ControllerSession:
    """An open bus, a planner, and the record of the run."""

    model: str
    record: RunRecord
    inbox: Inbox
    outbox: Outbox
    recorder: Recorder | None
    guarantees: Guarantees = NO_GUARANTEES
    failure: BaseException | None = None
    """the exception that ended the loop, for the main thread to raise"""
    is_joined: bool = False
    """True after the vehicle was found"""
    _request: StopRequest = field(default_factory=StopRequest)
    _bus: can.BusABC = field(kw_only=True)
    _step: ControlStep = field(kw_only=True)
    _clock: Clock = field(kw_only=True)
    _settings: RealtimeSettings = field(kw_only=True)
    _process: ProcessSettings = field(kw_only=True)
    _is_lockstep: bool = field(kw_only=True)
    _opened: ExitStack = field(kw_only=True)

    def start(self, duration_s: float | None, stays: bool, wait_s: float) -> Thread:
        """Run the loop in a thread of its own, with its real-time priority."""
        thread = Thread(target=self._run, args=(duration_s, stays, wait_s), name="control")
        thread.start()
        return thread

    def request_stop(self) -> None:
        """Request the loop to end: the first request stops the car, the second ends at once."""
        self._request.request()

    def drive(self) -> Drive:
        """The drive so far as a table; at most the last hour of it."""
        record = self.record
        return Drive(record.trace.rows(), record.tracking.errors(), self.model, record.ending.value)

    def close(self) -> None:
        """Close the log and the bus, and undo the settings of the process."""
        self._opened.close()

    def _run(self, duration_s: float | None, stays: bool, wait_s: float) -> None:
        settings, clock = self._settings, self._clock
        try:
            priority = set_thread_priority(settings.priority, settings.cpu)
            self.guarantees = Guarantees(self._process, priority)
            phase_ns, wait_ns = round(settings.phase_ms * 1e6), round(wait_s * 1e9)
            wait_for_vehicle(self._bus, self.inbox, clock, phase_ns, wait_ns, self._request)
            self.is_joined = True
            end_ns = None if duration_s is None else clock.now_ns() + round(duration_s * 1e9)
            schedule = schedule_preparation(settings.prepare_ms, self._is_lockstep)
            counters = None if self._is_lockstep else KernelCounters()
            try:
                run_loop(
                    self._step,
                    clock,
                    self.record,
                    self._request,
                    stays,
                    end_ns,
                    schedule,
                    counters,
                )
            finally:
                if counters is not None:
                    counters.close()
        except BaseException as error:
            self.failure = error


def open_session(
    config: ControllerConfig,
    planner: Planner,
    clock: Clock,
    record_file: Path | None,
    is_lockstep: bool,
) -> ControllerSession:
    """Everything else that can fail, done before the first tick.

    Raises:
        ConfigError: the log file cannot be written, or this machine is too slow.
        BusError: the bus cannot be opened.
    """
    if not is_lockstep:  # a time limit would make the result depend on the machine
        planner.mpc.bound(round(config.realtime.solve_budget_ms * 1e6))
    with ExitStack() as opened:
        # First: the threads that a bus or a log starts inherit the settings of the process.
        process = prepare_process(config.realtime.priority)
        opened.callback(release_process)
        bus = open_bus(
            config.bus.interface,
            config.bus.channel,
            config.bus.bitrate,
            parse_options(config.bus.options),
        )
        opened.callback(close_bus, bus)
        recorder = _open_recorder(record_file, config.bus.channel, is_lockstep)
        if recorder is not None:
            opened.callback(recorder.close)
        inbox = Inbox(Node.CONTROLLER, recorder)
        outbox = Outbox(bus, Node.CONTROLLER, recorder)
        step = ControlStep(
            bus=bus,
            inbox=inbox,
            outbox=outbox,
            mpc=planner.mpc,
            plan=PlanBuffer(config.mpc.horizon),
            limits=INPUT_LIMITS,
            clock=clock,
            model_hash=model_hash(planner.bundle.sha256),
        )
        account = DeadlineAccount(RECORDED_TICKS, round(config.realtime.deadline_ms * 1e6))
        return ControllerSession(
            model=planner.model,
            record=RunRecord(account, TrackingAccount(), DriveTrace(RECORDED_TICKS)),
            inbox=inbox,
            outbox=outbox,
            recorder=recorder,
            _bus=bus,
            _step=step,
            _clock=clock,
            _settings=config.realtime,
            _process=process,
            _is_lockstep=is_lockstep,
            _opened=opened.pop_all(),
        )


def _open_recorder(path: Path | None, channel: str, is_lockstep: bool) -> Recorder | None:
    if path is None:
        return None
    # In lockstep the stamps are simulated time: the same run gives the same bytes.
    offset_ns = 0 if is_lockstep else time.time_ns() - time.monotonic_ns()
    return Recorder(path, channel, is_threaded=not is_lockstep, epoch_offset_ns=offset_ns)
