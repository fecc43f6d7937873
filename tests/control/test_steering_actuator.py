"""Delay and largest rate of the steering wheel, from ACT_FB and the commands."""

from collections import deque
from math import inf, radians

import numpy as np
import pytest

from rt_controller.contract.signals import PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.steering_actuator import LONGEST_DELAY, SAMPLES, SteeringActuator

CONFIGURED = 1
RESOLUTION_RAD = radians(0.02)
PATH = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)


class Wheel:
    """Sends commands to a wheel that is late or slow, and notes what it shows."""

    def __init__(self):
        self.steering = SteeringActuator(CONFIGURED)
        self.angle_rad = 0.0
        self.delay, self.rate_radps = CONFIGURED, inf
        self.gain, self.offset_rad = 1.0, 0.0
        self._commands = deque([0.0] * (LONGEST_DELAY + 1), maxlen=LONGEST_DELAY + 1)

    def follow(self, commands):
        for command in commands:
            self._commands.appendleft(command)
            change = self.rate_radps * PERIOD_S
            wanted = self.gain * self._commands[self.delay] + self.offset_rad
            self.angle_rad = min(max(wanted, self.angle_rad - change), self.angle_rad + change)
            shown = round(self.angle_rad / RESOLUTION_RAD) * RESOLUTION_RAD
            self.steering.note(list(self._commands), shown)
        return self.steering


def slalom(periods, amplitude_rad=0.5, period_s=2.0):
    times = PERIOD_S * np.arange(periods)
    return (amplitude_rad * np.sin(2.0 * np.pi * times / period_s)).tolist()


@pytest.mark.parametrize("seed", range(3))
def test_a_wheel_that_follows_has_exactly_the_configured_delay(seed):
    rng, wheel = np.random.default_rng(seed), Wheel()
    for commands in (slalom(200), [0.3] * 50, rng.uniform(-0.7, 0.7, 200).tolist()):
        for command in commands:
            steering = wheel.follow([command])
            assert (steering.delay_periods, steering.rate_radps) == (CONFIGURED, inf)


@pytest.mark.parametrize("late", [1, 2, 4, 8])
def test_a_late_wheel_is_found_while_it_turns_and_forgotten_when_it_follows(late):
    wheel = Wheel()
    wheel.follow(slalom(80))
    wheel.delay = CONFIGURED + late
    assert wheel.follow(slalom(80)).late_periods == late
    assert not wheel.steering.is_slow
    wheel.delay = CONFIGURED
    assert wheel.follow(slalom(80)).late_periods == 0


def test_a_delay_is_found_within_four_periods():
    wheel = Wheel()
    commands = slalom(60)
    wheel.follow(commands[:40])
    wheel.delay = CONFIGURED + 4
    assert wheel.follow(commands[40 : 40 + SAMPLES]).late_periods == 4


def test_constant_commands_show_no_delay():
    wheel = Wheel()
    wheel.delay = CONFIGURED + 4
    assert wheel.follow([0.0] * 50).late_periods == 0


@pytest.mark.parametrize("place", [0, 25])
def test_a_stuck_wheel_is_neither_late_nor_slow(place):
    wheel = Wheel()
    commands = slalom(120)
    wheel.follow([*[0.0] * 20, *commands[:place]])
    wheel.rate_radps = 0.0
    for command in commands[place:]:
        steering = wheel.follow([command])
        assert (steering.late_periods, steering.is_slow) == (0, False)


@pytest.mark.parametrize(("gain", "offset_rad"), [(0.7, 0.0), (1.2, 0.0), (1.0, 0.035)])
def test_a_wheel_with_another_gain_or_an_offset_is_not_slow(gain, offset_rad):
    wheel = Wheel()
    wheel.gain, wheel.offset_rad = gain, offset_rad
    ramp = (0.1 * np.arange(8)).tolist()
    for command in (*ramp, *reversed(ramp), *slalom(160)):
        assert not wheel.follow([command]).is_slow


@pytest.mark.parametrize("rate_degps", [20.0, 30.0, 50.0])
def test_the_rate_of_a_slow_wheel_is_found(rate_degps):
    wheel = Wheel()
    wheel.rate_radps = radians(rate_degps)
    steering = wheel.follow(slalom(70, amplitude_rad=0.6))
    assert steering.rate_radps == pytest.approx(wheel.rate_radps, rel=0.12)
    assert steering.late_periods == 0


def test_a_rate_that_is_no_longer_limited_is_forgotten_in_seconds():
    wheel = Wheel()
    wheel.rate_radps = radians(30.0)
    assert wheel.follow(slalom(70)).is_slow
    wheel.rate_radps = inf
    assert not wheel.follow(slalom(round(20.0 / PERIOD_S))).is_slow


def test_without_feedback_nothing_changes():
    wheel = Wheel()
    wheel.delay = CONFIGURED + 2
    wheel.follow(slalom(80))
    for _ in range(10):
        wheel.steering.note(None, None)
    assert wheel.steering.late_periods == 2
    assert wheel.steering.angles_under_way([0.1, 0.2]) == [0.1, 0.2]


def test_the_angles_under_way_of_a_slow_wheel_are_those_that_it_reaches():
    wheel = Wheel()
    assert wheel.steering.angles_under_way([0.4, -0.4]) == [0.4, -0.4]
    wheel.rate_radps = radians(30.0)
    steering = wheel.follow(slalom(70))
    change, angle = steering.rate_radps * PERIOD_S, steering.angle_rad
    assert angle is not None
    expected = [angle + change, angle + 2.0 * change, angle + 2.0 * change]
    commands = [9.0, 9.0, expected[1]]
    assert steering.angles_under_way(commands) == pytest.approx(expected)


def test_a_car_with_a_slow_wheel_is_slowed_and_drives_on_faster_afterwards():
    wheel = Wheel()
    assert wheel.steering.slowed(PATH, 20.0) == PATH
    wheel.rate_radps = radians(30.0)
    wheel.follow(slalom(70))
    speeds = []
    for command in slalom(20):
        wheel.follow([command])
        path = wheel.steering.slowed(PATH, 20.0)
        speeds.append(path.v_mps)
        assert path.a_mps2 <= 0.0
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] < 19.5
    wheel.rate_radps = inf
    for command in slalom(round(60.0 / PERIOD_S)):
        wheel.follow([command])
        path = wheel.steering.slowed(PATH, 20.0)
    assert path == PATH
