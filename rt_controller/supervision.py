"""Between the bus and the supervisor: its inputs in a tick, and the fault bits of its findings."""

from rt_controller.bus.messages import COMMAND
from rt_controller.bus.send import Outbox
from rt_controller.contract.faults import NO_FAULT, Fault, StopCause
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.control.steering_actuator import LONGEST_DELAY, SteeringActuator
from rt_controller.receiver import FreshData
from rt_controller.safety.inputs import QualifiedInputs, ReceivedInputs
from rt_controller.safety.modes import STANDING_MPS, TickFacts

_FAULT_OF_CAUSE = {
    StopCause.SPEED_IMPLAUSIBLE: Fault.STATE_IMPLAUSIBLE,
    StopCause.PROGRESS_IMPLAUSIBLE: Fault.STATE_IMPLAUSIBLE,
    StopCause.LATERAL_SPEED_IMPLAUSIBLE: Fault.STATE_IMPLAUSIBLE,
    StopCause.YAW_RATE_IMPLAUSIBLE: Fault.STATE_IMPLAUSIBLE,
    StopCause.HEADING_IMPLAUSIBLE: Fault.STATE_IMPLAUSIBLE,
    StopCause.LATERAL_ERROR_IMPLAUSIBLE: Fault.STATE_IMPLAUSIBLE,
    StopCause.CURVATURE_IMPLAUSIBLE: Fault.STATE_IMPLAUSIBLE,
    StopCause.STATE_FROZEN: Fault.STATE_IMPLAUSIBLE,
    StopCause.STATE_OLD: Fault.STATE_IMPLAUSIBLE,
    StopCause.TRACKING_LOST: Fault.STATE_IMPLAUSIBLE,
    StopCause.PATH_JUMP: Fault.PATH_IMPLAUSIBLE,
    StopCause.PATH_INCONSISTENT: Fault.PATH_IMPLAUSIBLE,
    StopCause.PATH_SPEED_JUMP: Fault.PATH_IMPLAUSIBLE,
    StopCause.PREVIEW_JUMP: Fault.PATH_IMPLAUSIBLE,
    StopCause.PATH_TOO_SHARP: Fault.PATH_IMPLAUSIBLE,
    StopCause.STEERING_MISMATCH: Fault.ACTUATOR_MISMATCH,
    StopCause.THROTTLE_MISMATCH: Fault.ACTUATOR_MISMATCH,
    StopCause.BRAKE_MISMATCH: Fault.ACTUATOR_MISMATCH,
    StopCause.NOT_ENGAGED: Fault.NOT_ENGAGED,
}
"""bits of the heartbeat for what the supervisor found"""


def accepted_commands(outbox: Outbox, data: FreshData) -> list[ControlInput] | None:
    """The last command that the vehicle has accepted, and those before it; None: not known.

    The echo names it, also where a command arrived late. Before the vehicle has accepted a command
    there is no echo; then the controller does not drive yet.
    """
    echo = None if data.state is None else data.state.command_echo
    if echo is None:
        return None
    sent = outbox.contents_until(COMMAND, echo, LONGEST_DELAY + 1)
    return [command.control for command in sent]


def command_in_force(
    accepted: list[ControlInput] | None, actuation_periods: int, steering: SteeringActuator
) -> ControlInput | None:
    """The input that acted until the new state; None: not known.

    Args:
        accepted: commands, the last one first.
        actuation_periods: until the pedals follow a command.
        steering: until the wheel does; the angle of a slow one is that which it reports.
    """
    delay = steering.delay_periods
    if accepted is None or len(accepted) <= max(actuation_periods, delay):
        return None
    applied, angle_rad = accepted[actuation_periods], accepted[delay].steer_rad
    if steering.is_slow and steering.angle_rad is not None:
        angle_rad = steering.angle_rad
    return applied._replace(steer_rad=angle_rad)


def note_steering(
    steering: SteeringActuator, accepted: list[ControlInput] | None, received: FreshData, mode: Mode
) -> None:
    """Compare the wheel with the commands, while the car follows those of this program."""
    sample, feedback = received.state, received.feedback
    is_ours = mode is not Mode.STANDBY and sample is not None and not sample.is_watchdog_braking
    if accepted is None or feedback is None or len(accepted) <= LONGEST_DELAY or not is_ours:
        steering.note(None, None)
    else:
        steering.note([each.steer_rad for each in accepted], feedback.steer_rad)


def received_in(
    data: FreshData, applied: ControlInput | None, periods: int, mode: Mode, late_ticks: int = 0
) -> ReceivedInputs:
    """Inputs of the supervisor in a tick.

    Args:
        data: what is fresh and valid.
        applied: the command that acted in the last period; None: not known.
        periods: since the last tick.
        mode: of the last tick.
        late_ticks: by which the steering wheel is later than it is configured.
    """
    sample = data.state
    is_ours = not data.is_ending and (sample is None or not sample.is_watchdog_braking)
    return ReceivedInputs(
        state=None if sample is None else sample.state,
        curvature_per_m=0.0 if sample is None else sample.curvature_per_m,
        path=data.path,
        preview=data.received_preview,
        applied=applied if is_ours else None,
        feedback=data.feedback if is_ours else None,
        is_driven=mode is not Mode.STANDBY,
        is_stopping=mode is Mode.SAFE_STOP,
        periods=periods,
        late_ticks=late_ticks,
    )


def faults_of(
    data: FreshData, qualified: QualifiedInputs, bus_fault: StopCause, is_answer_due: bool
) -> Fault:
    """The bits of what was received and found, and of the bus."""
    faults = NO_FAULT
    for cause in (qualified.alarm, qualified.rejection):
        faults |= _FAULT_OF_CAUSE.get(cause, NO_FAULT)
    if data.has_invalid_state:
        faults |= Fault.STATE_INVALID
    if is_answer_due and not data.is_answered:
        faults |= Fault.COMMANDS_UNANSWERED
    if data.has_conflict:
        faults |= Fault.SOURCE_CONFLICT
    if data.has_implausible_preview:
        faults |= Fault.PREVIEW_IMPLAUSIBLE
    if data.state is None:
        faults |= Fault.STATE_STALE
    if data.mission is None:
        faults |= Fault.MISSION_MISSING
    if bus_fault is StopCause.PEER_MISMATCH:
        faults |= Fault.PEER_MISMATCH
    elif bus_fault is not StopCause.NONE:
        faults |= Fault.BUS_FAULT
    return faults


def facts_of(data: FreshData, qualified: QualifiedInputs, bus_fault: StopCause) -> TickFacts:
    """What was received, as far as the mode depends on it; nothing is planned yet."""
    state, mission = data.state, data.mission
    return TickFacts(
        bus_fault=bus_fault,
        has_state=state is not None,
        has_path=data.path is not None,
        has_invalid_state=data.has_invalid_state,
        has_invalid_path=data.has_invalid_path,
        has_mission=mission is not None,
        is_engaged=mission is not None and mission.is_engaged,
        is_reset_requested=mission is not None
        and mission.is_reset_requested
        and data.is_new_mission,
        is_stop_requested=False,
        is_vehicle_braking=state is not None and state.is_watchdog_braking,
        is_standing=qualified.speed_mps is not None and abs(qualified.speed_mps) < STANDING_MPS,
        periods_held=0,
        law=Mode.STANDBY,
        has_input=False,
        is_answered=data.is_answered,
        has_conflict=data.has_conflict,
        alarm=qualified.alarm,
        rejection=qualified.rejection,
    )
