"""One control step: frames in, frames out. Reads like the paper, from lift to first input."""

import time

import can

from rt_controller.bus.frames import SAMPLE_TIME_WRAP_NS, Fault, Heartbeat
from rt_controller.bus.identity import dbc_hash
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.outbox import ControllerOutbox
from rt_controller.bus.silent import SilentBus
from rt_controller.bus.snapshot import MissionSnapshot, StateSnapshot
from rt_controller.contract.limits import InputLimits
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode, PathReference
from rt_controller.contract.timing import (
    COUNTER_MODULUS,
    HOLD_PLAN_TICKS,
    IDENT_PERIOD_TICKS,
    PERIOD_S,
    counter_lag,
)
from rt_controller.control.mpc import Mpc
from rt_controller.control.plan import Plan
from rt_controller.control.solver import SolveStatus
from rt_controller.outcome import StepOutcome, StopCause
from rt_controller.realtime.clock import Clock
from rt_controller.safety.envelope import confine
from rt_controller.safety.fallback import safe_stop, stand_by
from rt_controller.safety.freshness import (
    REFERENCE_MAX_AGE_NS,
    ROUND_TRIP_MAX_TICKS,
    STATE_MAX_AGE_NS,
    TransportDelay,
    is_fresh,
)
from rt_controller.safety.modes import Event, next_mode

AHEAD_FRAMES = 64
"""read at most in one rehearsal: a period brings ten, and a flood must not make a tick late"""
NO_FAULT = Fault(0)
STANDING_MPS = 0.3
"""slower than this the car stands: a request to leave SAFE_STOP may be granted"""


SLOWEST_PLANNED_MPS = 3.0
"""below this no model was trained: a safe stop ends without planning its wheel angle"""


