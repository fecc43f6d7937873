"""The loop joins, drives, ends, and leaves a safe command behind whatever happens."""

import can
import pytest
from scripted_vehicle import CRUISING, VALID_NS, Rig

from rt_controller.bus.frames import Mission
from rt_controller.bus.outbox import ControllerOutbox
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode
from rt_controller.loop import SILENCE_TICKS, Ending, RunRecord, StopRequest, drive, join
from rt_controller.outcome import StopCause
from rt_controller.realtime.accounting import DeadlineAccount
from rt_controller.realtime.clock import Tick
from rt_controller.tracking import TrackingAccount


@pytest.fixture
def record(rig: Rig) -> RunRecord:
    return RunRecord(
        deadlines=DeadlineAccount(1000, 10_000_000),
        tracking=TrackingAccount(),
        outcome=rig.step.outcome,
    )


def try_to_join(rig: Rig) -> None:
    join(rig.controller_bus, rig.inbox, rig.clock, 0, 2_000_000_000, StopRequest())


def test_joining_waits_for_state_path_and_a_peer_of_the_same_catalogue(rig: Rig) -> None:
    rig.vehicle.also = lambda now_ns: (
        rig.vehicle.outbox.send_identity(None, now_ns) if now_ns > 10**9 else None
    )
    try_to_join(rig)
    assert rig.clock.now_ns() > 10**9
    assert rig.inbox.state is not None


def test_a_bus_with_another_controller_on_it_is_not_joined(rig: Rig) -> None:
    other = ControllerOutbox(rig.vehicle_bus)
    rig.vehicle.also = lambda now_ns: other.send_command(NEUTRAL_INPUT, Mode.STANDBY, 0, now_ns)
    with pytest.raises(BusError, match="another one"):
        try_to_join(rig)


def test_a_silent_bus_is_given_up_with_what_is_missing(rig: Rig) -> None:
    rig.vehicle.state = None
    with pytest.raises(BusError, match="STATE_A/B/C") as error:
        try_to_join(rig)
    assert "Start sim-bridge" in str(error.value)


