"""One control step: from received frames to the command frames, by the equations of the paper."""

from collections import deque
from collections.abc import Callable
from math import inf
from typing import NamedTuple

import can

from rt_controller.bus.identity import own_identity
from rt_controller.bus.messages import (
    COMMAND,
    CONTROLLER_IDENTITY,
    HEARTBEAT,
    Command,
    Heartbeat,
    Node,
    StateSample,
)
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import DiscardBus, Outbox
from rt_controller.contract.faults import NO_FAULT, Fault, StopCause
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode, PathReference
from rt_controller.contract.timing import IDENT_PERIOD_TICKS
from rt_controller.control.input_planner import InputPlanner, PlannedInput
from rt_controller.control.low_speed import LowSpeedLaw
from rt_controller.control.mpc import MOST_UNDER_WAY, Mpc
from rt_controller.control.steering_actuator import SteeringActuator
from rt_controller.realtime.clock import TimeSource
from rt_controller.receiver import FreshData, Receiver
from rt_controller.safety.checks import Quantity
from rt_controller.safety.envelope import limit
from rt_controller.safety.fallback import braking_for, input_for
from rt_controller.safety.freshness import ROUND_TRIP_MAX_TICKS
from rt_controller.safety.inputs import QualifiedInputs
from rt_controller.safety.modes import decide
from rt_controller.safety.supervisor import Supervisor
from rt_controller.supervision import (
    accepted_commands,
    command_in_force,
    facts_of,
    faults_of,
    note_steering,
    received_in,
)


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
    speed_mps: float | None = None
    """as far as it is measured and plausible; None: not known"""
    bus_fault: StopCause = StopCause.NONE
    """one of `BUS_CAUSES`, also in a safe stop that began for another reason"""
    most_steer_rad: float = INPUT_LIMITS.upper.steer_rad
    """bound of the steering wheel in this tick"""


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
        clock: TimeSource,
        model_hash: int,
        supervisor: Supervisor,
        actuation_periods: int = 0,
        note_call: Callable[[str], None] = lambda name: None,
    ) -> None:
        """`note_call` gets the name of every call that changes what later steps compute."""
        self.result = StepResult()
        """of the last tick"""
        self.began_ns = 0
        """time on the clock that the last tick took as its own"""
        self._note_call = note_call
        self._receiver = Receiver(bus, inbox)
        self._outbox = outbox
        self._dry_run_outbox = Outbox(DiscardBus(), Node.CONTROLLER, is_fd=outbox.is_fd)
        self._planner = InputPlanner(mpc, low_speed)
        self._low_speed = low_speed
        self._clock = clock
        self._identity = own_identity(model_hash, outbox.is_fd)
        self._supervisor = supervisor
        self._send_failures = 0
        self._ticks = 0
        self._is_stop_requested = False
        self._actuation_periods = actuation_periods
        self._steering = SteeringActuator(actuation_periods)
        self._sent = deque([NEUTRAL_INPUT] * MOST_UNDER_WAY, maxlen=MOST_UNDER_WAY)
        self._is_history_estimated = False

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
        now_ns = self.began_ns = self._clock.now_ns()
        last = self.result
        periods = 1 + skipped_ticks

        data = self._receiver.receive(now_ns, periods, last.mode is Mode.STANDBY)
        accepted = accepted_commands(self._outbox, data)
        note_steering(self._steering, accepted, data, last.mode)
        applied = command_in_force(accepted, self._actuation_periods, self._steering)
        qualified = self._supervisor.judge(
            received_in(data, applied, periods, last.mode, self._steering.late_periods)
        )
        self._update_history(data, qualified, applied, last)
        end_stage()
        planned = self._plan_input(data, qualified, periods, last)
        end_stage()
        facts = facts_of(data, qualified, self._receiver.bus_fault())._replace(
            state_loss=self._receiver.state_loss(),
            is_stop_requested=self._is_stop_requested,
            periods_held=self._planner.periods_held,
            law=self._planner.law,
            has_input=planned.control is not None,
        )
        mode, cause = decide(facts, last.mode, last.cause)
        braking = braking_for(
            qualified.alarm,
            qualified.speed_mps is not None and qualified.is_path_received,
            self._supervisor.cornering(last.control),
            self._supervisor.values[Quantity.THROTTLE],
        )
        wanted = input_for(mode, planned.control, last.control, self._is_held, braking)
        most_steer_rad = self._most_steer_rad(mode, qualified)
        control = limit(wanted, last.control, most_steer_rad)
        self._supervisor.note(control, planned.lifted)
        self._sent.append(control)

        faults = self._heartbeat_faults(data, qualified, planned, facts.bus_fault, missed_deadline)
        self.result = StepResult(
            mode,
            cause,
            control,
            data.state,
            data.path,
            planned.qp_iterations,
            planned.qp_ns,
            faults,
            qualified.speed_mps,
            facts.bus_fault,
            most_steer_rad,
        )
        self._send(self._outbox, now_ns)
        if self._ticks % IDENT_PERIOD_TICKS == 0:
            self._outbox.send(CONTROLLER_IDENTITY, self._identity, now_ns)
        self._ticks += 1
        return self.result

    def _plan_input(
        self, data: FreshData, qualified: QualifiedInputs, periods: int, last: StepResult
    ) -> PlannedInput:
        """Plan from the state and the path that the supervisor accepts, or hold the last plan.

        A safe stop is planned too, with or without a mission: it is steered along the path, from
        the estimated state and along the last known path where they are not received.
        """
        state, path, mission = qualified.state, qualified.path, data.mission
        is_stopping = last.mode is Mode.SAFE_STOP or qualified.alarm is not StopCause.NONE
        is_received = qualified.is_measured and qualified.is_path_received
        is_engaged = mission is not None and mission.is_engaged
        if state is None or path is None or not (is_stopping or (is_engaged and is_received)):
            return self._planner.hold(periods)
        preview = qualified.preview if data.state is None or is_stopping else data.preview
        return self._planner.plan(
            state,
            qualified.curvature_per_m,
            self._steering.slowed(path, state.vx_mps),
            preview,
            last.control,
            periods,
            stops=is_stopping,
            under_way=self._under_way(),
            steering_rate_radps=self._steering.rate_radps,
        )

    def _under_way(self) -> tuple[ControlInput, ...]:
        """The inputs that were sent and do not act yet, the oldest first.

        If the wheel is later than the pedals, the last input of the pedals is held until then.
        """
        sent, transport = tuple(self._sent), self._receiver.transport_periods
        of_pedals = sent[len(sent) - transport - self._actuation_periods :]
        steering = self._steering
        if steering.delay_periods == self._actuation_periods and not steering.is_slow:
            return of_pedals
        periods = min(transport + steering.delay_periods, len(sent))
        of_wheel = sent[len(sent) - periods :]
        angles_rad = steering.angles_under_way([each.steer_rad for each in of_wheel])
        pedals = (*of_pedals, *[self.result.control] * (periods - len(of_pedals)))
        return tuple(
            each._replace(steer_rad=angle_rad)
            for each, angle_rad in zip(pedals, angles_rad, strict=True)
        )

    def _most_steer_rad(self, mode: Mode, qualified: QualifiedInputs) -> float:
        """Bound of the wheel by the speed, and by the law that drives."""
        vx_mps = 0.0 if qualified.state is None else qualified.state.vx_mps
        if mode is Mode.STANDBY:
            return self._low_speed.largest_wheel_rad(vx_mps)
        return self._planner.most_steer_rad(vx_mps)

    @property
    def _is_held(self) -> bool:
        return self._planner.law is Mode.STANDSTILL

    def update_matrices(self) -> None:
        """Before the next tick: update the QP's matrices for the state that is predicted."""
        self._note_call("update_matrices")
        self._planner.prepare()

    def read_ahead(self) -> None:
        """Just before the next tick: read the frames that have arrived."""
        self._receiver.read_ahead(self._clock.now_ns())

    def warm_up(self) -> None:
        """Just before the next tick: dry-run the step to warm the caches; nothing is sent.

        Code and data that were not used for a period have left the processor's caches; while they
        are in the caches, the step is several times faster.
        """
        self._note_call("warm_up")
        now_ns = self._clock.now_ns()
        self._planner.warm_up()
        limit(self.result.control, self.result.control)
        self._send(self._dry_run_outbox, now_ns)

    def request_stop(self) -> None:
        """From the next step on, bring the car to rest."""
        if not self._is_stop_requested:
            self._note_call("request_stop")
        self._is_stop_requested = True

    def send_safe_command(self) -> None:
        """Send one last command before the loop ends: that of a safe stop, without planning."""
        self._note_call("send_safe_command")
        last = self.result.control
        control = limit(input_for(Mode.SAFE_STOP, None, last, self._is_held), last, inf)
        self._receiver.counter += 1
        self.result = self.result._replace(mode=Mode.SAFE_STOP, control=control)
        self._send(self._outbox, self._clock.now_ns())

    def _update_history(
        self,
        data: FreshData,
        qualified: QualifiedInputs,
        applied: ControlInput | None,
        last: StepResult,
    ) -> None:
        """Pass the new state to the planner, with the input that was applied until now.

        The history goes on only if no state is missing and the car applied our commands. While none
        is measured it goes on with estimates, for a stop; the next measured state restarts it.
        """
        sample, state = data.state, qualified.state
        was_estimated = self._is_history_estimated
        self._is_history_estimated = last.mode is not Mode.STANDBY and not qualified.is_measured
        if self._is_history_estimated and state is not None:
            self._planner.observe_estimate(state, last.control if applied is None else applied)
            return
        if sample is None or state is None:
            self._planner.forget()
            return
        is_driven = last.mode is not Mode.STANDBY and not sample.is_watchdog_braking
        is_known = applied is not None and not was_estimated
        self._planner.observe(
            state,
            NEUTRAL_INPUT if applied is None else applied,
            is_driven=is_driven,
            continues=is_known and is_driven and data.is_next_state,
        )

    def state_age_ns(self, now_ns: int) -> int | None:
        """Age of the newest state, its extra transport delay included; None before the first."""
        return self._receiver.state_age_ns(now_ns)

    def _heartbeat_faults(
        self,
        data: FreshData,
        qualified: QualifiedInputs,
        planned: PlannedInput,
        bus_fault: StopCause,
        missed_deadline: bool,
    ) -> Fault:
        is_due = self._ticks > ROUND_TRIP_MAX_TICKS
        faults = faults_of(data, qualified, bus_fault, is_due)
        if missed_deadline:
            faults |= Fault.DEADLINE_MISSED
        if self._steering.late_periods > 0 or self._steering.is_slow:
            faults |= Fault.ACTUATOR_MISMATCH
        if planned.has_solver_failed:
            faults |= Fault.SOLVER_FAILED
        if self._outbox.send_failures > self._send_failures:
            faults |= Fault.BUS_FAULT  # no stop: the vehicle's watchdog acts on missing commands
        self._send_failures = self._outbox.send_failures
        if self._receiver.bus_state.is_disturbed:
            faults |= Fault.BUS_FAULT
        return faults

    def _send(self, outbox: Outbox, now_ns: int) -> None:
        result = self.result
        command, counter = Command(result.control, result.mode), self._receiver.counter
        outbox.send(COMMAND, command, now_ns, counter=counter)
        outbox.send(
            HEARTBEAT,
            Heartbeat(
                mode=result.mode,
                faults=result.faults,
                state_counter=counter,
                compute_time_ns=self._clock.now_ns() - now_ns,
                state_age_ns=self._receiver.state_age_ns(now_ns),
                qp_iterations=result.qp_iterations or None,
            ),
            now_ns,
            counter=counter,
        )
