"""The summary of a run: a verdict, its causes, and the same figures for people and for programs."""

import csv
import re
from math import radians
from types import SimpleNamespace
from typing import cast

import pytest
from made_frames import PATH, SAMPLE, can_frames
from rich.console import Console

from rt_controller.bus.condition import BusCondition
from rt_controller.bus.messages import REFERENCE, STATE, Node
from rt_controller.bus.receive import Inbox, ReceptionCounts
from rt_controller.contract.errors import OutputError
from rt_controller.contract.faults import FAULT_SENTENCES, Fault, StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import AT_REST, ControlInput, Mode, PathReference
from rt_controller.drive.scenario import LateralError
from rt_controller.drive.trace import DriveTrace
from rt_controller.loop import Ending, RunRecord
from rt_controller.model.validity import Excess
from rt_controller.realtime.scheduling import NO_GUARANTEES
from rt_controller.realtime.timing import DeadlineAccount, TickTimes
from rt_controller.report.table import print_table
from rt_controller.safety.checks import CHECKS, NOT_COMPUTED
from rt_controller.safety.tick import Estimate, Tick
from rt_controller.session import ControllerSession
from rt_controller.terminal.stop_message import (
    VEHICLE_KNOWS,
    begin_of_stop,
    explain_stop,
    failed_checks,
)
from rt_controller.terminal.summary import fault_sentences, to_json, to_table, verdict, write_ticks

LANE = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
TRUE = LateralError(0.1, 0.25)


def account(ticks: int) -> DeadlineAccount:
    found = DeadlineAccount(5, 10_000_000)
    for tick in range(ticks):
        found.record(TickTimes(*(100.0 * tick + k for k in range(len(TickTimes._fields)))), 0, 0)
    return found


def session_with(*results: Tick) -> ControllerSession:
    """After one tick with each of these results."""
    record = RunRecord(account(len(results)), DriveTrace(100))
    for tick, result in enumerate(results):
        record.add(result, tick * 25_000_000)
    session = SimpleNamespace(
        guarantees=NO_GUARANTEES,
        is_lockstep=False,
        inbox=SimpleNamespace(counts=ReceptionCounts(), condition=BusCondition()),
        planner=SimpleNamespace(name="lti"),
        model="lti",
        outbox=SimpleNamespace(sent=0, send_failures=0, queue_full=0),
        record=record,
        recorder=None,
        stop_values=(),
        checks=CHECKS,
    )
    return cast("ControllerSession", session)


def driving(ey_m: float = 0.0, speed_mps: float | None = 20.0, **others: object) -> Tick:
    state, estimate = AT_REST._replace(vx_mps=20.0, ey_m=ey_m), Estimate(speed_mps=speed_mps)
    fields = {"mode": Mode.NOMINAL, "state": state, "path": LANE, "estimate": estimate, **others}
    return Tick(**fields)


def text(session: ControllerSession, is_verbose: bool = False, car: LateralError = TRUE) -> str:
    console = Console(width=100)
    with console.capture() as shown:
        print_table(to_table(session, car, is_verbose=is_verbose), console)
    return "\n".join(line.strip() for line in shown.get().strip().splitlines())


WHEEL = Excess(1.05, 2, -2.1, 2.0)
OUTSIDE = driving(
    0.004, faults=Fault.OUTSIDE_TRAINING, estimate=Estimate(excess=Excess(8.1 / 7.4, 1, -8.1, 7.4))
)
STOP = driving(0.1, mode=Mode.SAFE_STOP, cause=StopCause.SOLVER_FAILED)


FAST = driving(0.034, faults=Fault.SPEED_NOT_FOLLOWED, path=LANE._replace(v_mps=27.2))
WITHOUT_STATE = driving(0.034, faults=Fault.STATE_IMPLAUSIBLE, speed_mps=None)
TURNED = driving(faults=Fault.OUTSIDE_TRAINING, estimate=Estimate(excess=WHEEL))
OVER = Ending.MISSION_OVER


