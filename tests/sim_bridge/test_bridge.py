"""The vehicle's end of the bus, with a scripted controller at the other."""

from collections.abc import Iterator

import numpy as np
import pytest
from bridge_rig import CRUISE, BridgeRig, open_bridge
from scripted_controller import send_command

from rt_controller.bus.messages import (
    CONTROLLER_IDENTITY,
    FEEDBACK,
    MISSION,
    REFERENCE,
    VEHICLE_IDENTITY,
    Command,
    Identity,
    Node,
)
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.receive import Receiver
from rt_controller.safety.tick import Tick
from sim_bridge.bridge import Delay


@pytest.fixture
def rig() -> Iterator[BridgeRig]:
    with open_bridge() as rig:
        yield rig


def test_the_car_waits_at_its_start_until_a_controller_drives(rig: BridgeRig) -> None:
    first = rig.tick(control=None)
    for _ in range(20):
        waiting = rig.tick(CRUISE, Mode.STANDBY)
    assert waiting.state == first.state
    assert waiting.sample_time_ns > first.sample_time_ns
    assert rig.bridge.is_waiting
    rig.tick()
    rig.tick()  # the command arrives a period later
    assert not rig.bridge.is_waiting


def test_state_path_mission_and_identity_are_sent_from_the_first_tick(rig: BridgeRig) -> None:
    sample = rig.tick(control=None)
    assert rig.newest(REFERENCE) is not None
    assert rig.newest(MISSION).is_engaged
    assert rig.newest(VEHICLE_IDENTITY) is not None
    assert sample.state.vx_mps == pytest.approx(60 / 3.6, abs=0.01)
    assert sample.state.ds_m == pytest.approx(60 / 3.6 * PERIOD_S, abs=1e-3)


def test_a_command_moves_the_car_and_comes_back_as_feedback(rig: BridgeRig) -> None:
    for _ in range(40):
        sample = rig.tick(ControlInput(0.1, 0.0, 0.2))
    assert sample.state.yaw_rate_radps > 0.03
    assert rig.newest(FEEDBACK).steer_rad == pytest.approx(0.2, abs=1e-3)


def test_a_car_beyond_the_speeds_of_the_bus_is_a_failed_plant(
    rig: BridgeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.tick()
    runaway = np.array(((650.0, 0.0, 0.0),))
    monkeypatch.setattr(rig.bridge._car.plant, "step", lambda control, dt_s: runaway)
    for _ in range(3):
        rig.tick()
    assert rig.bridge.has_failed
    failure = rig.bridge.summary().plant_failure
    assert failure is not None
    assert "expected a finite motion of at most 100 m/s, found 650 m/s" in failure


def test_a_second_vehicle_is_recognised_before_anything_is_sent(rig: BridgeRig) -> None:
    rig.bridge.listen(0)
    assert rig.controller_bus.recv(0) is None
    Outbox(rig.controller_bus, Node.VEHICLE).send(VEHICLE_IDENTITY, Identity(1, None), 0)
    with pytest.raises(BusError, match="only vehicle on this bus"):
        rig.bridge.listen(0)


def test_a_controller_of_another_catalogue_is_refused(rig: BridgeRig) -> None:
    rig.controller.send(CONTROLLER_IDENTITY, Identity(0xABCD, None), 0)
    with pytest.raises(BusError, match="0000abcd"):
        rig.tick()


@pytest.mark.parametrize("delay", [Delay(0, 0), Delay(3, 5)])
def test_a_command_acts_its_delay_after_the_state_that_it_answers(delay: Delay) -> None:
    with open_bridge(delay) as rig:
        for _ in range(12):
            rig.tick(CRUISE)
        first = rig.counter
        steer_rad = []
        for _ in range(12):
            rig.tick(CRUISE._replace(steer_rad=0.02))
            steer_rad.append(rig.newest(FEEDBACK).steer_rad)
        acts = int(np.argmax(np.array(steer_rad) > 0.01))
        assert acts == delay.transport_periods + delay.actuation_periods
        assert rig.counter == first + 12


@pytest.mark.parametrize("transport_periods", [0, 3])
def test_the_receiver_measures_the_transport_delay(transport_periods: int) -> None:
    with open_bridge(Delay(transport_periods, 2)) as rig:
        inbox = Inbox(Node.CONTROLLER)
        receiver = Receiver(rig.controller_bus, inbox)
        for _ in range(12):
            rig.now_ns += PERIOD_NS
            command = Command(CRUISE, Mode.NOMINAL)
            send_command(rig.controller, command, rig.now_ns, receiver.counter)
            rig.bridge.tick(rig.now_ns)
            receiver.receive(Tick(last_mode=Mode.NOMINAL), rig.now_ns)
        assert receiver.transport_periods == transport_periods