class ControlStep:
    """The controller between two ticks: what it hears, what it plans, what it answers.

    Nothing in `run` waits, formats text or opens anything.

    Paper: eqs. (7) and (14).
    """

    def __init__(
        self,
        *,
        bus: can.BusABC,
        inbox: Inbox,
        outbox: ControllerOutbox,
        mpc: Mpc,
        plan: Plan,
        limits: InputLimits,
        clock: Clock,
        model_hash: int,
    ) -> None:
        self._bus = bus
        self._inbox = inbox
        self._outbox = outbox
        self._rehearsal = ControllerOutbox(SilentBus())
        self._mpc = mpc
        self._plan = plan
        self._limits = limits
        self._clock = clock
        self._model_hash = model_hash
        self._catalogue = dbc_hash()
        self._delay = TransportDelay(SAMPLE_TIME_WRAP_NS)
        self._last_state: StateSnapshot | None = None
        self._last_delay_ns = 0
        self._listened_ns = 0
        self._last_mission: MissionSnapshot | None = None
        self._last_out_of_range = 0
        self._last_send_failures = 0
        self._counter = 0
        self._is_next_state = False
        self._faults = NO_FAULT
        self._ticks = 0
        self._is_stop_requested = False
        self.outcome = StepOutcome()

    def run(self, skipped_ticks: int = 0, missed_deadline: bool = False) -> StepOutcome:
        """Hear, plan, judge, confine, answer.

        `skipped_ticks` periods went by unused before this one; `missed_deadline` is news of the
        step before.
        """
        begun_ns, begun_cpu_ns = time.perf_counter_ns(), time.thread_time_ns()
        now_ns = self._clock.now_ns()
        periods = 1 + skipped_ticks
        self._faults = Fault.DEADLINE_MISSED if missed_deadline else NO_FAULT

        self._inbox.drain(self._bus, now_ns)
        state = self._new_state(periods, now_ns)
        self._observe(state)
        path = self._standing_path(now_ns)
        mission = self._standing_mission(now_ns)

        heard_ns = time.perf_counter_ns()
        planned = self._take_plan(state, path, mission, periods)
        planned_ns = time.perf_counter_ns()
        event, cause = self._judge(state, path, mission, planned)
        self._enter(next_mode(self.outcome.mode, event), cause)
        self.outcome.control = confine(
            self._wanted(planned), self.outcome.control, self._limits, PERIOD_S
        )
        self._last_mission = mission
        self._answer(now_ns)

        outcome = self.outcome
        outcome.state, outcome.path = state, path
        outcome.hear_ns, outcome.plan_ns = heard_ns - begun_ns, planned_ns - heard_ns
        outcome.answer_ns = time.perf_counter_ns() - planned_ns
        outcome.cpu_ns = time.thread_time_ns() - begun_cpu_ns
        outcome.listen_ns, self._listened_ns = self._listened_ns, 0
        return outcome

    def prepare(self) -> None:
        """Well before the next tick: build its QP as far as it is known."""
        self._mpc.prepare()

    def rehearse(self) -> None:
        """Just before the next tick: read what has come, and go through the rest for nobody.

        Code and data that were not used for a period have left the processor's caches; used a
        moment ago they make the step several times faster.
        """
        begun_ns = time.perf_counter_ns()
        now_ns = self._clock.now_ns()
        self._inbox.drain(self._bus, now_ns, AHEAD_FRAMES)
        self._listened_ns += time.perf_counter_ns() - begun_ns
        self._mpc.rehearse()
        confine(self.outcome.control, self.outcome.control, self._limits, PERIOD_S)
        self._send(self._rehearsal, now_ns)

    def request_stop(self) -> None:
        """From the next step on, bring the car to rest."""
        self._is_stop_requested = True

    def leave(self) -> None:
        """One last command before the loop ends: as in a safe stop, sent without planning."""
        now_ns = self._clock.now_ns()
        control = confine(
            safe_stop(self.outcome.control, None), self.outcome.control, self._limits, PERIOD_S
        )
        self._outbox.send_command(control, Mode.SAFE_STOP, self._counter + 1, now_ns)

    def _new_state(self, periods: int, now_ns: int) -> StateSnapshot | None:
        # A command carries the counter of the state it answers; without one it counts on.
        self._counter += periods
        newest = self._inbox.state
        out_of_range = self._inbox.counts.out_of_range
        if out_of_range > self._last_out_of_range:
            self._faults |= Fault.STATE_INVALID
        self._last_out_of_range = out_of_range
        if newest is None or newest is self._last_state:
            self._faults |= Fault.STATE_STALE
            return None
        self._last_state = newest
        self._is_next_state = periods == 1 and newest.counter == self._counter % COUNTER_MODULUS
        self._counter = newest.counter
        if self.outcome.mode is Mode.STANDBY:
            self._delay.forget()  # nothing is driven by it: learn a restarted vehicle anew
        self._last_delay_ns = self._delay.measure(newest.arrival_ns, newest.sample_time_ns)
        # It may have been read ahead of this tick, and grown old since.
        age_ns = now_ns - newest.arrival_ns + self._last_delay_ns
        if age_ns > STATE_MAX_AGE_NS or _round_trip(newest) > ROUND_TRIP_MAX_TICKS:
            self._faults |= Fault.STATE_STALE
            return None
        return newest

    def _observe(self, state: StateSnapshot | None) -> None:
        """Tell the planner where the car is, and what brought it there.

        A past counts as long as state follows on state and the car does what it is told.
        """
        if state is None:
            self._mpc.forget()
            return
        # A command that came late acted later: the echo says which one was in force. None of ours
        # was, as long as the vehicle has not taken the first.
        echo = state.command_echo
        held = None if echo is None else self._outbox.command_under(echo)
        obeys = self.outcome.mode is not Mode.STANDBY and not state.is_watchdog_braking
        if held is None or not (obeys and self._is_next_state):
            self._mpc.forget()
        self._mpc.observe(state.state, NEUTRAL_INPUT if held is None else held)

    def _standing_path(self, now_ns: int) -> PathReference | None:
        newest = self._inbox.reference
        if newest is None or not is_fresh(newest.arrival_ns, now_ns, REFERENCE_MAX_AGE_NS):
            return None
        return newest.path

    def _standing_mission(self, now_ns: int) -> MissionSnapshot | None:
        newest = self._inbox.mission
        if newest is None or not is_fresh(newest.arrival_ns, now_ns, newest.valid_for_ns):
            self._faults |= Fault.MISSION_MISSING
            return None
        return newest

    def _take_plan(
        self,
        state: StateSnapshot | None,
        path: PathReference | None,
        mission: MissionSnapshot | None,
        periods: int,
    ) -> ControlInput | None:
        """The first input of a new plan, else the next of the last good one, else nothing."""
        self.outcome.qp_ns = self.outcome.qp_iterations = 0
        if state is None or path is None or mission is None or not mission.is_engaged:
            return self._plan.follow(periods)
        if self.outcome.mode is Mode.SAFE_STOP and state.state.vx_mps < SLOWEST_PLANNED_MPS:
            return self._plan.follow(periods)
        status = self._mpc.plan(state.state, state.curvature_per_m, path, self.outcome.control)
        self.outcome.qp_ns = self._mpc.solve_ns
        self.outcome.qp_iterations = self._mpc.iterations
        if status is SolveStatus.SOLVED:
            return self._plan.renew(self._mpc.inputs)
        self._faults |= Fault.SOLVER_FAILED
        return self._plan.follow(periods)

    def _judge(
        self,
        state: StateSnapshot | None,
        path: PathReference | None,
        mission: MissionSnapshot | None,
        planned: ControlInput | None,
    ) -> tuple[Event, StopCause]:
        cause = self._hard_fault(state)
        if cause is not StopCause.NONE:
            return Event.FAULT, cause
        if mission is None:
            return Event.LOST, StopCause.MISSION_LOST
        if self._may_reset(state, mission):
            return Event.RESET, StopCause.NONE
        if not mission.is_engaged or (state is not None and state.is_watchdog_braking):
            return Event.IDLE, StopCause.NONE
        if self._plan.periods_held == 0:
            return Event.PLANNED, StopCause.NONE
        if state is None:
            cause = StopCause.STATE_LOST
        elif path is None:
            cause = StopCause.REFERENCE_LOST
        else:
            cause = StopCause.SOLVER_FAILED
        may_hold = planned is not None and self._plan.periods_held <= HOLD_PLAN_TICKS
        return (Event.UNPLANNED if may_hold else Event.LOST), cause

    def _hard_fault(self, state: StateSnapshot | None) -> StopCause:
        if self._outbox.send_failures > self._last_send_failures:
            self._faults |= Fault.BUS_FAULT  # the vehicle's watchdog judges what did not arrive
        self._last_send_failures = self._outbox.send_failures
        cause = self._fault_of_the_bus()
        if cause is not StopCause.NONE or self.outcome.mode is Mode.STANDBY:
            return cause  # standing by, there is nothing else to stop for
        if self._is_stop_requested:
            return StopCause.STOP_REQUESTED
        if state is not None and state.is_watchdog_braking:
            return StopCause.VEHICLE_BRAKING
        return StopCause.NONE

    def _fault_of_the_bus(self) -> StopCause:
        inbox = self._inbox
        if inbox.peer is not None and inbox.peer.dbc_hash != self._catalogue:
            self._faults |= Fault.PEER_MISMATCH
            return StopCause.PEER_MISMATCH
        if inbox.last_failure:
            self._faults |= Fault.BUS_FAULT
            return StopCause.BUS_FAILED
        if inbox.foreign_commands > 0:
            self._faults |= Fault.BUS_FAULT
            return StopCause.SECOND_CONTROLLER
        return StopCause.NONE

    def _enter(self, mode: Mode, cause: StopCause) -> None:
        if mode is not Mode.SAFE_STOP or self.outcome.mode is not Mode.SAFE_STOP:
            is_troubled = mode in (Mode.HOLD_PLAN, Mode.SAFE_STOP)
            self.outcome.cause = cause if is_troubled else StopCause.NONE
        self.outcome.mode = mode

    def _may_reset(self, state: StateSnapshot | None, mission: MissionSnapshot) -> bool:
        return (
            mission.is_reset_requested
            and mission is not self._last_mission  # a request, not the memory of one
            and self.outcome.mode is Mode.SAFE_STOP
            and state is not None
            and abs(state.state.vx_mps) < STANDING_MPS
        )

    def _wanted(self, planned: ControlInput | None) -> ControlInput:
        previous = self.outcome.control
        if self.outcome.mode is Mode.STANDBY:
            return stand_by(previous)
        if self.outcome.mode is Mode.SAFE_STOP or planned is None:
            return safe_stop(previous, None if planned is None else planned.steer_rad)
        return planned

    def _answer(self, now_ns: int) -> None:
        self._send(self._outbox, now_ns)
        if self._ticks % IDENT_PERIOD_TICKS == 0:
            self._outbox.send_identity(self._model_hash, now_ns)
        self._ticks += 1

    def _send(self, outbox: ControllerOutbox, now_ns: int) -> None:
        outbox.send_command(self.outcome.control, self.outcome.mode, self._counter, now_ns)
        seen = self._last_state
        age_ns = None if seen is None else now_ns - seen.arrival_ns + self._last_delay_ns
        outbox.send_heartbeat(
            Heartbeat(
                mode=self.outcome.mode,
                faults=self._faults,
                compute_time_ns=self._clock.now_ns() - now_ns,
                state_age_ns=age_ns,
                qp_iterations=self.outcome.qp_iterations or None,
            ),
            now_ns,
        )


def _round_trip(state: StateSnapshot) -> int:
    """Periods from a command of ours to the state that shows its effect; 1 when all is well."""
    if state.command_echo is None:
        return 0
    return counter_lag(newer=state.counter, older=state.command_echo)
