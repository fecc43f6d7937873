"""Words for what went wrong in a drive: the message of a safe stop, a sentence for each fault."""

from collections.abc import Iterable, Sequence
from math import nan
from typing import Any, NamedTuple

from rt_controller.bus.messages import REFERENCE, STATE, Message
from rt_controller.bus.receive import Inbox
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.safety.checks import CHECKS, Check, is_computed
from rt_controller.session import ControllerSession

VEHICLE_KNOWS = "The vehicle's program (sim-bridge, or the gateway) names the cause at its end"
_COUNTED = "(sim-bridge) runs and its frames arrive; the summary counts dropped and missing ones"
_REMEDIES = {
    StopCause.STATE_LOST: f"Check that the vehicle {_COUNTED}",
    StopCause.REFERENCE_LOST: f"Check that the path planner {_COUNTED}",
    StopCause.MISSION_LOST: f"Check that the vehicle {_COUNTED}",
    StopCause.STATE_CONFLICT: "Stop the second vehicle, or the program that replays a log",
    StopCause.COMMANDS_UNANSWERED: "Check that commands arrive at the vehicle, and why it refuses "
    "them (refused_ticks in its summary)",
    StopCause.BUS_OFF: "Check wiring, termination and bit rate; the driver restarts the controller "
    "with restart-ms",
    StopCause.INTERFACE_DOWN: "Bring the interface up (ip link set CHANNEL up)",
    StopCause.SECOND_CONTROLLER: "Stop the other one, or choose another channel",
    StopCause.PEER_MISMATCH: "Start the same version at both ends",
    StopCause.SOLVER_FAILED: "Check the tolerances of --mpc and the model",
}
_OF_VALUES = "Check what sends or measures these values"
_RECORDED = "rt-controller explain shows more of a recorded drive."
_MESSAGES: dict[StopCause, Message[Any]] = {
    StopCause.STATE_INVALID: STATE,
    StopCause.REFERENCE_INVALID: REFERENCE,
}
_OF_CHECKS = {StopCause.STATE_OLD, *(check.cause for check in CHECKS)}
"""causes that a check of plausibility finds"""
FAULT_SENTENCES = {
    Fault.STATE_STALE: "No new vehicle state arrived in time.",
    Fault.STATE_INVALID: "The vehicle state had values that may not be used.",
    Fault.SOLVER_FAILED: "The QP was not solved.",
    Fault.DEADLINE_MISSED: "The commands were sent after their deadline.",
    Fault.MISSION_MISSING: "There was no valid mission.",
    Fault.BUS_FAULT: "The bus could not be read, or was off.",
    Fault.PEER_MISMATCH: "The vehicle used another message catalogue.",
    Fault.PREVIEW_IMPLAUSIBLE: "The curvature ahead contradicted the state or the one before, and "
    "was not used.",
    Fault.COMMANDS_UNANSWERED: "The vehicle did not accept the commands in time.",
    Fault.SOURCE_CONFLICT: "A second participant sent states or commands.",
    Fault.STATE_IMPLAUSIBLE: "Values of the vehicle state contradicted each other or the model; an "
    "estimate replaced them.",
    Fault.PATH_IMPLAUSIBLE: "The path jumped, was too sharp, or led away from the car.",
    Fault.ACTUATOR_MISMATCH: "An actuator followed the commands too late, or not at all.",
    Fault.NOT_ENGAGED: "The car was outside of the window in which the controller may begin to "
    "drive.",
    Fault.SPEED_NOT_FOLLOWED: "The speed was far from the wanted one for seconds.",
    Fault.OUTSIDE_TRAINING: "The motion was outside of what the model was trained with.",
}

_UNITS = {
    "PER_M": "1/m",
    "M": "m",
    "MPS": "m/s",
    "MPS2": "m/s^2",
    "MPS3": "m/s^3",
    "RAD": "rad",
    "RADPS": "rad/s",
    "N": "N",
    "TICKS": "ticks",
}
"""by the end of the name of a quantity, the longer one first"""


