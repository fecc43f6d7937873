"""The summary of a run: the same figures for people and for programs."""

from math import radians
from types import SimpleNamespace
from typing import cast

from rich.console import Console

from rt_controller.bus.catalogue import Fault
from rt_controller.bus.inbox import ReceptionCounts
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.drive_trace import DriveTrace
from rt_controller.loop import RunRecord
from rt_controller.realtime.accounting import DeadlineAccount
from rt_controller.realtime.scheduling import NO_GUARANTEES
from rt_controller.report.table import print_table
from rt_controller.session import ControllerSession
from rt_controller.step import StepResult
from rt_controller.terminal.options import RunOptions
from rt_controller.terminal.summary import driven_to_json, to_json, to_table


def session_with(*faults: Fault) -> ControllerSession:
    """After one tick with each of these faults."""
    record = RunRecord(DeadlineAccount(10, 1), DriveTrace(10))
    for tick, fault in enumerate(faults):
        record.add(StepResult(faults=fault), tick)
    session = SimpleNamespace(
        guarantees=NO_GUARANTEES,
        inbox=SimpleNamespace(counts=ReceptionCounts()),
        model="lti",
        outbox=SimpleNamespace(sent=0, send_failures=0),
        record=record,
        recorder=None,
    )
    return cast("ControllerSession", session)


def text(session: ControllerSession) -> str:
    console = Console(width=100)
    with console.capture() as shown:
        print_table(to_table(session), console)
    return shown.get()


def test_ticks_with_faults_are_in_both_forms() -> None:
    both = Fault.PREVIEW_IMPLAUSIBLE | Fault.DEADLINE_MISSED
    session = session_with(both, Fault.PREVIEW_IMPLAUSIBLE, Fault(0))
    assert to_json(session)["ticks_by_fault"] == {"DEADLINE_MISSED": 1, "PREVIEW_IMPLAUSIBLE": 2}
    assert "1 DEADLINE_MISSED, 2 PREVIEW_IMPLAUSIBLE" in text(session)


def test_the_time_of_an_input_at_its_limit_is_in_both_forms() -> None:
    session = session_with()
    assert "inputs at their limit" not in text(session)
    for _ in range(80):
        result = StepResult(control=ControlInput(0.5, 0.0, -radians(40.0)), mode=Mode.NOMINAL)
        session.record.add(result, 0)
    assert to_json(session)["at_limit_s"] == {"throttle": 0.0, "brake_n": 0.0, "steer_rad": 2.0}
    assert "inputs at their limit: steering wheel (40 deg) for 2.0 s" in " ".join(
        text(session).replace("limit  ", "limit: ").split()
    )


def test_on_a_bus_to_another_vehicle_only_the_own_end_is_known() -> None:
    driven = driven_to_json(RunOptions(bus="local", channel="a"), None)
    assert (driven["bus"], driven["channel"], driven["pace"]) == ("local", "a", "realtime")
    assert {driven[name] for name in ("scenario", "plant", "car", "friction")} == {None}


def test_a_run_without_faults_lists_none() -> None:
    session = session_with(Fault(0))
    assert to_json(session)["ticks_by_fault"] == {}
    assert "ticks with faults" not in text(session)
