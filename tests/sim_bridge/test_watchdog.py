"""A silent or stale controller ends in a braked car."""

import pytest

from rt_controller.bus.catalogue import Command
from rt_controller.bus.inbox import Received
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS
from sim_bridge.watchdog import BRAKE_N, ORDERLY_MPS, ORDERLY_TICKS, ActuatorWatchdog

SPEED_MPS = 20.0


def command(arrival_ns: int, counter: int = 0, mode: Mode = Mode.NOMINAL) -> Received[Command]:
    content = Command(ControlInput(0.4, 0.0, 0.3), mode)
    return Received(content, counter, arrival_ns)


def test_a_fresh_command_reaches_the_actuators_unchanged() -> None:
    watchdog = ActuatorWatchdog()
    assert watchdog.apply(command(0), 0, 0, SPEED_MPS) == ControlInput(0.4, 0.0, 0.3)
    assert not watchdog.is_braking


def test_a_command_stands_until_it_is_100_ms_old_and_no_longer() -> None:
    watchdog = ActuatorWatchdog()
    for k in range(4):
        assert watchdog.apply(command(0), k * PERIOD_NS, 0, SPEED_MPS).throttle == 0.4
    applied = watchdog.apply(command(0), 4 * PERIOD_NS, 0, SPEED_MPS)
    assert watchdog.is_braking
    assert applied.throttle == 0.0
    assert applied.brake_n > 0.0


def test_a_controller_that_comes_back_does_not_get_the_braking_car_back() -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0), 0, 0, SPEED_MPS)
    watchdog.apply(command(0), 200_000_000, 0, SPEED_MPS)
    applied = watchdog.apply(command(225_000_000), 225_000_000, 0, SPEED_MPS)
    assert watchdog.is_braking
    assert applied.throttle == 0.0


def test_the_brake_ramps_to_its_end_while_the_wheel_eases_to_the_middle() -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0), 0, 0, SPEED_MPS)
    brakes, wheels = [], []
    for k in range(4, 60):
        applied = watchdog.apply(None, k * PERIOD_NS, 0, SPEED_MPS)
        brakes.append(applied.brake_n)
        wheels.append(applied.steer_rad)
    assert brakes == sorted(brakes)
    assert brakes[-1] == BRAKE_N
    assert wheels == sorted(wheels, reverse=True)
    assert wheels[-1] == 0.0


@pytest.mark.parametrize("jitter_ns", [-2_000_000, -20_000, 20_000, 2_000_000])
def test_the_limit_does_not_depend_on_the_jitter_of_a_tick(jitter_ns: int) -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(100_000), 3 * PERIOD_NS + jitter_ns, 0, SPEED_MPS)
    assert not watchdog.is_braking
    watchdog.apply(command(100_000), 4 * PERIOD_NS + jitter_ns, 0, SPEED_MPS)
    assert watchdog.is_braking


def test_a_command_that_dawdled_on_the_bus_is_as_old_as_the_state_it_answers() -> None:
    watchdog = ActuatorWatchdog()
    for k in range(20):
        # A fresh arrival every period, and every one of them three periods behind.
        watchdog.apply(
            command(k * PERIOD_NS, counter=(k - 3) % 16), k * PERIOD_NS, k % 16, SPEED_MPS
        )
    assert not watchdog.is_braking
    watchdog.apply(command(20 * PERIOD_NS, counter=0), 20 * PERIOD_NS, 4, SPEED_MPS)
    assert watchdog.is_braking


def test_a_command_that_counted_ahead_is_not_old() -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0, counter=1), 0, 0, SPEED_MPS)
    assert not watchdog.is_braking


@pytest.mark.parametrize("lag", range(16))
def test_every_lag_is_braked_for_but_those_of_a_command_ahead(lag: int) -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0, counter=0), 0, lag, SPEED_MPS)
    assert watchdog.is_braking is (4 <= lag < 12)


@pytest.mark.parametrize(
    ("safe_stops", "speed_mps", "has_ended"),
    [
        (0, 0.0, False),
        (1, 80.0 / 3.6, False),  # a crash, or a second Ctrl-C, at speed
        (1, ORDERLY_MPS - 0.1, False),  # a crash at low speed
        (ORDERLY_TICKS, ORDERLY_MPS + 0.1, False),
        (ORDERLY_TICKS, ORDERLY_MPS - 0.1, True),
    ],
)
def test_silence_is_the_end_of_a_drive_after_a_long_safe_stop_and_at_low_speed(
    safe_stops: int, speed_mps: float, has_ended: bool
) -> None:
    watchdog = ActuatorWatchdog()
    modes = 10 * [Mode.NOMINAL] + safe_stops * [Mode.SAFE_STOP]
    for k, mode in enumerate(modes):
        last = command(k * PERIOD_NS, k % 16, mode)
        watchdog.apply(last, k * PERIOD_NS, k % 16, speed_mps)
    for k in range(len(modes), len(modes) + 4):
        assert not watchdog.has_controller_ended
        watchdog.apply(last, k * PERIOD_NS, k % 16, speed_mps)
    assert watchdog.is_braking
    assert watchdog.has_controller_ended is has_ended
    watchdog.apply(command(10**10, 0, Mode.SAFE_STOP), 10**10, 0, 0.0)  # of a restarted controller
    assert watchdog.has_controller_ended is has_ended