class Margin(NamedTuple):
    """A quantity that a check compares with its limit."""

    check: str
    value: float
    """NaN: there is nothing to check, which is a fault of its own where the check needs it"""
    limit: float
    unit: str

    @property
    def margin(self) -> float:
        """Limit minus value; negative if the value is beyond the limit."""
        return self.limit - self.value

    @property
    def share_left(self) -> float:
        """What is left of the limit."""
        return self.margin / (abs(self.limit) or 1.0)

    @property
    def text(self) -> str:
        """Check, value and limit for people."""
        return f"{self.check}, {self.value:.4g} of {self.limit:.4g} {self.unit}"


def plausibility_margins(values: Sequence[float], checks: Sequence[Check]) -> list[Margin]:
    """The quantities of a tick, by `Quantity`, against the thresholds of these checks."""
    margins = []
    for check in checks:
        value, name = values[check.quantity], check.quantity.name
        unit = next((unit for end, unit in _UNITS.items() if name.endswith(f"_{end}")), "1")
        computed = value if is_computed(value) else nan
        margins.append(Margin(check.name, computed, check.threshold, unit))
    return margins


def exceeded(margins: Iterable[Margin]) -> list[Margin]:
    """Those whose value is beyond its limit; some checks act only after several ticks in a row."""
    return [each for each in margins if each.margin < 0.0]


def remedy_of(cause: StopCause) -> str:
    """What to do about a cause, as a sentence; empty where the cause says it."""
    remedy = _REMEDIES.get(cause, _OF_VALUES if cause in _OF_CHECKS else "")
    return f"{remedy}." if remedy else ""


def failed_checks(session: ControllerSession) -> list[Margin]:
    """The checks beyond their limit in the tick in which the safe stop began; empty if another
    fault was its cause."""
    if not session.stop_values or session.record.result.cause not in _OF_CHECKS:
        return []
    return exceeded(plausibility_margins(session.stop_values, session.supervisor.checks))


def begin_of_stop(session: ControllerSession) -> str:
    """The words "safe stop" with time and tick of its begin, as far as there is one."""
    tick, time_s = session.record.stop_tick, session.record.stop_s
    return "safe stop" if tick is None else f"safe stop at {time_s:.3f} s (tick {tick})"


def explain_braking(braking: str) -> str:
    """That the vehicle brakes by itself, and why."""
    separator = ". " if braking == VEHICLE_KNOWS else ": "
    return f"the vehicle then braked by itself{separator}{braking}"


def explain_stop(
    cause: StopCause,
    inbox: Inbox,
    faults: Sequence[str],
    bus_fault: StopCause = StopCause.NONE,
    failed: Sequence[Margin] = (),
    braking: str = "",
) -> str:
    """Why the car was stopped, with what to check.

    Args:
        cause: of the stop.
        inbox: what was received.
        faults: of the scenario or of --faults, that have acted.
        bus_fault: that was found by the end of the stop.
        failed: checks that were beyond their limit when the stop began.
        braking: why the vehicle brakes by itself; empty if it does not.
    """
    text = cause.value
    if failed:
        text += f" ({'; '.join(each.text for each in failed)})"
    if bus_fault not in (cause, StopCause.NONE):
        text += f", then: {bus_fault.value}"
    if StopCause.BUS_FAILED in (cause, bus_fault):
        return (
            f"{text}: expected frames or silence, found {inbox.last_failure}. Check the "
            f"interface and its connection, then start again."
        )
    if cause is StopCause.VEHICLE_BRAKING:
        text += f". {VEHICLE_KNOWS}" if braking in ("", VEHICLE_KNOWS) else f": {braking}"
    elif braking:
        text += f"; {explain_braking(braking)}"
    if cause in _MESSAGES:
        text += f". {inbox.explain_out_of_range(_MESSAGES[cause])}."
    if faults:
        return f"{text.rstrip('.')}. Faults of this drive: {', '.join(faults)}."
    remedy = remedy_of(cause)
    if cause in _OF_CHECKS or cause is StopCause.SOLVER_FAILED:
        remedy += f" {_RECORDED}"
    return f"{text}. {remedy}" if remedy else text
