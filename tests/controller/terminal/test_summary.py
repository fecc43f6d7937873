"""The summary of a run: the same figures for people and for programs."""

from math import radians
from types import SimpleNamespace
from typing import cast

import pytest
from rich.console import Console

from rt_controller.bus.condition import BusCondition
from rt_controller.bus.messages import Fault
from rt_controller.bus.receive import ReceptionCounts
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.drive.car_figures import LateralError
from rt_controller.drive.trace import DriveTrace
from rt_controller.loop import Ending, RunRecord
from rt_controller.realtime.scheduling import NO_GUARANTEES
from rt_controller.realtime.timing import DeadlineAccount
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
        inbox=SimpleNamespace(counts=ReceptionCounts(), condition=BusCondition()),
        model="lti",
        outbox=SimpleNamespace(sent=0, send_failures=0, queue_full=0),
        record=record,
        recorder=None,
        stop_values=(),
    )
    return cast("ControllerSession", session)


def text(session: ControllerSession, car: LateralError | None = None) -> str:
    console = Console(width=100)
    with console.capture() as shown:
        print_table(to_table(session, car), console)
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
    limited = "steering wheel (that of its speed) for 2.0 s"
    assert f"inputs at their limit: {limited}" in " ".join(
        text(session).replace("limit  ", "limit: ").split()
    )


def test_on_a_bus_to_another_vehicle_only_the_own_end_is_known() -> None:
    driven = driven_to_json(RunOptions(bus="local", channel="a"), None)
    assert (driven["bus"], driven["channel"], driven["pace"]) == ("local", "a", "realtime")
    assert {driven[name] for name in ("scenario", "plant", "car", "friction")} == {None}


@pytest.mark.parametrize(
    ("ending", "speed_mps", "expected"),
    [
        (Ending.MISSION_OVER, 100.0 / 3.6, "; the car was released at 100 km/h"),
        (Ending.MISSION_OVER, 0.2, ""),
        (Ending.MISSION_OVER, None, ""),
        (Ending.SAFE_STOPPED, 100.0 / 3.6, ""),
    ],
)
def test_a_mission_that_ends_with_a_moving_car_says_its_speed(
    ending: Ending, speed_mps: float | None, expected: str
) -> None:
    session = session_with(Fault(0))
    session.record.ending = ending
    session.record.result = StepResult(speed_mps=speed_mps)
    assert to_table(session).title == f"lti: {ending.value}{expected}"


def test_errors_with_refused_states_are_marked_and_the_true_one_is_beside_them() -> None:
    car = LateralError(0.1, 0.25)
    plain, marked = session_with(Fault(0)), session_with(Fault.STATE_IMPLAUSIBLE)
    assert not to_json(plain, car)["errors_as_received"]
    assert "as received" not in text(plain)
    figures = to_json(marked, car)
    assert figures["errors_as_received"]
    assert (figures["car_ey_rms_m"], figures["car_ey_peak_m"]) == car
    assert to_json(marked)["car_ey_peak_m"] is None
    shown = text(marked, car)
    assert "lateral error, as received" in shown
    assert "RMS 0.100 m, peak 0.250 m" in shown


def test_the_begin_of_the_last_safe_stop_is_in_both_forms() -> None:
    session = session_with()
    assert to_json(session)["stop_tick"] is None
    modes = [Mode.NOMINAL, Mode.SAFE_STOP, Mode.STANDBY, Mode.SAFE_STOP, Mode.SAFE_STOP]
    for tick, mode in enumerate(modes):
        session.record.add(StepResult(mode=mode), tick * 25_000_000)
    figures = to_json(session)
    assert (figures["stop_tick"], figures["stop_s"]) == (3, 0.075)
    assert "from 0.075 s on (tick 3)" in text(session)


def test_a_run_without_faults_lists_none() -> None:
    session = session_with(Fault(0))
    assert to_json(session)["ticks_by_fault"] == {}
    assert "ticks with faults" not in text(session)


def test_what_the_bus_reported_of_itself_is_in_both_forms() -> None:
    session = session_with()
    assert "bus-off" not in text(session)
    session.inbox.condition.bus_off = 2
    session.inbox.counts.overflowed = 5
    session.outbox.queue_full = 7
    figures = to_json(session)
    assert figures["bus_condition"]["bus_off"] == 2
    assert figures["bus_condition"]["state"] == "ACTIVE"
    assert figures["send_queue_full"] == 7
    assert figures["frames_received"]["overflowed"] == 5
    shown = " ".join(text(session).split())
    assert "2 times bus-off, 5 frames lost in the receive buffer" in shown
    assert "7 frames refused by a full queue; at last error-active" in shown