@pytest.mark.parametrize(
    ("results", "ending", "braking", "expected"),
    [
        (
            [driving(0.034), driving(-0.01)],
            OVER,
            "",
            "within 25 cm; no step was late; .* 72 km/h, as.*",
        ),
        ([FAST], OVER, "", r"within 25 cm, but not its speed \(up to 7.2 m/s off\); no step .*"),
        ([OUTSIDE, TURNED] * 4, OVER, "", "within 25 cm; 0.2 s .* 8.1 of 7.4 m/s²; no .* late."),
        (
            [driving(1.26, speed_mps=0.0)],
            Ending.STOPPED,
            "it slid",
            "25 cm; .* request; .*: it slid.",
        ),
        ([WITHOUT_STATE], OVER, "", "within 25 cm; no step was late."),
        (
            [driving(), driving(), STOP],
            Ending.SAFE_STOPPED,
            "",
            "0.1 s: no input was planned: the QP was not solved, or the control law failed.",
        ),
        ([driving(speed_mps=10.0)], Ending.ENDED_AT_ONCE, "", "at 36 km/h: .* brakes the car."),
        ([Tick()], Ending.REFUSED, "", f"not taken over: {StopCause.NOT_ENGAGED.value}."),
        ([Tick()], Ending.STOPPED, "", "The car was not driven: stopped on request."),
        ([], Ending.STOPPED, "", "Nothing was driven: the drive ended before the first tick."),
    ],
)
def test_the_verdict_is_one_sentence_about_the_drive(results, ending, braking, expected):
    session = session_with(*results)
    session.record.ending = ending
    assert re.search(f"{expected}$", verdict(session.record, TRUE, braking))


def test_every_fault_that_occurred_is_explained_in_a_sentence():
    both = Fault.PREVIEW_IMPLAUSIBLE | Fault.DEADLINE_MISSED
    session = session_with(
        *(driving(faults=f) for f in (Fault(0), both, Fault.PREVIEW_IMPLAUSIBLE, Fault(0)))
    )
    figures = to_json(session)
    assert figures["ticks_by_fault"] == {"DEADLINE_MISSED": 1, "PREVIEW_IMPLAUSIBLE": 2}
    assert figures["first_s_by_fault"] == {"DEADLINE_MISSED": 0.025, "PREVIEW_IMPLAUSIBLE": 0.025}
    assert fault_sentences(session.record) == [
        "The commands were sent after their deadline. (DEADLINE_MISSED, 1 tick, at 0.025 s)",
        "The curvature ahead contradicted the state or the one before, and was not used. "
        "(PREVIEW_IMPLAUSIBLE, 2 ticks, first at 0.025 s)",
    ]
    assert set(FAULT_SENTENCES) == set(Fault)
    assert fault_sentences(session_with(driving()).record) == []


def test_a_regular_drive_is_shown_in_a_few_lines_and_with_verbose_in_all():
    session = session_with(driving(0.03), driving(-0.04))
    short = text(session, car=LateralError(0.036, 0.041))
    assert (
        short
        == """lti

lateral error  RMS 0.036 m, peak 0.041 m
heading error  RMS 0.00 deg, peak 0.00 deg
speed error    RMS 0.000 m/s, peak 0.000 m/s
ticks          2, 0 missed their deadline, 0 skipped
final mode     NOMINAL"""
    )
    names = ("control step", "step and reading ahead", "wake-up lateness", "QP solve")
    for name in (*names, "QP iterations", "frames", "real-time settings"):
        assert f"\n{name}  " in text(session, is_verbose=True)


def test_what_went_wrong_is_shown_in_both_forms():
    limited = driving(0.1, control=ControlInput(0.5, 0.0, -radians(40.0)))
    refused = driving(0.1, faults=Fault.STATE_IMPLAUSIBLE)
    session = session_with(*[limited] * 80, refused, STOP, driving(), STOP, STOP)
    session.inbox.condition.bus_off = 2
    session.inbox.counts.overflowed = 5
    session.outbox.queue_full = 7
    shown = " ".join(text(session).split())
    for expected in (
        "lateral error, as received RMS 0.099 m, peak 0.100 m",
        "lateral error RMS 0.100 m, peak 0.250 m",
        "inputs at their limit steering wheel (that of its speed) for 2.0 s",
        "bus 2 times bus-off, 5 frames lost in the receive buffer, 7 frames refused by a full "
        "queue; at last error-active",
        "safe stop from 2.075 s on (tick 83)",
    ):
        assert expected in shown
    figures = to_json(session, TRUE)
    expected_figures = {
        "at_limit_s": {"throttle": 0.0, "brake_n": 0.0, "steer_rad": 2.0},
        "errors_as_received": True,
        "car_ey_rms_m": 0.1,
        "car_ey_peak_m": 0.25,
        "stop_tick": 83,
        "stop_s": 2.075,
        "send_queue_full": 7,
    }
    assert {name: figures[name] for name in expected_figures} == expected_figures
    assert (figures["bus_condition"]["bus_off"], figures["bus_condition"]["state"]) == (2, "ACTIVE")
    assert figures["frames_received"]["overflowed"] == 5
    plain = to_json(session_with(driving()))
    assert plain["stop_tick"] is plain["car_ey_peak_m"] is None
    assert plain["errors_as_received"] is False


