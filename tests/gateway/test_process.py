"""The gateway process: what the car receives when commands are good, bad, late or over."""

from math import radians

import can
import pytest
from car_gateway import GatewayRig, with_period
from own_car import changed, command_writer, example

from rt_controller.bus.messages import STATE
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.loop import RELEASE_TICKS

CRUISE = ControlInput(0.05, 0.0, 0.02)


def driven(ticks, command=CRUISE):
    """A gateway after so many periods with this command."""
    rig = GatewayRig()
    drive_straight(rig, ticks, command)
    return rig


def drive_straight(rig, ticks, command=CRUISE, mode=Mode.NOMINAL):
    """The car moves on along its line while the commands are good."""
    for _ in range(ticks):
        found = rig.drive(command, mode)
    return found


def test_the_gateway_brakes_the_car_when_commands_stop():
    rig = GatewayRig()
    brakes = []
    for tick in range(60):
        found = rig.drive(ControlInput(0.3, 0.0, 0.1) if tick < 20 else None)
        brakes.append(found.get("commands.brake_n", 0.0))
    assert brakes[21] == 0.0
    assert brakes[24] > 0.0
    assert 60.0 <= brakes[-1] <= 100.0
    assert rig.gateway.counts.commands in (19, 20)
    assert rig.gateway.counts.brakings == 1
    assert rig.gateway.counts.braked_because == {"NO_COMMAND": 1}


def test_the_gateway_releases_a_car_that_is_no_longer_engaged():
    """The last command of a controller has the mode SAFE_STOP, also at the end of a mission."""
    rig = GatewayRig()
    drive_straight(rig, 10, ControlInput(0.0, 3.0, 0.1), Mode.SAFE_STOP)
    assert rig.found["driving"] == 1.0
    rig.values["mission.engage"] = 0.0
    drive_straight(rig, 8, None)
    assert rig.gateway.counts.brakings == 0
    assert rig.found["driving"] == 0.0
    assert rig.found["commands.brake_n"] == 0.0


def test_a_car_that_was_released_does_not_receive_the_last_command_of_a_run():
    rig = driven(5, ControlInput(0.1, 0.0, 0.0))
    rig.values["mission.engage"] = 0.0
    drive_straight(rig, 5, ControlInput(0.0, 0.0, 0.0), Mode.STANDBY)
    for _ in range(3):
        assert rig.drive(ControlInput(0.0, 3.0, 0.0), Mode.SAFE_STOP)["driving"] == 0.0
    rig.values["mission.engage"] = 1.0
    drive_straight(rig, 5, ControlInput(0.0, 3.0, 0.0), Mode.SAFE_STOP)
    assert rig.found["driving"] == 1.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_gateway_steers_a_car_that_it_brakes_along_its_path(side):
    rig = GatewayRig()
    # A line of 1e-3 1/m; the path is beside the car, and straight on the wheel would be 0.
    rig.values |= {"reference.c0_m": 3.0 * side, "reference.c1": 0.0, "pose.y": 0.2}
    rig.values |= {"reference.c2_per_m": 0.0, "reference.c3_per_m2": 0.0, "pose.yaw": 0.02}
    drive_straight(rig, 10, ControlInput(0.3, 0.0, 0.0))
    for _ in range(20):
        found = rig.drive()
    assert found["commands.steer_rad"] * side > 0.1
    for _ in range(90):  # at 40 deg/s
        found = rig.drive(is_car_silent=True)
    assert found["commands.steer_rad"] == pytest.approx(0.0, abs=1e-3)
    assert found["commands.brake_n"] >= 60.0


@pytest.mark.parametrize(
    ("wanted", "name", "most"),
    [
        (ControlInput(0.0, 150.0, 0.0), "commands.brake_n", 12.6),
        (ControlInput(1.0, 0.0, 0.0), "commands.throttle", 0.063),
    ],
)
def test_the_gateway_limits_how_fast_a_pedal_is_pressed(wanted, name, most):
    rig = driven(5, ControlInput(0.0, 0.0, 0.0))
    assert rig.gateway.counts.limited == 0
    assert 0.9 * most <= rig.drive(wanted)[name] <= most
    assert rig.gateway.counts.limited == 1


BAD = [
    ("STEERING", ControlInput(0.05, 0.0, radians(39.9)), Mode.NOMINAL),
    ("PEDALS", ControlInput(0.05, 5.0, 0.0), Mode.NOMINAL),
    ("MODE", ControlInput(0.05, 0.0, 0.0), Mode.SAFE_STOP),
    ("MODE", ControlInput(0.0, 0.0, 0.0), Mode.STANDBY),
]


@pytest.mark.parametrize(("reason", "wanted", "mode"), BAD)
def test_a_command_that_the_car_must_not_follow_leaves_the_one_before(reason, wanted, mode):
    rig = GatewayRig()
    before = dict(drive_straight(rig, 5))
    found = rig.drive(wanted, mode)
    assert {name: value for name, value in found.items() if name != "RequestCounter"} == before
    assert rig.gateway.counts.refused_because == {reason: 1}
    drive_straight(rig, 10)
    assert rig.gateway.counts.brakings == 0


