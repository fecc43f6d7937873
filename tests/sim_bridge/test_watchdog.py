"""A silent or stale controller ends in a braked car."""

from rt_controller.bus.snapshot import CommandSnapshot
from rt_controller.contract.signals import ControlInput, Mode
from sim_bridge.watchdog import BRAKE_N, ActuatorWatchdog

PERIOD_NS = 25_000_000


def command(arrival_ns: int, steer_rad: float = 0.3) -> CommandSnapshot:
    return CommandSnapshot(
        control=ControlInput(0.4, 0.0, steer_rad),
        mode=Mode.NOMINAL,
        counter=0,
        arrival_ns=arrival_ns,
    )


def test_a_fresh_command_reaches_the_actuators_unchanged() -> None:
    watchdog = ActuatorWatchdog()
    assert watchdog.apply(command(0), now_ns=0) == ControlInput(0.4, 0.0, 0.3)
    assert not watchdog.is_braking


def test_a_command_stands_until_it_is_100_ms_old_and_no_longer() -> None:
    watchdog = ActuatorWatchdog()
    for k in range(4):
        assert watchdog.apply(command(0), now_ns=k * PERIOD_NS).throttle == 0.4
    applied = watchdog.apply(command(0), now_ns=4 * PERIOD_NS)
    assert watchdog.is_braking
    assert applied.throttle == 0.0
    assert applied.brake_n > 0.0


def test_a_controller_that_comes_back_does_not_get_the_braking_car_back() -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0), now_ns=0)
    watchdog.apply(command(0), now_ns=200_000_000)
    applied = watchdog.apply(command(225_000_000), now_ns=225_000_000)
    assert watchdog.is_braking
    assert applied.throttle == 0.0
    watchdog.reset()
    assert watchdog.apply(command(250_000_000), now_ns=250_000_000).throttle == 0.4


def test_the_brake_ramps_to_its_end_while_the_wheel_eases_to_the_middle() -> None:
    watchdog = ActuatorWatchdog()
    watchdog.apply(command(0), now_ns=0)
    brakes, wheels = [], []
    for k in range(4, 60):
        applied = watchdog.apply(None, now_ns=k * PERIOD_NS)
        brakes.append(applied.brake_n)
        wheels.append(applied.steer_rad)
    assert brakes == sorted(brakes)
    assert brakes[-1] == BRAKE_N
    assert wheels == sorted(wheels, reverse=True)
    assert wheels[-1] == 0.0