@pytest.mark.parametrize(("ticks", "first"), [(3, 0), (12, 7)])
def test_the_file_of_ticks_has_a_row_for_each_of_the_last_ones_oldest_first(tmp_path, ticks, first):
    write_ticks(tmp_path / "ticks.csv", account(ticks))
    with (tmp_path / "ticks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["tick"]) for row in rows] == list(range(first, ticks))
    assert list(rows[0]) == ["tick", *TickTimes._fields]
    assert [float(row["wake_us"]) for row in rows] == [100.0 * int(row["tick"]) for row in rows]
    with pytest.raises(OutputError, match="--ticks"):
        write_ticks(tmp_path / "gone" / "ticks.csv", account(3))


FAR = SAMPLE._replace(state=SAMPLE.state._replace(ey_m=30.1))


@pytest.mark.parametrize(
    ("cause", "message", "content", "expected"),
    [
        (StopCause.STATE_INVALID, STATE, FAR, "STATE_B: LateralError: expected a value of -30 to"),
        (StopCause.REFERENCE_INVALID, REFERENCE, PATH._replace(c0_m=-31.0), "REF_PATH: C0: expect"),
    ],
)
def test_a_safe_stop_names_the_signal_that_is_out_of_range(cause, message, content, expected):
    inbox = Inbox(Node.CONTROLLER)
    for frame in can_frames(message, content, 1):
        inbox.accept(frame, 0)
    assert explain_stop(cause, inbox, ()).startswith(f"{cause.value}. {expected}")


def stopped(cause: StopCause) -> ControllerSession:
    """After a safe stop in whose first tick the brake was 15 N beside its commands."""
    values = [NOT_COMPUTED] * len(Quantity)
    values[Quantity.BRAKE_N] = 15.0
    record = SimpleNamespace(stop_tick=184, stop_s=4.6, result=Tick(cause=cause))
    supervisor = SimpleNamespace(checks=CHECKS)
    session = SimpleNamespace(stop_values=values, supervisor=supervisor, record=record)
    return cast("ControllerSession", session)


def test_a_safe_stop_names_its_tick_and_the_check_with_value_and_limit():
    assert failed_checks(stopped(StopCause.MISSION_LOST)) == []
    session = stopped(StopCause.BRAKE_MISMATCH)
    assert begin_of_stop(session) == "safe stop at 4.600 s (tick 184)"
    failed = failed_checks(session)
    inbox = Inbox(Node.CONTROLLER)
    text = explain_stop(StopCause.BRAKE_MISMATCH, inbox, ("stuck",), failed=failed)
    assert "(brake feedback, 15 of 10 N). Faults of this drive: stuck." in text


BUS_FAILED = {"bus_fault": StopCause.BUS_FAILED}
OPEN = {"braking": "the throttle stays open", "faults": ("stuck from 2 s",)}


@pytest.mark.parametrize(
    ("cause", "options", "expected"),
    [
        (StopCause.VEHICLE_BRAKING, {}, rf"\. {re.escape(VEHICLE_KNOWS)}"),
        (StopCause.VEHICLE_BRAKING, {"braking": VEHICLE_KNOWS}, rf"\. {re.escape(VEHICLE_KNOWS)}"),
        (StopCause.VEHICLE_BRAKING, OPEN, ": the throttle stays open. Faults .*: stuck from 2 s."),
        (StopCause.STATE_OLD, {"braking": "it slid"}, "; the vehicle .* by itself: it slid. "),
        (StopCause.STATE_LOST, BUS_FAILED, ", then: .* found WebsocketClosed: 1006. Check the int"),
    ],
)
def test_a_stop_says_its_cause_and_what_else_happened(cause, options, expected):
    inbox = Inbox(Node.CONTROLLER)
    inbox.last_failure = "WebsocketClosed: 1006"
    text = explain_stop(cause, inbox, **{"faults": (), **options})
    assert re.match(cause.value + expected, text)
