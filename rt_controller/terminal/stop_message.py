"""Words for what went wrong in a drive: the message of a safe stop, a sentence for each fault."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rt_controller.bus.messages import REFERENCE, STATE, Message
from rt_controller.bus.receive import Inbox
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.loop import Ending
from rt_controller.safety.checks import Check
from rt_controller.session import ControllerSession

VEHICLE_KNOWS = "The vehicle's program (sim-bridge, or the gateway) names the cause at its end"
LONGEST_PLAN_MS = 10.0
"""a planner that takes longer in half of its periods is too slow for them"""
TIME_CAUSES = {
    StopCause.NONE,
    StopCause.STATE_LOST,
    StopCause.REFERENCE_LOST,
    StopCause.MISSION_LOST,
    StopCause.COMMANDS_UNANSWERED,
    StopCause.VEHICLE_BRAKING,
}
"""what a machine without time for a drive may cause by itself"""
_RECORDED = "rt-controller explain shows more of a recorded drive."
_MESSAGES: dict[StopCause, Message[Any]] = {
    StopCause.STATE_INVALID: STATE,
    StopCause.REFERENCE_INVALID: REFERENCE,
}


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
    return [Margin(c.name, values[c.quantity], c.threshold, c.quantity.unit) for c in checks]


def exceeded(margins: Iterable[Margin]) -> list[Margin]:
    """Those whose value is beyond its limit; some checks act only after several ticks in a row."""
    return [each for each in margins if each.margin < 0.0]


def failed_checks(session: ControllerSession) -> list[Margin]:
    """The checks beyond their limit in the tick in which the safe stop began; empty if another
    fault was its cause."""
    if not session.stop_values or not session.record.result.cause.is_of_checks:
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


def explain_busy(
    session: ControllerSession, allowed_ticks: int, is_braking: bool, other: str = ""
) -> str:
    """That this machine or the controller was too slow for real time, and how the drive ended.

    Empty if no more than so many ticks were late, left out, or without a new state: the simulated
    car may be late too. `is_braking`: the vehicle brakes by itself. `other`: how the drive ended,
    if its cause is not one of `TIME_CAUSES`; it is said first.
    """
    record = session.record
    deadlines, without = record.deadlines, record.ticks_by_fault[Fault.STATE_STALE]
    late = deadlines.deadline_misses + deadlines.skipped_ticks
    if late + without <= allowed_ticks:
        return ""
    begin, end = "", ""
    if other:
        begin = f"{other.rstrip('.')}. Besides, "
    elif record.ending is Ending.SAFE_STOPPED:
        end = f", so the car was stopped at {record.stop_s or 0.0:.1f} s"
    elif is_braking:
        end = ", so the vehicle braked by itself"
    plan_ms, who = 1e-3 * deadlines.percentiles("qp_us").p50, "this machine was too busy"
    if plan_ms > LONGEST_PLAN_MS:
        who = f"{session.planner.name} takes {plan_ms:.0f} ms for an input, too long"
    return (
        f"{begin}{who} to drive in real time ({late} of {deadlines.ticks} control steps late or "
        f"left out, {without} without a new state){end}; --pace lockstep drives independently of "
        f"the machine."
    )


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
    remedy = cause.remedy
    if cause.is_of_checks or cause is StopCause.SOLVER_FAILED:
        remedy += f" {_RECORDED}"
    return f"{text}. {remedy}" if remedy else text
