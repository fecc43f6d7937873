"""A silent or stale controller ends in a braked car."""

import pytest

from rt_controller.bus.contents import Command
from rt_controller.bus.end_to_end.assembly import Received
from rt_controller.contract.grip import FULL_BRAKE_N, MOST_BRAKE_N
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.gateway.braking_cause import BrakingCause
from rt_controller.gateway.vehicle_envelope import FARTHEST_OFF_PATH_M, STANDING, OwnMotion
from sim_bridge.watchdog import ORDERLY_MPS, ORDERLY_TICKS, ActuatorWatchdog

MOVING = OwnMotion(20.0, 0.0, is_mission_on=True)
STEER_RAD = 0.1


def command(arrival_ns: int, counter: int = 0, mode: Mode = Mode.NOMINAL) -> Received[Command]:
    content = Command(ControlInput(0.4, 0.0, 0.3), mode)
    return Received(content, counter, arrival_ns)


def test_a_fresh_command_reaches_the_actuators_unchanged() -> None:
    watchdog = ActuatorWatchdog()
    assert watchdog.apply(command(0), 0, 0, MOVING, STEER_RAD) == ControlInput(0.4, 0.0, 0.3)
    assert not watchdog.is_braking


def test_a_command_stands_until_it_is_100_ms_old_and_no_longer() -> None:
    watchdog = ActuatorWatchdog()
    for k in range(4):
        assert watchdog.apply(command(0), k * PERIOD_NS, 0, MOVING, STEER_RAD).throttle == 0.4
    applied = watchdog.apply(command(0), 4 * PERIOD_NS, 0, MOVING, STEER_RAD)
    assert watchdog.is_braking
    assert applied.throttle == 0.0
    assert applied.brake_n > 0.0


def test_a_controller_that_comes_back_does_not_get_the_braking_car_back() -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0), 0, 0, MOVING, STEER_RAD)
    watchdog.apply(command(0), 200_000_000, 0, MOVING, STEER_RAD)
    applied = watchdog.apply(command(225_000_000), 225_000_000, 0, MOVING, STEER_RAD)
    assert watchdog.is_braking
    assert applied.throttle == 0.0


def test_the_brake_ramps_to_its_end_while_the_wheel_follows_the_path() -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0), 0, 0, MOVING, STEER_RAD)
    brakes, wheels = [], []
    angles = [0.01 * k for k in range(56)]
    for k, angle_rad in enumerate(angles, start=4):
        applied = watchdog.apply(None, k * PERIOD_NS, 0, MOVING, angle_rad)
        brakes.append(applied.brake_n)
        wheels.append(applied.steer_rad)
    assert brakes == sorted(brakes)
    assert brakes[-1] == MOST_BRAKE_N
    assert wheels == angles


@pytest.mark.parametrize("jitter_ns", [-2_000_000, -20_000, 20_000, 2_000_000])
def test_the_limit_does_not_depend_on_the_jitter_of_a_tick(jitter_ns: int) -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(100_000), 3 * PERIOD_NS + jitter_ns, 0, MOVING, STEER_RAD)
    assert not watchdog.is_braking
    watchdog.apply(command(100_000), 4 * PERIOD_NS + jitter_ns, 0, MOVING, STEER_RAD)
    assert watchdog.is_braking


def test_a_command_that_dawdled_on_the_bus_is_as_old_as_the_state_it_answers() -> None:
    watchdog = ActuatorWatchdog()
    for k in range(20):
        # A fresh arrival every period, and every one of them three periods behind.
        late = command(k * PERIOD_NS, counter=(k - 3) % 128)
        watchdog.apply(late, k * PERIOD_NS, k % 128, MOVING, STEER_RAD)
    assert not watchdog.is_braking
    watchdog.apply(command(20 * PERIOD_NS, counter=16), 20 * PERIOD_NS, 20, MOVING, STEER_RAD)
    assert watchdog.is_braking


def test_a_command_that_counted_ahead_is_not_old() -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0, counter=1), 0, 0, MOVING, STEER_RAD)
    assert not watchdog.is_braking