@pytest.mark.parametrize(("reason", "wanted", "mode"), BAD)
def test_a_car_whose_commands_go_on_being_refused_is_braked(reason, wanted, mode):
    rig = driven(5)
    steered = [rig.drive(wanted, mode)["commands.steer_rad"] for _ in range(8)]
    assert max(map(abs, steered[:5])) < radians(5.0)
    assert rig.gateway.counts.brakings == 1
    assert drive_straight(rig, 40, wanted, mode)["commands.brake_n"] >= 60.0
    assert rig.found["commands.throttle"] == 0.0


def test_more_steering_than_the_speed_allows_is_refused():
    """At 50 m/s, more than 29.6 deg at the wheel mean more than 7.5 m/s²."""
    rig = GatewayRig()
    rig.values |= {"states.vx_mps": 50.0, "states.yaw_rate_radps": 0.0}
    drive_straight(rig, 5, ControlInput(0.0, 0.0, 0.0))
    for step in range(1, 9):
        turned = rig.drive(ControlInput(0.0, 0.0, radians(4.0 * step)))
    assert rig.gateway.counts.refused_because == {"LATERAL_ACCELERATION": 1}
    assert turned["commands.steer_rad"] == pytest.approx(radians(28.0), abs=1e-3)


def test_a_car_that_begins_beside_its_path_is_led_to_it_and_not_off_it_again():
    rig = GatewayRig()
    rig.values |= {"reference.c0_m": 3.0, "reference.c1": 0.0}
    drive_straight(rig, 20)
    rig.values["reference.c0_m"] = 0.7
    drive_straight(rig, 5)
    assert rig.gateway.counts.brakings == 0
    rig.values["reference.c0_m"] = -0.8
    drive_straight(rig, 2)
    assert rig.gateway.counts.brakings == 1
    assert rig.gateway.counts.braked_because == {"LEAVING_PATH": 1}


def test_a_command_after_lost_ones_may_have_turned_the_wheel_in_each_period():
    rig = driven(5, ControlInput(0.0, 0.0, 0.0))
    drive_straight(rig, 2, None)
    rig.drive(ControlInput(0.0, 0.0, radians(14.0)))
    assert rig.gateway.counts.refused == 0
    rig.drive(ControlInput(0.0, 0.0, radians(20.0)))
    assert rig.gateway.counts.refused_because == {"STEERING": 1}


def test_a_car_that_was_braked_and_released_is_driven_again():
    """The new controller begins with the wheel in the middle, the old one had turned it."""
    rig = GatewayRig()
    for step in range(8):
        rig.drive(ControlInput(0.0, 0.0, radians(4.0 * step)))
    drive_straight(rig, 10, None)
    assert rig.gateway.counts.brakings == 1
    rig.values["mission.engage"] = 0.0
    drive_straight(rig, 60, None)
    assert rig.found["driving"] == 0.0
    rig.values["mission.engage"] = 1.0
    rig.tick += 512  # four times around the counter of the states
    drive_straight(rig, 20, ControlInput(0.1, 0.0, 0.0))
    assert rig.found["driving"] == 1.0
    assert rig.gateway.counts.refused == 0
    assert rig.gateway.counts.brakings == 1


def test_a_driver_who_leaves_the_path_is_not_braked():
    rig = GatewayRig()
    rig.values |= {"reference.c0_m": 0.7, "reference.c1": 0.0}
    drive_straight(rig, 5)
    rig.values |= {"mission.car_brakes": 1.0}
    drive_straight(rig, 2)
    rig.values |= {"reference.c0_m": -0.8}
    drive_straight(rig, 5)
    assert rig.gateway.counts.brakings == 0


@pytest.mark.parametrize("period_s", [0.025, 0.05, 0.25])
@pytest.mark.parametrize("missed", [0, 3])
def test_the_last_command_of_a_mission_is_the_release(tmp_path, period_s, missed):
    """Whatever the period of the message, and when the last frames of the controller are lost."""
    rig = GatewayRig(with_period(tmp_path, period_s))
    drive_straight(rig, 20 + missed, ControlInput(0.0, 140.0, 0.3), Mode.NOMINAL)
    assert rig.read()["driving"] == 1.0
    rig.values["mission.engage"] = 0.0
    for _ in range(RELEASE_TICKS - missed):
        rig.drive(ControlInput(0.0, 90.0, 0.25), Mode.STANDBY)
    drive_straight(rig, 60, None)
    assert rig.found["driving"] == 0.0
    assert rig.found["commands.throttle"] == 0.0
    assert rig.found["commands.brake_n"] == 0.0
    assert rig.found["commands.steer_rad"] == pytest.approx(0.0, abs=1e-3)
    assert rig.gateway.counts.brakings == 0


