"""One run of the controller: everything opened and checked first, then the loop in its thread."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from threading import Event, Thread

import can

from rt_controller.bus.identity import model_hash
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.outbox import ControllerOutbox
from rt_controller.bus.recorder import Recorder
from rt_controller.bus.transport import open_bus
from rt_controller.config import ControllerConfig
from rt_controller.contract.artifact import Bundle, load_bundle
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import NEUTRAL_INPUT, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.mpc import Mpc
from rt_controller.control.plan import Plan
from rt_controller.loop import RunRecord, drive, join
from rt_controller.realtime.accounting import DeadlineAccount
from rt_controller.realtime.clock import Clock
from rt_controller.realtime.scheduling import Guarantees, acquire, release
from rt_controller.step import ControlStep
from rt_controller.tracking import TrackingAccount

SHIPPED_MODEL = "mdk-net-paper"
RECORDED_TICKS = round(3600.0 / PERIOD_S)
"""times of the last hour are kept"""
WARM_UP_STEPS = 20
_NOTHING_HOLDS = Guarantees(0, memory_locked=False, collector_off=False, cpu=None)


def shipped_model(name: str = SHIPPED_MODEL) -> Path:
    """The folder of a bundle that comes with the package."""
    return Path(str(resources.files("rt_controller") / "models" / name))


@dataclass(slots=True)
class ControllerSession:
    """An open bus, a loaded model, an assembled QP, and the memory that the run is accounted in."""

    bundle: Bundle
    record: RunRecord
    guarantees: Guarantees = _NOTHING_HOLDS
    failure: BaseException | None = None
    is_joined: bool = False
    _bus: can.BusABC = field(kw_only=True)
    _inbox: Inbox = field(kw_only=True)
    _step: ControlStep = field(kw_only=True)
    _clock: Clock = field(kw_only=True)
    _config: ControllerConfig = field(kw_only=True)
    _recorder: Recorder | None = field(kw_only=True)
    _leave: Event = field(default_factory=Event, kw_only=True)

    @property
    def model(self) -> str:
        """The name of the model that drives, and the first digits of its hash."""
        return f"{self.bundle.name} {self.bundle.encoder_sha256[:8]}"

    def start(self, duration_s: float | None, stays: bool, wait_s: float) -> Thread:
        """Run the loop in a thread of its own, with what the system grants it."""
        thread = Thread(target=self._run, args=(duration_s, stays, wait_s), name="control")
        thread.start()
        return thread

    def leave(self) -> None:
        """Ask the loop to end after its present tick, with a safe command."""
        self._leave.set()

    def close(self) -> None:
        """Leave the bus and finish the log."""
        self._bus.shutdown()
        if self._recorder is not None:
            self._recorder.close()

    def _run(self, duration_s: float | None, stays: bool, wait_s: float) -> None:
        realtime = self._config.realtime
        self.guarantees = acquire(realtime.priority, realtime.cpu)
        try:
            phase_ns = round(realtime.phase_ms * 1e6)
            join(
                self._bus,
                self._inbox,
                self._clock,
                phase_ns,
                round(wait_s * 1e9),
                self._leave.is_set,
            )
            self.is_joined = True
            drive(self._step, self._clock, self.record, self._should_stop(duration_s), stays)
        except BaseException as error:  # nothing may pass the tick unseen: the caller reports it
            self.failure = error
        finally:
            release()

    def _should_stop(self, duration_s: float | None) -> Callable[[], bool]:
        if duration_s is None:
            return self._leave.is_set
        end_ns = self._clock.now_ns() + round(duration_s * 1e9)
        return lambda: self._leave.is_set() or self._clock.now_ns() >= end_ns


def open_session(
    config: ControllerConfig, clock: Clock, record_file: Path | None, is_lockstep: bool
) -> ControllerSession:
    """Everything that can fail, done before the first tick.

    Raises:
        ArtifactError: the model bundle does not fit.
        ConfigError: settings that make no QP, or a log file that cannot be written.
        BusError: the bus cannot be opened.
    """
    bundle = load_bundle(config.model or shipped_model())
    mpc = Mpc(bundle, config.mpc.horizon, config.mpc.cost(), INPUT_LIMITS)
    warm_up(mpc)
    recorder = _open_recorder(record_file, config.bus.channel, is_lockstep) if record_file else None
    bus = open_bus(config.bus.interface, config.bus.channel, config.bus.bitrate, config.bus.options)
    inbox = Inbox(recorder)
    step = ControlStep(
        bus=bus,
        inbox=inbox,
        outbox=ControllerOutbox(bus, recorder),
        mpc=mpc,
        plan=Plan(config.mpc.horizon),
        limits=INPUT_LIMITS,
        clock=clock,
        model_hash=model_hash(bundle.encoder_sha256),
    )
    record = RunRecord(
        deadlines=DeadlineAccount(RECORDED_TICKS, round(config.realtime.deadline_ms * 1e6)),
        tracking=TrackingAccount(),
        outcome=step.outcome,
    )
    return ControllerSession(
        bundle=bundle,
        record=record,
        _bus=bus,
        _inbox=inbox,
        _step=step,
        _clock=clock,
        _config=config,
        _recorder=recorder,
    )


def warm_up(mpc: Mpc) -> None:
    """Plan a few times into the void: the first tick shall find everything loaded and touched."""
    state = VehicleState(20.0, 0.0, 0.0, 20.0 * PERIOD_S, 0.0, 0.0)
    path = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
    for _ in range(WARM_UP_STEPS):
        mpc.plan(state, 0.0, path, NEUTRAL_INPUT)


def _open_recorder(path: Path, channel: str, is_lockstep: bool) -> Recorder:
    # In lockstep the stamps are simulated time, so that the same run gives the same bytes.
    offset_ns = 0 if is_lockstep else time.time_ns() - time.monotonic_ns()
    return Recorder(path, channel, is_threaded=not is_lockstep, epoch_offset_ns=offset_ns)