@pytest.mark.parametrize("lag", range(128))
def test_every_lag_is_braked_for_but_those_of_a_command_ahead(lag: int) -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0, counter=0), 0, lag, MOVING, STEER_RAD)
    assert watchdog.is_braking is (4 <= lag < 124)


@pytest.mark.parametrize(
    ("safe_stops", "speed_mps", "has_ended"),
    [
        (0, 0.0, False),
        (1, 80.0 / 3.6, False),  # a crash, or a third Ctrl-C, at speed
        (1, ORDERLY_MPS - 0.1, False),  # a crash at low speed
        (ORDERLY_TICKS, ORDERLY_MPS + 0.1, False),
        (ORDERLY_TICKS, ORDERLY_MPS - 0.1, True),
    ],
)
def test_silence_is_the_end_of_a_drive_after_a_long_safe_stop_and_at_low_speed(
    safe_stops: int, speed_mps: float, has_ended: bool
) -> None:
    watchdog = ActuatorWatchdog()
    motion = MOVING._replace(speed_mps=speed_mps)
    modes = 10 * [Mode.NOMINAL] + safe_stops * [Mode.SAFE_STOP]
    for k, mode in enumerate(modes):
        last = command(k * PERIOD_NS, k % 128, mode)
        watchdog.apply(last, k * PERIOD_NS, k % 128, motion, STEER_RAD)
    for k in range(len(modes), len(modes) + 4):
        assert not watchdog.has_controller_ended
        watchdog.apply(last, k * PERIOD_NS, k % 128, motion, STEER_RAD)
    assert watchdog.is_braking
    assert watchdog.has_controller_ended is has_ended
    restarted = command(10**10, 0, Mode.SAFE_STOP)
    watchdog.apply(restarted, 10**10, 0, STANDING, 0.0)
    assert watchdog.has_controller_ended is has_ended


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("speed_mps", [0.5, 20.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_safe_stop_that_leaves_the_path_is_driven_by_the_vehicle_at_once(
    mode: Mode, speed_mps: float, side: float, share: float
) -> None:
    watchdog = ActuatorWatchdog()
    motion = OwnMotion(speed_mps, side * share * FARTHEST_OFF_PATH_M, is_mission_on=True)
    applied = watchdog.apply(command(0, mode=mode), 0, 0, motion, STEER_RAD)
    is_left = mode is Mode.SAFE_STOP and speed_mps > 1.0 and share > 1.0
    assert watchdog.is_braking is is_left
    assert applied.steer_rad == (STEER_RAD if is_left else 0.3)


@pytest.mark.parametrize(("nearest_m", "is_braked"), [(0.49, True), (0.5, False), (0.51, False)])
def test_a_car_on_the_way_to_its_path_has_not_left_it(nearest_m: float, is_braked: bool) -> None:
    watchdog = ActuatorWatchdog()
    for k, off_m in enumerate((0.95, nearest_m, 0.95)):
        motion = OwnMotion(20.0, off_m, is_mission_on=True)
        watchdog.apply(command(k * PERIOD_NS, k), k * PERIOD_NS, k, motion, STEER_RAD)
    assert watchdog.is_braking is is_braked


@pytest.mark.parametrize(("is_wheel_stuck", "force_n"), [(True, FULL_BRAKE_N), (False, 60.0)])
def test_a_car_with_a_stuck_wheel_is_braked_as_hard_as_it_can_be(
    is_wheel_stuck: bool, force_n: float
) -> None:
    watchdog = ActuatorWatchdog()
    for k in range(20):
        fresh = command(k * PERIOD_NS, counter=k)
        applied = watchdog.apply(
            fresh, k * PERIOD_NS, k, MOVING, STEER_RAD, 60.0, True, is_wheel_stuck
        )
    assert watchdog.is_braking
    assert (applied.throttle, applied.brake_n) == (0.0, force_n)


@pytest.mark.parametrize("has_failed", [False, True])
def test_the_brake_ramps_at_150_n_per_s_to_75_n_or_at_500_to_150(has_failed: bool) -> None:
    watchdog = ActuatorWatchdog()
    forces = [
        watchdog.apply(None, 0, 0, MOVING, STEER_RAD, is_wheel_stuck=has_failed).brake_n
        for _ in range(25)
    ]
    step_n, most_n = (12.5, 150.0) if has_failed else (3.75, 75.0)
    assert forces == pytest.approx([min(step_n * (k + 1), most_n) for k in range(25)])


def test_the_brake_goes_on_from_the_force_of_the_last_command() -> None:
    watchdog = ActuatorWatchdog()
    braking = Command(ControlInput(0.0, 40.0, 0.0), Mode.NOMINAL)
    watchdog.apply(Received(braking, 0, 0), 0, 0, MOVING, STEER_RAD)
    assert watchdog.apply(None, 0, 0, MOVING, STEER_RAD).brake_n == pytest.approx(43.75)


def test_the_force_of_a_car_that_turns_is_not_exceeded() -> None:
    watchdog = ActuatorWatchdog()
    for _ in range(20):
        applied = watchdog.apply(None, 0, 0, MOVING, STEER_RAD, brake_n=60.0)
    assert applied.brake_n == 60.0


@pytest.mark.parametrize(
    ("age_ns", "is_braking"), [(75_000_000, False), (87_500_000, False), (87_500_001, True)]
)
def test_the_limit_of_the_age_lies_between_two_periods(age_ns: int, is_braking: bool) -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0), age_ns, 0, MOVING, STEER_RAD)
    assert watchdog.is_braking is is_braking


