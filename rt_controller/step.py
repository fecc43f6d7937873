"""One control step: from received frames to the command frames, by the equations of the paper."""

from collections.abc import Callable
from typing import NamedTuple

import can

from rt_controller.bus.catalogue import (
    COMMAND,
    CONTROLLER_IDENTITY,
    HEARTBEAT,
    Command,
    Fault,
    Heartbeat,
    StateSample,
)
from rt_controller.bus.identity import own_identity
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import DiscardBus, Outbox
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode, PathReference
from rt_controller.contract.timing import IDENT_PERIOD_TICKS
from rt_controller.control.low_speed.law import LowSpeedLaw
from rt_controller.control.mpc import Mpc
from rt_controller.control.plan_buffer import PlanBuffer
from rt_controller.control.solver import SolveStatus
from rt_controller.realtime.clock import Clock
from rt_controller.receiver import FreshData, Receiver
from rt_controller.safety.envelope import limit
from rt_controller.safety.fallback import input_for
from rt_controller.safety.modes import STANDING_MPS, StopCause, TickFacts, decide

NO_FAULT = Fault(0)


class StepResult(NamedTuple):
    """What one step received, planned and sent."""

    mode: Mode = Mode.STANDBY
    cause: StopCause = StopCause.NONE
    """why the plan is held, or the car is stopped"""
    control: ControlInput = NEUTRAL_INPUT
    state: StateSample | None = None
    """None: no new, valid state in time for this tick"""
    path: PathReference | None = None
    qp_iterations: int = 0
    qp_ns: int = 0
    """time of the solve; 0: no QP was solved"""
    faults: Fault = NO_FAULT
    """as in the heartbeat"""


class _Planned(NamedTuple):
    control: ControlInput | None
    """the plan's input for this tick: of a new plan, else of the last good one; None: none left"""
    has_solver_failed: bool = False
    qp_iterations: int = 0
    qp_ns: int = 0


