"""One run of the controller: everything opened and checked first, then the loop in its thread."""

from contextlib import ExitStack, closing
from pathlib import Path
from threading import Thread

from rt_controller.bus.identity import model_hash
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.recorder import open_recorder
from rt_controller.bus.transport import close_bus
from rt_controller.config import ControllerConfig
from rt_controller.contract.bundle import Bundle
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.low_speed.law import LowSpeedLaw
from rt_controller.control.mpc import Mpc
from rt_controller.drive import Drive
from rt_controller.drive_trace import DriveTrace
from rt_controller.handshake import wait_for_vehicle
from rt_controller.loop import RunRecord, StopRequest, run_loop
from rt_controller.planner import choose_low_speed_car
from rt_controller.preparation import schedule_preparation
from rt_controller.realtime.accounting import DeadlineAccount
from rt_controller.realtime.clock import Clock, LockstepClock
from rt_controller.realtime.kernel_counters import KernelCounters
from rt_controller.realtime.scheduling import (
    NO_GUARANTEES,
    real_time_process,
    set_thread_priority,
)
from rt_controller.settings import BusSettings
from rt_controller.step import ControlStep

RECORDED_TICKS = round(3600.0 / PERIOD_S)
"""times and states of the last hour are kept"""


class ControllerSession:
    """An open bus, a controller on it, and the record of the run."""

    def __init__(
        self,
        bus_settings: BusSettings,
        config: ControllerConfig,
        bundle: Bundle,
        mpc: Mpc,
        clock: Clock,
        record_file: Path | None = None,
    ) -> None:
        """Open bus and log, and check that the solver is fast enough; nothing is sent yet.

        Args:
            bus_settings: the bus to join.
            config: settings of the loop.
            bundle: the model that `mpc` plans with.
            mpc: used by this session only.
            clock: of the loop; a `LockstepClock` makes the run independent of the machine.
            record_file: log of all frames; None: no log.

        Raises:
            ConfigError: the log file cannot be written, or this machine is too slow.
            BusError: the bus cannot be opened.
        """
        self._settings, self._clock = config.realtime, clock
        self._is_lockstep = isinstance(clock, LockstepClock)
        # Simulated time needs no rank among the threads of this machine, no locked memory, and no
        # interpreter without a garbage collector: to prepare that takes longer than a short drive.
        self._priority = 0 if self._is_lockstep else config.realtime.priority
        if not self._is_lockstep:  # a time limit would make the result depend on the machine
            mpc.limit_solve_time(round(config.realtime.solve_budget_ms * 1e6))
        self.model = f"{bundle.name} {bundle.sha256[:8]}"
        """name of the model, and the first digits of its hash"""
        self.record = RunRecord(
            DeadlineAccount(RECORDED_TICKS, round(config.realtime.deadline_ms * 1e6)),
            DriveTrace(RECORDED_TICKS),
        )
        self.failure: BaseException | None = None
        """the exception that ended the loop, for the main thread to raise"""
        self.is_joined = False
        """True after the vehicle was found"""
        self._request = StopRequest()
        with ExitStack() as opened:
            self.guarantees = NO_GUARANTEES
            if not self._is_lockstep:
                # First: the threads that a bus or a log starts inherit the settings of the process.
                self.guarantees = opened.enter_context(real_time_process(self._priority))
            self._bus = bus_settings.open_bus()
            opened.callback(close_bus, self._bus)
            self.recorder = open_recorder(record_file, bus_settings.channel, self._is_lockstep)
            if self.recorder is not None:
                opened.callback(self.recorder.close)
            self.inbox = Inbox(Node.CONTROLLER, self.recorder)
            self.outbox = Outbox(self._bus, Node.CONTROLLER, self.recorder)
            self._step = ControlStep(
                bus=self._bus,
                inbox=self.inbox,
                outbox=self.outbox,
                mpc=mpc,
                low_speed=LowSpeedLaw(choose_low_speed_car(bundle, config.low_speed)),
                clock=clock,
                model_hash=model_hash(bundle.sha256),
            )
            self._opened = opened.pop_all()

    def start(self, duration_s: float | None, waits_for_missions: bool, wait_s: float) -> Thread:
        """Run the loop in a thread of its own, with its real-time priority.

        Args:
            duration_s: bring the car to rest after this time; None: at the end of the mission.
            waits_for_missions: at the end of a mission, wait for the next one.
            wait_s: longest wait for the vehicle.
        """
        thread = Thread(
            target=self._run, args=(duration_s, waits_for_missions, wait_s), name="control"
        )
        thread.start()
        return thread

    @property
    def is_stop_requested(self) -> bool:
        """True after the first request to end."""
        return self._request.is_requested

    def request_stop(self) -> None:
        """Request the loop to end: the first request stops the car, the second ends at once."""
        self._request.request()

    def drive(self) -> Drive:
        """The drive so far as a table; at most the last hour of it."""
        return self.record.trace.drive(self.model, self.record.ending.value)

    def close(self) -> None:
        """Close the log and the bus, and undo the settings of the process."""
        self._opened.close()

    def _run(self, duration_s: float | None, waits_for_missions: bool, wait_s: float) -> None:
        settings, clock = self._settings, self._clock
        try:
            self.guarantees = set_thread_priority(self._priority, settings.cpu, self.guarantees)
            phase_ns, wait_ns = round(settings.phase_ms * 1e6), round(wait_s * 1e9)
            wait_for_vehicle(self._bus, self.inbox, clock, phase_ns, wait_ns, self._request)
            self.is_joined = True
            end_ns = None if duration_s is None else clock.now_ns() + round(duration_s * 1e9)
            schedule = schedule_preparation(settings.prepare_ms, self._is_lockstep)
            with ExitStack() as opened:
                counters = None
                if not self._is_lockstep:
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
                )
        except BaseException as error:
            self.failure = error
