"""The bus of `--signals`: what the car has received when it is closed."""

import pytest
from car_gateway import REAR_AXLE, QueueBus, send_command, with_period
from own_car import command_reader

from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.gateway.lateral_speed import LateralSpeed
from rt_controller.gateway.signal_bus import SignalBus


class CarBus(QueueBus):
    channel_info = "car"

    def shutdown(self):
        pass


@pytest.mark.parametrize(
    ("mode", "driving", "brake_n"), [(Mode.STANDBY, 0.0, 0.0), (Mode.SAFE_STOP, 1.0, 60.0)]
)
def test_the_last_command_reaches_a_car_with_a_longer_period(tmp_path, mode, driving, brake_n):
    car, below = with_period(tmp_path, 0.25), CarBus()
    bus = SignalBus(below, car, LateralSpeed(REAR_AXLE), lambda: 0, has_wall_clock=False)
    sender = Outbox(bus, Node.CONTROLLER)
    for tick in range(6):
        send_command(sender, ControlInput(0.0, 60.0, 0.1), tick)
    send_command(sender, ControlInput(0.0, 60.0, 0.1), 6, mode)
    bus.shutdown()
    bus.shutdown()
    reader, found = command_reader(car), {}
    for frame in below.frames:
        found |= reader.read(frame)
    assert found["driving"] == driving
    assert found["commands.brake_n"] == pytest.approx(brake_n, abs=0.1)
