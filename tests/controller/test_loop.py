"""How the loop ends, and what it sends and records until then."""

import pytest
from scripted_vehicle import CRUISING, STANDBY_TICKS, STANDING, VALID_NS, Rig, fail

from rt_controller.bus.messages import COMMAND, Mission
from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.drive.trace import DriveTrace
from rt_controller.loop import (
    MAX_TICKS_WITHOUT_STATE,
    RELEASE_TICKS,
    Ending,
    RunRecord,
    StopRequest,
    run_loop,
)
from rt_controller.realtime.timing import DeadlineAccount

SECOND_NS = 10**9
TICKS_PER_S = SECOND_NS // PERIOD_NS


@pytest.fixture
def record() -> RunRecord:
    return RunRecord(DeadlineAccount(1000, 10_000_000), DriveTrace(1000))


class UrgentAt(StopRequest):
    """A request that becomes urgent at a time on the rig's clock."""

    def __init__(self, rig: Rig, end_ns: int) -> None:
        super().__init__()
        self._rig = rig
        self._end_ns = end_ns

    @property
    def is_urgent(self) -> bool:
        return self._rig.clock.now_ns() >= self._end_ns


def brake_as_commanded(rig: Rig) -> None:
    """The scripted vehicle brakes in proportion to the command: about 0.4 g at 75 N."""
    rig.received.drain(rig.vehicle_bus, rig.clock.now_ns())
    command, state = rig.received.newest(COMMAND), rig.vehicle.state
    if command is not None and state is not None:
        deceleration_mps2 = 4.0 * command.content.control.brake_n / 75.0
        vx_mps = max(state.vx_mps - deceleration_mps2 * PERIOD_S, 0.0)
        rig.vehicle.state = state._replace(vx_mps=vx_mps, ds_m=vx_mps * PERIOD_S)


def test_the_loop_ends_with_the_mission(rig, record):
    def end_after_a_second(now_ns):
        rig.vehicle.mission = Mission(now_ns < SECOND_NS, False, 1, VALID_NS)

    rig.vehicle.after_sending = end_after_a_second
    run_loop(rig.step, rig.clock, record, StopRequest())
    assert record.ending is Ending.MISSION_OVER
    assert record.result.mode is Mode.STANDBY
    assert record.deadlines.ticks == pytest.approx(TICKS_PER_S + RELEASE_TICKS, abs=2)
    assert record.trace.errors().ey_rms_m == pytest.approx(CRUISING.ey_m, abs=1e-3)


def test_one_request_or_two_bring_the_car_to_rest_first(rig, record):
    request = StopRequest()

    def request_twice(now_ns):
        if now_ns in (SECOND_NS, SECOND_NS + 4 * PERIOD_NS):
            request.request()
        brake_as_commanded(rig)

    rig.vehicle.after_sending = request_twice
    run_loop(rig.step, rig.clock, record, request)
    assert request.times == 2
    assert record.ending is Ending.STOPPED
    assert record.result.cause is StopCause.STOP_REQUESTED
    assert rig.command.content.mode is Mode.SAFE_STOP
    assert rig.vehicle.state.vx_mps < 0.3


def test_a_third_request_ends_the_loop_at_once_with_a_safe_command(rig, record):
    request = StopRequest()
    rig.vehicle.after_sending = lambda now_ns: request.request() if now_ns >= SECOND_NS else None
    run_loop(rig.step, rig.clock, record, request)
    rig.received.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert record.ending is Ending.ENDED_AT_ONCE
    assert record.deadlines.ticks < TICKS_PER_S + 5
    assert rig.command.content.mode is Mode.SAFE_STOP
    assert rig.command.content.control.throttle == 0.0


def test_a_request_to_stop_in_standby_ends_the_loop_at_once(rig, record):
    request = StopRequest()
    request.request()
    run_loop(rig.step, rig.clock, record, request, waits_for_missions=True)
    assert record.deadlines.ticks == 0


@pytest.mark.parametrize("is_requested", [False, True])
def test_a_bus_that_fails_in_a_safe_stop_ends_a_loop_that_stays(
    rig, record, monkeypatch, is_requested
):
    request = StopRequest()

    def unplug_later(now_ns):
        rig.vehicle.is_watchdog_braking = now_ns > SECOND_NS and not is_requested
        if now_ns == SECOND_NS and is_requested:
            request.request()
        if now_ns > SECOND_NS + 10 * PERIOD_NS:
            monkeypatch.setattr(rig.controller_bus, "recv", fail)

    rig.vehicle.after_sending = unplug_later
    run_loop(rig.step, rig.clock, record, request, waits_for_missions=True)
    first = StopCause.STOP_REQUESTED if is_requested else StopCause.VEHICLE_BRAKING
    assert record.result.cause is first
    assert record.result.bus_fault is StopCause.BUS_FAILED


def test_a_safe_stop_that_was_reset_does_not_decide_how_a_later_run_ends(rig, record):
    request = StopRequest()

    def stop_reset_drive_request(now_ns):
        second = now_ns // SECOND_NS
        rig.vehicle.is_watchdog_braking = second == 1
        rig.vehicle.state = STANDING if second >= 2 else CRUISING
        rig.vehicle.mission = Mission(second < 5, second == 3, 1, VALID_NS)
        if now_ns == 6 * SECOND_NS:
            assert record.result.mode is Mode.STANDBY
            request.request()

    rig.vehicle.after_sending = stop_reset_drive_request
    run_loop(rig.step, rig.clock, record, request, waits_for_missions=True)
    assert record.ending is Ending.STOPPED
    assert record.deadlines.ticks == pytest.approx(6 * TICKS_PER_S - STANDBY_TICKS, abs=2)


def test_an_error_in_a_tick_is_raised_after_a_safe_command_was_sent(rig, record, monkeypatch):
    def divide_by_zero(*_):
        raise ZeroDivisionError("planted")

    monkeypatch.setattr(rig.mpc, "plan", divide_by_zero)
    with pytest.raises(ZeroDivisionError):
        run_loop(rig.step, rig.clock, record, StopRequest())
    rig.received.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert rig.command.content.mode is Mode.SAFE_STOP
    assert rig.command.content.control.throttle == 0.0


def test_skipped_periods_count_as_a_missed_deadline(rig, record):
    class Stalling:
        """The rig's clock, with 20 periods lost before the tenth tick."""

        ticks = 0

        def __getattr__(self, name):
            return getattr(rig.clock, name)

        def wait(self):
            self.ticks += 1
            return rig.clock.wait()._replace(skipped=20 if self.ticks == 10 else 0)

    run_loop(rig.step, Stalling(), record, UrgentAt(rig, SECOND_NS // 2))
    assert record.deadlines.skipped_ticks == 20
    assert record.deadlines.deadline_misses == 1
    assert record.deadlines.percentiles("wake_us").max == pytest.approx(20 * PERIOD_NS / 1e3)


@pytest.mark.parametrize("loses_state", [True, False])
def test_a_safe_stop_ends_when_the_car_stands_or_no_state_was_received_for_long(
    rig, record, loses_state
):
    def stop(now_ns):
        rig.vehicle.is_watchdog_braking = now_ns > SECOND_NS
        if now_ns > 2 * SECOND_NS:
            rig.vehicle.state = None if loses_state else STANDING

    rig.vehicle.after_sending = stop
    run_loop(rig.step, rig.clock, record, StopRequest())
    assert record.ending is Ending.SAFE_STOPPED
    assert record.result.mode is Mode.SAFE_STOP
    assert (record.deadlines.ticks >= MAX_TICKS_WITHOUT_STATE) is loses_state
