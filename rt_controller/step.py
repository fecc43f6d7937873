"""One control step: from received frames to the command frames, by the equations of the paper."""

from collections.abc import Callable
from dataclasses import replace
from math import inf

import can

from rt_controller.bus.identity import own_identity
from rt_controller.bus.messages import (
    COMMAND,
    CONTROLLER_IDENTITY,
    HEARTBEAT,
    Command,
    Heartbeat,
    Node,
)
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import DiscardBus, Outbox
from rt_controller.contract.car import DEFAULT_CAR, Car
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode, VehicleState
from rt_controller.contract.timing import IDENT_PERIOD_TICKS, PERIOD_S
from rt_controller.control.input_planner import InputPlanner, PlannedInput
from rt_controller.control.low_speed import LowSpeedLaw
from rt_controller.control.mpc import MOST_UNDER_WAY
from rt_controller.control.planner import Planner
from rt_controller.control.steering_actuator import LONGEST_DELAY, SteeringActuator
from rt_controller.realtime.clock import TimeSource
from rt_controller.receive import Receiver
from rt_controller.safety.envelope import limit
from rt_controller.safety.freshness import ROUND_TRIP_MAX_TICKS
from rt_controller.safety.modes import decide
from rt_controller.safety.stop import ALONG_PATH, input_for
from rt_controller.safety.supervisor import Supervisor
from rt_controller.safety.tick import Tick


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
        planner: Planner,
        low_speed: LowSpeedLaw,
        car: Car = DEFAULT_CAR,
        clock: TimeSource,
        model_hash: int,
        supervisor: Supervisor,
        actuation_periods: int = 0,
        note_call: Callable[[str], None] = lambda name: None,
    ) -> None:
        """`note_call` gets the name of every call that changes what later steps compute."""
        self.last = Tick()
        self.began_ns = 0
        """time on the clock that the last tick took as its own"""
        self._note_call = note_call
        self._receiver = Receiver(bus, inbox)
        self._bus_condition = inbox.condition
        self._outbox = outbox
        self._dry_run_outbox = Outbox(DiscardBus(), Node.CONTROLLER)
        self._planner = InputPlanner(planner, low_speed)
        self._low_speed = low_speed
        self._limits, self._force_scale = car.limits, car.force_scale
        self._along_path = ALONG_PATH.scaled(car.force_scale)
        self._clock = clock
        self._identity = own_identity(model_hash)
        self._supervisor = supervisor
        self._send_failures = 0
        self._ticks = 0
        self._is_stop_requested = False
        self._actuation_periods = actuation_periods
        self._steering = SteeringActuator(actuation_periods, car.limits.rate_per_s.steer_rad)
        self._sent = supervisor.sent
        self._is_history_estimated = False

    def run(
        self,
        skipped_ticks: int = 0,
        missed_deadline: bool = False,
        end_stage: Callable[[], None] = lambda: None,
    ) -> Tick:
        """Receive, check, plan, decide, send; what was done in this tick.

        Args:
            skipped_ticks: periods that were skipped before this one.
            missed_deadline: True if the last step missed its deadline; sent in the heartbeat.
            end_stage: called at the end of each stage but the last, to measure them.
        """
        now_ns = self.began_ns = self._clock.now_ns()
        last, supervisor = self.last, self._supervisor
        tick = Tick(1 + skipped_ticks, last.mode, is_stop_requested=self._is_stop_requested)

        self._receiver.receive(tick, now_ns)
        end_stage()

        applied = self._note_actuators(tick)
        estimate = tick.estimate = supervisor.check(tick)
        end_stage()

        x_0 = self._observe(tick, applied, last)
        before, of_car = last.control, None if tick.is_driven else tick.feedback
        if of_car is not None:
            before = of_car._replace(steer_rad=before.steer_rad)
        plan = self._plan_input(tick, x_0, before, of_car)
        tick.planned, tick.has_solver_failed = plan.control, plan.has_solver_failed
        tick.qp_iterations, tick.qp_ns = plan.qp_iterations, plan.qp_ns
        tick.periods_held, law = self._planner.periods_held, self._planner.law
        tick.law = law
        end_stage()

        tick.mode, tick.cause = decide(tick, last.cause)
        is_held = law is Mode.STANDSTILL
        steer_rad, scale = last.control.steer_rad, self._force_scale
        braking = supervisor.braking(estimate, steer_rad, is_held, scale)
        if tick.mode is Mode.STANDBY:
            before = last.control
        wheel_rad = None if of_car is None else of_car.steer_rad
        wanted = input_for(tick.mode, plan.control, before, is_held, braking, wheel_rad)
        tick.limits = self._limits.with_wheel(self._most_steer_rad(tick))
        control = tick.control = limit(wanted, before, tick.limits)
        acting = control if of_car is None or tick.mode is not Mode.STANDBY else of_car
        supervisor.note(acting, plan.lifted, self._receiver.counter)
        tick.faults = self._faults(tick, missed_deadline)
        self.last = tick
        end_stage()

        self._send(self._outbox, now_ns)
        if self._ticks % IDENT_PERIOD_TICKS == 0:
            self._outbox.send(CONTROLLER_IDENTITY, self._identity, now_ns)
        self._ticks += 1
        return tick

    def _note_actuators(self, tick: Tick) -> ControlInput | None:
        """The input that acted until now, by the echo of the vehicle; None: not known.

        The echo names the last command that the vehicle has accepted, also where it arrived late.
        Before the first one there is no echo; then the controller does not drive yet. The angle of
        a slow wheel is that which it reports.
        """
        steering, echo = self._steering, self._receiver.command_echo
        accepted = [] if echo is None else self._sent.until(echo, LONGEST_DELAY + 1)
        is_ours = tick.is_driven and tick.state is not None and not tick.is_vehicle_braking
        if tick.feedback is None or len(accepted) <= LONGEST_DELAY or not is_ours:
            steering.note(None, None)
        else:
            steering.note([each.steer_rad for each in accepted], tick.feedback.steer_rad)
        applied = None
        if len(accepted) > max(self._actuation_periods, steering.delay_periods):
            applied = accepted[self._actuation_periods]
            angle_rad = accepted[steering.delay_periods].steer_rad
            if steering.is_slow and steering.angle_rad is not None:
                angle_rad = steering.angle_rad
            if angle_rad != applied.steer_rad:
                applied = applied._replace(steer_rad=angle_rad)
        if tick.is_ending or tick.is_vehicle_braking:  # somebody else may have the car
            tick.feedback = None
        else:
            tick.applied = applied
        if not tick.is_driven:
            tick.is_wheel_matched = tick.feedback is None or self._is_matched(tick.feedback)
        tick.late_ticks = steering.late_periods
        return applied

    def _is_matched(self, of_car: ControlInput) -> bool:
        """True if the last command had the angle of the wheel, as far as it may have it."""
        most_rad, last_rad = self.last.limits.upper.steer_rad, self.last.control.steer_rad
        wheel_rad = min(max(of_car.steer_rad, -most_rad), most_rad)
        return abs(wheel_rad - last_rad) < self._limits.rate_per_s.steer_rad * PERIOD_S

    def _plan_input(
        self,
        tick: Tick,
        x_0: VehicleState | None,
        before: ControlInput,
        of_car: ControlInput | None,
    ) -> PlannedInput:
        """Plan from x_0 along the path that the supervisor accepts, or hold the last plan.

        `before` is the input of the last period, `of_car` that of the driver who still drives.

        A safe stop is planned too, with or without a mission: it is steered along the path, from
        the estimated state and along the last known path where they are not received.
        """
        estimate, steering = tick.estimate, self._steering
        path, is_received = estimate.path, estimate.is_measured and estimate.is_path_received
        is_wanted = estimate.stops or (tick.is_engaged and is_received)
        if x_0 is None or path is None or not is_wanted:
            return self._planner.hold(tick.periods)
        return self._planner.plan(
            x_0,
            estimate.curvature_per_m,
            steering.slowed(path, x_0.vx_mps),
            estimate.preview,
            before,
            tick.periods,
            stops=estimate.stops,
            under_way=self._under_way(before),
            steering_rate_radps=steering.rate_radps,
            of_car=of_car,
        )

    def _under_way(self, last: ControlInput) -> tuple[ControlInput, ...]:
        """The inputs that were sent and do not act yet, the oldest first.

        If the wheel is later than the pedals, the last input of the pedals is held until then.
        """
        sent, transport = self._sent, self._receiver.transport_periods
        of_pedals = sent.last(min(transport + self._actuation_periods, MOST_UNDER_WAY))
        steering = self._steering
        if steering.delay_periods == self._actuation_periods and not steering.is_slow:
            return of_pedals
        periods = min(transport + steering.delay_periods, MOST_UNDER_WAY)
        of_wheel = sent.last(periods)
        angles_rad = steering.angles_under_way([each.steer_rad for each in of_wheel])
        pedals = (*of_pedals, *[last] * (periods - len(of_pedals)))
        return tuple(
            each._replace(steer_rad=angle_rad)
            for each, angle_rad in zip(pedals, angles_rad, strict=True)
        )

    def _most_steer_rad(self, tick: Tick) -> float:
        """Bound of the wheel by the speed, and by the law that drives."""
        state = tick.estimate.state
        vx_mps = 0.0 if state is None else state.vx_mps
        if tick.mode is Mode.STANDBY:
            return self._low_speed.largest_wheel_rad(vx_mps)
        return self._planner.most_steer_rad(vx_mps)

    def update_matrices(self) -> None:
        """Before the next tick: update the matrices of the QP, and predict the next motion."""
        self._note_call("update_matrices")
        self._planner.prepare()
        delay = self._receiver.transport_periods + self._actuation_periods
        self._supervisor.prepare(self._sent.last(1 + delay)[0])

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
        limit(self.last.control, self.last.control, self._limits)
        self._send(self._dry_run_outbox, now_ns)

    def request_stop(self) -> None:
        """From the next step on, bring the car to rest."""
        if not self._is_stop_requested:
            self._note_call("request_stop")
        self._is_stop_requested = True

    def send_safe_command(self) -> None:
        """Send one last command before the loop ends: that of a safe stop, without planning."""
        self._note_call("send_safe_command")
        last, is_held = self.last.control, self._planner.law is Mode.STANDSTILL
        wanted = input_for(Mode.SAFE_STOP, None, last, is_held, self._along_path)
        control = limit(wanted, last, self._limits.with_wheel(inf))
        self._receiver.counter += 1
        self.last = replace(self.last, mode=Mode.SAFE_STOP, control=control)
        self._send(self._outbox, self._clock.now_ns())

    def _observe(self, tick: Tick, applied: ControlInput | None, last: Tick) -> VehicleState | None:
        """x_0 of eq. (14): the accepted state, filtered with the input that was applied until now.

        The history goes on only if no state is missing and the car applied our commands. While none
        is measured it goes on with estimates, for a stop; the next measured state restarts it.
        """
        estimate, was_estimated = tick.estimate, self._is_history_estimated
        self._is_history_estimated = tick.is_driven and not estimate.is_measured
        if self._is_history_estimated and estimate.state is not None:
            acted = last.control if applied is None else applied
            return self._planner.observe_estimate(estimate.state, acted)
        if tick.state is None or estimate.state is None:
            self._planner.forget()
            return None
        is_driven = tick.is_driven and not tick.is_vehicle_braking
        is_known = applied is not None and not was_estimated
        return self._planner.observe(
            estimate.state,
            NEUTRAL_INPUT if applied is None else applied,
            is_driven=is_driven,
            continues=is_known and is_driven and tick.is_next_state,
        )

    def state_age_ns(self, now_ns: int) -> int | None:
        """Age of the newest state, its extra transport delay included; None before the first."""
        return self._receiver.state_age_ns(now_ns)

    def _faults(self, tick: Tick, missed_deadline: bool) -> Fault:
        """The bits of the heartbeat: what was received, found and planned, and the bus."""
        steering, outbox = self._steering, self._outbox
        # A failure to send stops nothing: the watchdog of the vehicle acts on missing commands.
        is_bus_faulty = outbox.send_failures > self._send_failures
        self._send_failures = outbox.send_failures
        is_mismatch = tick.bus_fault is StopCause.PEER_MISMATCH
        is_bus_faulty |= tick.bus_fault is not StopCause.NONE and not is_mismatch
        is_bus_faulty |= self._bus_condition.state.is_disturbed
        alarm, rejection = tick.estimate.alarm, tick.estimate.rejection
        faults = tick.estimate.report
        for is_set, fault in (
            (alarm is not StopCause.NONE, alarm.fault),
            (rejection is not StopCause.NONE, rejection.fault),
            (tick.state is None, Fault.STATE_STALE),
            (tick.has_invalid_state, Fault.STATE_INVALID),
            (tick.has_solver_failed, Fault.SOLVER_FAILED),
            (missed_deadline, Fault.DEADLINE_MISSED),
            (not tick.has_mission, Fault.MISSION_MISSING),
            (is_bus_faulty, Fault.BUS_FAULT),
            (is_mismatch, Fault.PEER_MISMATCH),
            (tick.has_implausible_preview, Fault.PREVIEW_IMPLAUSIBLE),
            (
                not tick.is_answered and self._ticks > ROUND_TRIP_MAX_TICKS,
                Fault.COMMANDS_UNANSWERED,
            ),
            (tick.has_conflict, Fault.SOURCE_CONFLICT),
            (steering.late_periods > 0 or steering.is_slow, Fault.ACTUATOR_MISMATCH),
        ):
            if is_set:
                faults |= fault
        return faults

    def _send(self, outbox: Outbox, now_ns: int) -> None:
        tick, counter = self.last, self._receiver.counter
        outbox.send(COMMAND, Command(tick.control, tick.mode), now_ns, counter=counter)
        heartbeat = Heartbeat(
            mode=tick.mode,
            faults=tick.faults,
            state_counter=counter,
            compute_time_ns=self._clock.now_ns() - now_ns,
            state_age_ns=self._receiver.state_age_ns(now_ns),
            qp_iterations=tick.qp_iterations or None,
        )
        outbox.send(HEARTBEAT, heartbeat, now_ns, counter=counter)