class ControlStep:
    """One control step of the controller, once a period.

    Nothing in `run` waits, formats text or opens a file.

    Paper: eqs. (7) and (14).
    """

    def __init__(
        self,
        *,
        bus: can.BusABC,
        inbox: Inbox,
        outbox: Outbox,
        mpc: Mpc,
        low_speed: LowSpeedLaw,
        clock: Clock,
        model_hash: int,
    ) -> None:
        self.result = StepResult()
        """of the last tick"""
        self._receiver = Receiver(bus, inbox)
        self._outbox = outbox
        self._dry_run_outbox = Outbox(DiscardBus(), Node.CONTROLLER)
        self._mpc = mpc
        self._low_speed = low_speed
        self._plan = PlanBuffer(len(mpc.inputs))
        self._clock = clock
        self._identity = own_identity(model_hash)
        self._send_failures = 0
        self._ticks = 0
        self._is_stop_requested = False

    def run(
        self,
        skipped_ticks: int = 0,
        missed_deadline: bool = False,
        end_stage: Callable[[], None] = lambda: None,
    ) -> StepResult:
        """Receive, plan, choose the mode, limit, send; the result of this tick.

        Args:
            skipped_ticks: periods that were skipped before this one.
            missed_deadline: True if the last step missed its deadline; sent in the heartbeat.
            end_stage: called after receiving and after planning, to measure both.
        """
        now_ns, last = self._clock.now_ns(), self.result
        periods = 1 + skipped_ticks

        data = self._receiver.receive(now_ns, periods, last.mode is Mode.STANDBY)
        self._update_history(data, last.mode)
        end_stage()
        planned = self._plan_input(data, periods, last)
        end_stage()
        facts = self._facts(data, planned)
        mode, cause = decide(facts, last.mode, last.cause)
        wanted = input_for(mode, planned.control, last.control, self._is_held)
        control = limit(wanted, last.control)

        faults = self._heartbeat_faults(data, planned, facts.bus_fault, missed_deadline)
        self.result = StepResult(
            mode,
            cause,
            control,
            data.state,
            data.path,
            planned.qp_iterations,
            planned.qp_ns,
            faults,
        )
        self._send(self._outbox, now_ns)
        if self._ticks % IDENT_PERIOD_TICKS == 0:
            self._outbox.send(CONTROLLER_IDENTITY, self._identity, now_ns)
        self._ticks += 1
        return self.result

    def _plan_input(self, data: FreshData, periods: int, last: StepResult) -> _Planned:
        """Lift the state, expand the reference, solve; or low-speed law; or hold the last plan.

        A safe stop is planned too, with or without a mission: it is steered along the path.
        """
        state, path, mission = data.state, data.path, data.mission
        is_stopping = last.mode is Mode.SAFE_STOP
        is_planned = is_stopping or (mission is not None and mission.is_engaged)
        if state is None or path is None or not is_planned:
            return _Planned(self._plan.next(periods))
        previous_law = self._low_speed.law
        slow_path = path._replace(v_mps=0.0, a_mps2=0.0) if is_stopping else path
        if self._low_speed.choose(state.state.vx_mps, slow_path) is not Mode.NOMINAL:
            slow = self._low_speed.control(
                state.state, state.curvature_per_m, slow_path, last.control
            )
            return _Planned(self._plan.store_constant(slow))
        if previous_law is not Mode.NOMINAL:
            self._mpc.resume(last.control)
        status = self._mpc.plan(
            state.state, state.curvature_per_m, path, last.control, data.preview
        )
        is_solved = status is SolveStatus.SOLVED
        control = self._plan.store(self._mpc.inputs) if is_solved else self._plan.next(periods)
        return _Planned(control, not is_solved, self._mpc.iterations, self._mpc.solve_ns)

    @property
    def _is_held(self) -> bool:
        return self._low_speed.law is Mode.STANDSTILL

    def update_matrices(self) -> None:
        """Before the next tick: update the QP's matrices for the state that is predicted."""
        self._mpc.prepare()

    def read_ahead(self) -> None:
        """Just before the next tick: read the frames that have arrived."""
        self._receiver.read_ahead(self._clock.now_ns())

    def warm_up(self) -> None:
        """Just before the next tick: dry-run the step to warm the caches; nothing is sent.

        Code and data that were not used for a period have left the processor's caches; while they
        are in the caches, the step is several times faster.
        """
        now_ns = self._clock.now_ns()
        self._mpc.warm_up()
        limit(self.result.control, self.result.control)
        self._send(self._dry_run_outbox, now_ns)

    def request_stop(self) -> None:
        """From the next step on, bring the car to rest."""
        self._is_stop_requested = True

    def send_safe_command(self) -> None:
        """Send one last command before the loop ends: that of a safe stop, without planning."""
        last = self.result.control
        control = limit(input_for(Mode.SAFE_STOP, None, last, self._is_held), last)
        counter = self._receiver.counter + 1
        command = Command(control, Mode.SAFE_STOP)
        self._outbox.send(COMMAND, command, self._clock.now_ns(), counter=counter)

    def _update_history(self, data: FreshData, mode: Mode) -> None:
        """Pass the new state to the planner, with the input that was applied until now.

        The history goes on only if no state is missing and the car applied our commands.
        """
        state = data.state
        if state is None:
            self._mpc.forget()
            self._low_speed.forget()
            return
        # The echo names the command that was applied, also where a command arrived late. Before the
        # vehicle has accepted a command there is no echo.
        echo = state.command_echo
        applied = None if echo is None else self._outbox.content_under(COMMAND, echo)
        is_driven = mode is not Mode.STANDBY and not state.is_watchdog_braking
        held = NEUTRAL_INPUT if applied is None else applied.control
        if applied is None or not (is_driven and data.is_next_state):
            self._mpc.forget()
            self._low_speed.forget()
        if not is_driven:
            self._low_speed.reset()
        if self._low_speed.law is not Mode.NOMINAL:
            self._mpc.forget()  # the model has seen no car so slow
        self._mpc.observe(state.state, held)
        self._low_speed.observe(state.state.vx_mps, held)

    def _facts(self, data: FreshData, planned: _Planned) -> TickFacts:
        state, mission = data.state, data.mission
        return TickFacts(
            bus_fault=self._receiver.bus_fault(),
            has_state=state is not None,
            has_path=data.path is not None,
            has_invalid_state=data.has_invalid_state,
            has_invalid_path=data.has_invalid_path,
            has_mission=mission is not None,
            is_engaged=mission is not None and mission.is_engaged,
            is_reset_requested=mission is not None
            and mission.is_reset_requested
            and data.is_new_mission,
            is_stop_requested=self._is_stop_requested,
            is_vehicle_braking=state is not None and state.is_watchdog_braking,
            is_standing=state is not None and abs(state.state.vx_mps) < STANDING_MPS,
            periods_held=self._plan.periods_held,
            law=self._low_speed.law,
            has_input=planned.control is not None,
        )

    def _heartbeat_faults(
        self, data: FreshData, planned: _Planned, bus_fault: StopCause, missed_deadline: bool
    ) -> Fault:
        faults = Fault.DEADLINE_MISSED if missed_deadline else NO_FAULT
        if data.has_invalid_state:
            faults |= Fault.STATE_INVALID
        if data.has_implausible_preview:
            faults |= Fault.PREVIEW_IMPLAUSIBLE
        if data.state is None:
            faults |= Fault.STATE_STALE
        if data.mission is None:
            faults |= Fault.MISSION_MISSING
        if planned.has_solver_failed:
            faults |= Fault.SOLVER_FAILED
        if bus_fault is StopCause.PEER_MISMATCH:
            faults |= Fault.PEER_MISMATCH
        elif bus_fault is not StopCause.NONE:
            faults |= Fault.BUS_FAULT
        if self._outbox.send_failures > self._send_failures:
            faults |= Fault.BUS_FAULT  # no stop: the vehicle's watchdog acts on missing commands
        self._send_failures = self._outbox.send_failures
        return faults

    def _send(self, outbox: Outbox, now_ns: int) -> None:
        result = self.result
        command = Command(result.control, result.mode)
        outbox.send(COMMAND, command, now_ns, counter=self._receiver.counter)
        outbox.send(
            HEARTBEAT,
            Heartbeat(
                mode=result.mode,
                faults=result.faults,
                compute_time_ns=self._clock.now_ns() - now_ns,
                state_age_ns=self._receiver.state_age_ns(now_ns),
                qp_iterations=result.qp_iterations or None,
            ),
            now_ns,
        )