@pytest.mark.parametrize(
    ("safe_stops", "speed_mps", "has_ended"),
    [(4, 0.5, False), (5, 0.5, True), (5, 0.99, True), (5, 1.0, False)],
)
@pytest.mark.parametrize("interrupted", [0, 3])
def test_a_drive_ended_after_more_than_200_ms_of_safe_stop_below_1_m_per_s(
    safe_stops: int, speed_mps: float, has_ended: bool, interrupted: int
) -> None:
    watchdog = ActuatorWatchdog()
    motion = MOVING._replace(speed_mps=speed_mps)
    modes = [Mode.SAFE_STOP] * interrupted + [Mode.NOMINAL] * (interrupted > 0)
    modes += [Mode.SAFE_STOP] * safe_stops
    for k, mode in enumerate(modes):
        last = command(k * PERIOD_NS, k, mode)
        watchdog.apply(last, k * PERIOD_NS, k, motion, STEER_RAD)
    for k in range(len(modes), len(modes) + 4):
        watchdog.apply(last, k * PERIOD_NS, k, motion, STEER_RAD)
    assert watchdog.is_braking
    assert watchdog.has_controller_ended is has_ended


FAR = OwnMotion(20.0, 1.5, is_mission_on=True)


@pytest.mark.parametrize(
    ("motion", "age_ns", "have_failed", "cause"),
    [
        (MOVING, 0, False, None),
        (MOVING, 4 * PERIOD_NS, False, BrakingCause.NO_COMMAND),
        (FAR, 0, False, BrakingCause.LEAVING_PATH),
        (FAR, 4 * PERIOD_NS, False, BrakingCause.NO_COMMAND),
        (MOVING, 0, True, BrakingCause.ACTUATOR_FAILED),
        (FAR, 4 * PERIOD_NS, True, BrakingCause.ACTUATOR_FAILED),
    ],
)
def test_the_cause_to_brake_is_kept(
    motion: OwnMotion, age_ns: int, have_failed: bool, cause: BrakingCause | None
) -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0), 0, 0, MOVING, STEER_RAD)
    watchdog.apply(command(0), age_ns, 0, motion, STEER_RAD, have_actuators_failed=have_failed)
    assert watchdog.braking_cause is cause
    watchdog.apply(None, age_ns, 0, MOVING, STEER_RAD)
    first = BrakingCause.NO_COMMAND if cause is None else cause
    for have_actuators_failed in (True, False):
        watchdog.apply(None, 0, 0, FAR, STEER_RAD, have_actuators_failed=have_actuators_failed)
        assert watchdog.braking_cause is first


def test_a_controller_that_never_sent_has_not_ended_a_drive() -> None:
    watchdog = ActuatorWatchdog()
    assert not watchdog.is_braking
    watchdog.apply(None, 0, 0, STANDING, STEER_RAD)
    assert watchdog.is_braking
    assert not watchdog.has_controller_ended
