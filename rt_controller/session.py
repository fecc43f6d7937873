"""One run of the controller: everything opened and checked first, then the loop in its thread."""

import time
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from threading import Thread

import can

from rt_controller.bus.identity import model_hash
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.outbox import ControllerOutbox
from rt_controller.bus.recorder import Recorder
from rt_controller.bus.transport import close_bus, open_bus, parse_options
from rt_controller.config import ControllerConfig
from rt_controller.contract.artifact import Bundle, load_bundle
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import NEUTRAL_INPUT, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.mpc import Mpc
from rt_controller.control.plan import Plan
from rt_controller.control.solver import SolveStatus
from rt_controller.loop import Leads, RunRecord, StopRequest, drive, join
from rt_controller.realtime.accounting import DeadlineAccount
from rt_controller.realtime.clock import Clock
from rt_controller.realtime.lateness import Witness
from rt_controller.realtime.scheduling import (
    NOTHING_HOLDS,
    Guarantees,
    ProcessConduct,
    prepare_process,
    rank_thread,
    release_process,
)
from rt_controller.step import ControlStep
from rt_controller.tracking import TrackingAccount

SHIPPED_MODEL = "mdk-net"
RECORDED_TICKS = round(3600.0 / PERIOD_S)
"""times of the last hour are kept"""
WARM_UP_STEPS = 20
REHEARSALS_NS = (2_400_000, 1_500_000, 800_000)
"""before a tick: the first finds everything cold, the last must be done when the tick comes"""


def shipped_model(name: str = SHIPPED_MODEL) -> Path:
    """The folder of a bundle that comes with the package."""
    return Path(str(resources.files("rt_controller") / "models" / name))


@dataclass(frozen=True, slots=True)
class Planner:
    """A loaded model and the controller assembled with it; needs no bus."""

    bundle: Bundle
    mpc: Mpc

    @property
    def model(self) -> str:
        """The name of the model that drives, and the first digits of its hash."""
        return f"{self.bundle.name} {self.bundle.sha256[:8]}"


@dataclass(slots=True)
class ControllerSession:
    """An open bus, a planner, and the memory that the run is accounted in."""

    model: str
    record: RunRecord
    inbox: Inbox
    outbox: ControllerOutbox
    guarantees: Guarantees = NOTHING_HOLDS
    failure: BaseException | None = None
    """what ended the loop before its time; a thread has nobody to raise it to"""
    is_joined: bool = False
    _request: StopRequest = field(default_factory=StopRequest)
    _bus: can.BusABC = field(kw_only=True)
    _step: ControlStep = field(kw_only=True)
    _clock: Clock = field(kw_only=True)
    _config: ControllerConfig = field(kw_only=True)
    _conduct: ProcessConduct = field(kw_only=True)
    _is_lockstep: bool = field(kw_only=True)
    recorder: Recorder | None = field(kw_only=True)

    def start(self, duration_s: float | None, stays: bool, wait_s: float) -> Thread:
        """Run the loop in a thread of its own, with what the system grants it."""
        thread = Thread(target=self._run, args=(duration_s, stays, wait_s), name="control")
        thread.start()
        return thread

    def leave(self) -> None:
        """Ask the loop to end: a first time it stops the car, a second time it leaves at once."""
        self._request.ask()

    def close(self) -> None:
        """Leave the bus, finish the log, give back what the process was granted."""
        close_bus(self._bus)
        if self.recorder is not None:
            self.recorder.close()
        release_process()

    def _run(self, duration_s: float | None, stays: bool, wait_s: float) -> None:
        realtime, clock = self._config.realtime, self._clock
        try:
            self.guarantees = Guarantees(
                self._conduct, rank_thread(realtime.priority, realtime.cpu)
            )
            phase_ns = round(realtime.phase_ms * 1e6)
            join(self._bus, self.inbox, clock, phase_ns, round(wait_s * 1e9), self._request)
            self.is_joined = True
            end_ns = None if duration_s is None else clock.now_ns() + round(duration_s * 1e9)
            leads = _leads(realtime.prepare_ms, self._is_lockstep)
            witness = None if self._is_lockstep else Witness()
            try:
                drive(self._step, clock, self.record, self._request, stays, end_ns, leads, witness)
            finally:
                if witness is not None:
                    witness.close()
        except BaseException as error:  # nothing may pass the tick unseen: the caller reports it
            self.failure = error


