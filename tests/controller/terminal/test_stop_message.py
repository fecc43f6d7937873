"""What the message of a safe stop says about its cause."""

from types import SimpleNamespace
from typing import Any, cast

import pytest
from made_frames import PATH, SAMPLE, can_frames

from rt_controller.bus.messages import REFERENCE, STATE, Message, Node
from rt_controller.bus.receive import Inbox
from rt_controller.contract.faults import StopCause
from rt_controller.safety.checks import CHECKS, NOT_COMPUTED, Quantity
from rt_controller.safety.tick import Tick
from rt_controller.session import ControllerSession
from rt_controller.terminal.stop_message import (
    VEHICLE_KNOWS,
    begin_of_stop,
    explain_stop,
    failed_checks,
    remedy_of,
)

WITHOUT_REMEDY = {
    *(StopCause.NONE, StopCause.STOP_REQUESTED),
    *(StopCause.STATE_INVALID, StopCause.REFERENCE_INVALID),  # names the values
    StopCause.VEHICLE_BRAKING,  # names the cause, or where it is named
    StopCause.NOT_ENGAGED,  # is no safe stop
}


@pytest.mark.parametrize("cause", sorted(set(StopCause) - WITHOUT_REMEDY))
def test_the_message_of_every_cause_ends_with_what_to_do(cause: StopCause) -> None:
    failed = failed_checks(stopped(cause))
    text = explain_stop(cause, Inbox(Node.CONTROLLER), (), failed=failed)
    text = text.removesuffix(" rt-controller explain shows more of a recorded drive.")
    remedy = text.split(". ")[-1]
    assert StopCause.BUS_FAILED is cause or text.endswith(remedy_of(cause))
    assert remedy.split()[0] in {"Check", "Stop", "Start", "Bring"}
    assert remedy.endswith(".")


def test_a_bus_that_fails_after_the_stop_began_is_named_with_its_failure() -> None:
    inbox = Inbox(Node.CONTROLLER)
    inbox.last_failure = "WebsocketClosed: 1006"
    assert explain_stop(StopCause.STATE_LOST, inbox, (), StopCause.BUS_FAILED) == (
        "no new vehicle state arrived in time, then: the bus cannot be read: expected frames or "
        "silence, found WebsocketClosed: 1006. Check the interface and its connection, then start "
        "again."
    )


@pytest.mark.parametrize(
    ("braking", "faults", "expected"),
    [
        ("", (), f". {VEHICLE_KNOWS}"),
        (VEHICLE_KNOWS, (), f". {VEHICLE_KNOWS}"),
        ("the throttle stays open", (), ": the throttle stays open"),
        (
            "the throttle stays open",
            ("stuck from 2 s",),
            ": the throttle stays open. Faults of this drive: stuck from 2 s.",
        ),
    ],
)
def test_a_stop_with_the_vehicle_says_why_the_vehicle_brakes_or_who_knows_it(
    braking: str, faults: tuple[str, ...], expected: str
) -> None:
    cause = StopCause.VEHICLE_BRAKING
    text = explain_stop(cause, Inbox(Node.CONTROLLER), faults, braking=braking)
    assert text == cause.value + expected


def test_a_stop_for_another_cause_says_that_the_vehicle_then_braked_by_itself() -> None:
    text = explain_stop(StopCause.STATE_OLD, Inbox(Node.CONTROLLER), (), braking="it slid")
    assert f"{StopCause.STATE_OLD.value}; the vehicle then braked by itself: it slid" in text


@pytest.mark.parametrize(
    ("cause", "message", "content", "expected"),
    [
        (
            StopCause.STATE_INVALID,
            *(STATE, SAMPLE._replace(state=SAMPLE.state._replace(ey_m=30.1))),
            "STATE_B: LateralError: expected a value of -30 to 30 m, found none or one beyond it",
        ),
        (
            StopCause.REFERENCE_INVALID,
            *(REFERENCE, PATH._replace(c0_m=-31.0)),
            "REF_PATH: C0: expected a value of -30 to 30 m, found none or one beyond it",
        ),
    ],
)
def test_a_safe_stop_names_the_signal_that_is_out_of_range(
    cause: StopCause, message: Message[Any], content: Any, expected: str
) -> None:
    inbox = Inbox(Node.CONTROLLER)
    for frame in can_frames(message, content, 1):
        inbox.accept(frame, 0)
    assert explain_stop(cause, inbox, ()) == f"{cause.value}. {expected}."


def stopped(cause: StopCause) -> ControllerSession:
    """After a safe stop in whose first tick the brake was 15 N beside its commands."""
    values = [NOT_COMPUTED] * len(Quantity)
    values[Quantity.BRAKE_N] = 15.0
    record = SimpleNamespace(stop_tick=184, stop_s=4.6, result=Tick(cause=cause))
    session = SimpleNamespace(stop_values=values, checks=CHECKS, record=record)
    return cast("ControllerSession", session)


def test_a_safe_stop_names_its_tick_and_the_check_with_value_and_limit() -> None:
    session = stopped(StopCause.BRAKE_MISMATCH)
    assert begin_of_stop(session) == "safe stop at 4.600 s (tick 184)"
    failed = failed_checks(session)
    assert explain_stop(
        StopCause.BRAKE_MISMATCH, Inbox(Node.CONTROLLER), ("stuck",), failed=failed
    ) == (
        "the brake does not follow the commands (brake feedback, 15 of 10 N). Faults of this "
        "drive: stuck."
    )


def test_a_safe_stop_for_another_reason_names_no_check() -> None:
    assert failed_checks(stopped(StopCause.MISSION_LOST)) == []