def test_another_message_catalogue_is_refused(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rt_controller.bus.outbox.dbc_hash", lambda: 0xABCD)
    rig.vehicle.also = lambda now_ns: rig.vehicle.outbox.send_identity(None, now_ns)
    with pytest.raises(BusError, match="0000abcd") as error:
        try_to_join(rig)
    assert "expected" in str(error.value)
    assert rig.heard.command is None


def test_the_loop_ends_with_the_mission(rig: Rig, record: RunRecord) -> None:
    def end_after_a_second(now_ns: int) -> None:
        rig.vehicle.mission = Mission(now_ns < 10**9, False, 1, VALID_NS)

    rig.vehicle.also = end_after_a_second
    drive(rig.step, rig.clock, record, StopRequest())
    assert record.ending is Ending.MISSION_OVER
    assert record.outcome.mode is Mode.STANDBY
    assert 38 <= record.deadlines.ticks <= 42
    assert record.tracking.errors().ey_rms_m == pytest.approx(CRUISING.ey_m, abs=1e-3)


def test_a_safe_stop_without_a_sign_of_the_car_ends_after_a_while(
    rig: Rig, record: RunRecord
) -> None:
    def fall_silent(now_ns: int) -> None:
        if now_ns > 10**9:
            rig.vehicle.state = None

    rig.vehicle.also = fall_silent
    drive(rig.step, rig.clock, record, StopRequest())
    assert record.ending is Ending.SAFE_STOPPED
    assert record.deadlines.ticks >= SILENCE_TICKS


def test_a_safe_stop_ends_when_the_car_stands(rig: Rig, record: RunRecord) -> None:
    def brake_to_a_halt(now_ns: int) -> None:
        rig.vehicle.is_watchdog_braking = now_ns > 10**9
        if now_ns > 2 * 10**9:
            rig.vehicle.state = CRUISING._replace(vx_mps=0.0, ds_m=0.0)

    rig.vehicle.also = brake_to_a_halt
    drive(rig.step, rig.clock, record, StopRequest())
    assert record.ending is Ending.SAFE_STOPPED
    assert record.outcome.mode is Mode.SAFE_STOP


class LeaveAt(StopRequest):
    """A request that becomes urgent at a time on the rig's clock."""

    def __init__(self, rig: Rig, end_ns: int) -> None:
        super().__init__()
        self._rig = rig
        self._end_ns = end_ns

    @property
    def is_urgent(self) -> bool:
        return self._rig.clock.now_ns() >= self._end_ns


def slow_down(rig: Rig) -> None:
    """The scripted vehicle brakes when it is told to, at about 0.4 g."""
    command = rig.heard.command
    if command is not None and command.control.brake_n > 50.0 and rig.vehicle.state is not None:
        vx_mps = max(rig.vehicle.state.vx_mps - 0.1, 0.0)
        rig.vehicle.state = rig.vehicle.state._replace(vx_mps=vx_mps, ds_m=vx_mps * 0.025)


def test_a_request_to_stop_brings_the_car_to_rest_first(rig: Rig, record: RunRecord) -> None:
    request = StopRequest()

    def ask_after_a_second(now_ns: int) -> None:
        if now_ns == 10**9:
            request.ask()
        rig.heard.drain(rig.vehicle_bus, now_ns)
        slow_down(rig)

    rig.vehicle.also = ask_after_a_second
    drive(rig.step, rig.clock, record, request)
    assert record.ending is Ending.STOPPED
    assert record.outcome.cause is StopCause.STOP_REQUESTED
    assert rig.vehicle.state is not None
    assert rig.vehicle.state.vx_mps < 0.3
    assert rig.command.mode is Mode.SAFE_STOP


def test_a_second_request_leaves_at_once_with_a_safe_command(rig: Rig, record: RunRecord) -> None:
    request = StopRequest()
    rig.vehicle.also = lambda now_ns: request.ask() if now_ns >= 10**9 else None
    drive(rig.step, rig.clock, record, request)
    rig.heard.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert record.deadlines.ticks < 45
    assert rig.command.mode is Mode.SAFE_STOP
    assert rig.command.control.throttle == 0.0


def test_a_request_to_stop_a_controller_that_does_not_drive_is_granted_at_once(
    rig: Rig, record: RunRecord
) -> None:
    request = StopRequest()
    request.ask()
    drive(rig.step, rig.clock, record, request, stays=True)
    assert record.deadlines.ticks == 0


def test_the_end_of_the_time_stops_the_car_too(rig: Rig, record: RunRecord) -> None:
    def drain(now_ns: int) -> None:
        rig.heard.drain(rig.vehicle_bus, now_ns)
        slow_down(rig)

    rig.vehicle.also = drain
    drive(rig.step, rig.clock, record, StopRequest(), end_ns=10**9)
    assert record.ending is Ending.STOPPED
    assert rig.vehicle.state is not None
    assert rig.vehicle.state.vx_mps < 0.3


def test_even_a_loop_that_stays_leaves_a_bus_that_cannot_be_read(
    rig: Rig, record: RunRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise can.CanOperationError("unplugged")

    def unplug(now_ns: int) -> None:
        if now_ns > 10**9:
            monkeypatch.setattr(rig.controller_bus, "recv", fail)

    rig.vehicle.also = unplug
    drive(rig.step, rig.clock, record, StopRequest(), stays=True)
    assert record.ending is Ending.SAFE_STOPPED
    assert record.outcome.cause is StopCause.BUS_FAILED


def test_one_request_is_enough_after_a_safe_stop_that_stayed(rig: Rig, record: RunRecord) -> None:
    request = StopRequest()

    def stop_then_ask(now_ns: int) -> None:
        rig.vehicle.is_watchdog_braking = now_ns > 10**9
        if now_ns > 2 * 10**9:
            rig.vehicle.state = CRUISING._replace(vx_mps=0.0, ds_m=0.0)
        if now_ns == 3 * 10**9:
            request.ask()

    rig.vehicle.also = stop_then_ask
    drive(rig.step, rig.clock, record, request, stays=True)
    assert record.ending is Ending.SAFE_STOPPED
    assert 118 <= record.deadlines.ticks <= 122


def test_a_stall_is_a_missed_deadline(rig: Rig, record: RunRecord) -> None:
    class Stalling:
        """The rig's clock, with half a second lost before the tenth tick."""

        ticks = 0

        def __getattr__(self, name: str) -> object:
            return getattr(rig.clock, name)

        def wait(self) -> Tick:
            self.ticks += 1
            return rig.clock.wait()._replace(skipped=20 if self.ticks == 10 else 0)

    drive(rig.step, Stalling(), record, LeaveAt(rig, 5 * 10**8))
    assert record.deadlines.skipped_ticks == 20
    assert record.deadlines.deadline_misses == 1
    assert record.deadlines.percentiles("wake_us").max == pytest.approx(500_000.0)


def test_an_error_in_a_tick_leaves_a_safe_command_before_it_is_raised(
    rig: Rig, record: RunRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr(rig.mpc, "plan", fail)
    with pytest.raises(ZeroDivisionError):
        drive(rig.step, rig.clock, record, StopRequest())
    rig.heard.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert rig.command.mode is Mode.SAFE_STOP
    assert rig.command.control.throttle == 0.0


def test_with_stay_the_loop_outlives_a_mission(rig: Rig, record: RunRecord) -> None:
    def one_mission_after_another(now_ns: int) -> None:
        rig.vehicle.mission = Mission(now_ns % 10**9 < 5 * 10**8, False, 1, VALID_NS)

    rig.vehicle.also = one_mission_after_another
    drive(rig.step, rig.clock, record, LeaveAt(rig, 4 * 10**9), stays=True)
    assert record.deadlines.ticks > 155


def test_deadlines_are_judged_on_the_loops_own_clock(rig: Rig, record: RunRecord) -> None:
    record.deadlines = DeadlineAccount(1000, deadline_ns=1)
    drive(rig.step, rig.clock, record, LeaveAt(rig, 10**9))
    assert record.deadlines.ticks > 30
    assert record.deadlines.deadline_misses == 0
    assert record.deadlines.percentiles("step_us").p50 > 0.0