def load_planner(config: ControllerConfig) -> Planner:
    """The model loaded and checked, the QP assembled and solved once.

    Raises:
        ArtifactError: the model bundle does not fit.
        ConfigError: settings that make no QP, or one that is not solved at rest.
    """
    bundle = load_bundle(config.model or shipped_model())
    settings = config.mpc
    mpc = Mpc(
        bundle,
        settings.horizon,
        settings.cost(),
        INPUT_LIMITS,
        settings.features(),
        settings.solving(),
    )
    warm_up(mpc)
    return Planner(bundle, mpc)


def open_session(
    config: ControllerConfig,
    planner: Planner,
    clock: Clock,
    record_file: Path | None,
    is_lockstep: bool,
) -> ControllerSession:
    """Everything else that can fail, done before the first tick.

    Raises:
        ConfigError: a log file that cannot be written, or this machine is too slow.
        BusError: the bus cannot be opened.
    """
    if not is_lockstep:  # which shall be the same on every machine
        planner.mpc.bound(round(config.realtime.solve_budget_ms * 1e6))
    # First of all: the threads that a bus or a log start inherit what the process is granted.
    conduct = prepare_process(config.realtime.priority)
    try:
        bus = open_bus(
            config.bus.interface,
            config.bus.channel,
            config.bus.bitrate,
            parse_options(config.bus.options),
        )
        try:
            recorder = _open_recorder(record_file, config.bus.channel, is_lockstep)
        except BaseException:
            close_bus(bus)
            raise
    except BaseException:
        release_process()
        raise
    inbox, outbox = Inbox(recorder), ControllerOutbox(bus, recorder)
    step = ControlStep(
        bus=bus,
        inbox=inbox,
        outbox=outbox,
        mpc=planner.mpc,
        plan=Plan(config.mpc.horizon),
        limits=INPUT_LIMITS,
        clock=clock,
        model_hash=model_hash(planner.bundle.sha256),
    )
    record = RunRecord(
        deadlines=DeadlineAccount(RECORDED_TICKS, round(config.realtime.deadline_ms * 1e6)),
        tracking=TrackingAccount(),
        outcome=step.outcome,
    )
    return ControllerSession(
        model=planner.model,
        record=record,
        inbox=inbox,
        outbox=outbox,
        recorder=recorder,
        _bus=bus,
        _step=step,
        _clock=clock,
        _config=config,
        _conduct=conduct,
        _is_lockstep=is_lockstep,
    )


def _leads(prepare_ms: float, is_lockstep: bool) -> Leads | None:
    prepare_ns = round(prepare_ms * 1e6)
    if prepare_ns == 0:
        return None
    # One rehearsal is what the solver starts from; more of them only make real time shorter.
    if is_lockstep:
        return Leads(prepare_ns, REHEARSALS_NS[:1])
    return Leads(prepare_ns, tuple(lead_ns for lead_ns in REHEARSALS_NS if lead_ns < prepare_ns))


def warm_up(mpc: Mpc) -> None:
    """Plan a few times into the void: the first tick shall find everything loaded and touched.

    Raises:
        ConfigError: even cruising on a straight path has no solved QP.
    """
    state = VehicleState(20.0, 0.0, 0.0, 20.0 * PERIOD_S, 0.0, 0.0)
    path = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
    for _ in range(WARM_UP_STEPS):
        status = mpc.plan(state, 0.0, path, NEUTRAL_INPUT)
    if status is not SolveStatus.SOLVED:
        raise ConfigError(
            f"The QP of cruising at 20 m/s on a straight path: expected it to be solved, found "
            f"{status.name}. Check the model and the --mpc settings."
        )


def _open_recorder(path: Path | None, channel: str, is_lockstep: bool) -> Recorder | None:
    if path is None:
        return None
    # In lockstep the stamps are simulated time, so that the same run gives the same bytes.
    offset_ns = 0 if is_lockstep else time.time_ns() - time.monotonic_ns()
    return Recorder(path, channel, is_threaded=not is_lockstep, epoch_offset_ns=offset_ns)