def test_the_first_and_the_second_request_to_end_brake_the_car_and_the_third_ends_at_once():
    rig = driven(5)
    for request in range(3):
        assert not rig.gateway.has_ended
        rig.gateway.request_end()
        if request < 2:
            drive_straight(rig, 3)
            assert rig.gateway.counts.brakings == 1
            assert rig.gateway.counts.braked_because == {"END_REQUESTED": 1}
    assert rig.gateway.has_ended


def test_a_car_that_stands_ends_a_requested_stop():
    rig = driven(5)
    rig.gateway.request_end()
    drive_straight(rig, 5)
    rig.values["states.vx_mps"] = 0.1
    drive_straight(rig, 1)
    assert rig.gateway.has_ended
    rig.gateway.end()
    assert rig.read()["driving"] == 1.0
    assert rig.found["commands.brake_n"] > 20.0


def test_a_car_that_is_not_heard_ends_a_requested_stop_after_ten_seconds():
    rig = driven(5)
    rig.gateway.request_end()
    for _ in range(400):
        rig.drive(is_car_silent=True)
    assert not rig.gateway.has_ended
    for _ in range(10):
        rig.drive(is_car_silent=True)
    assert rig.gateway.has_ended


def test_a_car_that_is_not_driven_ends_a_request_at_once(tmp_path):
    rig = GatewayRig(with_period(tmp_path, 0.25))
    rig.gateway.request_end()
    assert rig.gateway.has_ended
    rig.gateway.end()
    assert not rig.read()  # a car that was never driven


COMMANDS = dict.fromkeys((f"commands.{name}" for name in (*ControlInput._fields, "mode")), 0.0)
DRIVER_PANEL = 802
"""with the switches of the car, every 100 ms"""


def two_bits(raw):
    """Changes the bits of DriverOverride."""

    def change(frame):
        if frame.arbitration_id == DRIVER_PANEL:
            frame.data[0] = frame.data[0] & ~0b1100 | raw << 2
        return True

    return change


UNREADABLE = {
    "neither on nor off": two_bits(2),
    "out of the range of the DBC": two_bits(3),
    "the message does not come": lambda frame: frame.arbitration_id != DRIVER_PANEL,
}


@pytest.mark.parametrize("reason", UNREADABLE)
def test_a_driven_car_that_does_not_say_whether_it_follows_is_braked(reason):
    rig = driven(20)
    rig.change = UNREADABLE[reason]
    drive_straight(rig, 60)
    assert rig.gateway.counts.braked_because == {"CAR_UNKNOWN": 1}
    assert rig.found["commands.brake_n"] >= 60.0


@pytest.mark.parametrize("reason", UNREADABLE)
def test_a_car_that_does_not_say_whether_it_follows_is_not_handed_over(reason):
    """The controller drives no vehicle whose watchdog brakes."""
    rig = GatewayRig()
    rig.change = UNREADABLE[reason]
    for _ in range(30):
        rig.drive()
    assert rig.inbox.newest(STATE).content.is_watchdog_braking is True


def test_a_single_value_that_is_not_known_is_bridged():
    rig = driven(20)
    rig.change = two_bits(3)
    drive_straight(rig, 5)  # one frame of the message
    rig.change = two_bits(0)
    drive_straight(rig, 20)
    assert rig.gateway.counts.brakings == 0


def test_another_sender_of_the_same_commands_ends_the_gateway_or_brakes_the_car():
    (frame, *_) = command_writer(example()).frames(COMMANDS, 0)
    frame.is_rx = True
    rig = GatewayRig()
    rig.gateway.car_end.accept(frame, 0)
    with pytest.raises(BusError, match="another node"):
        rig.gateway.require_alone()
    rig = driven(20)
    rig.gateway.car_end.accept(frame, 20 * PERIOD_NS)
    rig.gateway.require_alone()
    drive_straight(rig, 5)
    assert rig.gateway.counts.braked_because == {"SECOND_SENDER": 1}


def test_two_senders_of_one_message_of_the_car_end_the_gateway_or_brake_the_car(tmp_path):
    any_source = '[messages.Inertial]\nsource = "any"\n\n[messages.WheelSpeed]'
    car = changed(tmp_path, ("[messages.WheelSpeed]", any_source))
    second = can.Message(arbitration_id=0x18FF0517, data=bytes(8))
    rig = GatewayRig(car)
    drive_straight(rig, 20)
    rig.gateway.require_alone()
    rig.gateway.car_end.accept(second, 20 * PERIOD_NS)
    rig.gateway.require_alone()
    drive_straight(rig, 5)
    assert rig.gateway.counts.braked_because == {"SECOND_SENDER": 1}
    rig = GatewayRig(car)
    for _ in range(2):
        rig.drive()
    rig.gateway.car_end.accept(second, 2 * PERIOD_NS)
    assert rig.gateway.car_end.samples.newest("states.yaw_rate_radps", 2 * PERIOD_NS).value > 0.0
    with pytest.raises(BusError, match=r"Inertial from 2 source addresses \(0x00, 0x17\)"):
        rig.gateway.require_alone()
