"""The vehicle's end of the bus, with a scripted controller at the other."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

import can
import pytest

from rt_controller.bus.inbox import CommandInbox, Inbox
from rt_controller.bus.outbox import ControllerOutbox, VehicleOutbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS
from sim_bridge.bridge import FAREWELL_TICKS, Bridge
from sim_bridge.scenario import load_scenario
from sim_bridge.session import build_car
from sim_bridge.watchdog import BRAKE_N

CRUISE = ControlInput(0.12, 0.0, 0.0)
_channels = count()


@dataclass(slots=True)
class Rig:
    """A bridge and a scripted controller, ticked in lockstep."""

    bridge: Bridge
    controller: ControllerOutbox
    controller_bus: can.BusABC
    bus: can.BusABC
    heard: Inbox
    now_ns: int = 0
    counter: int = 0
    """that the controller answers with"""

    def tick(self, control: ControlInput | None = CRUISE, mode: Mode = Mode.NOMINAL) -> Inbox:
        """One period: the controller speaks (or not), the bridge acts, the controller hears."""
        self.now_ns += PERIOD_NS
        if control is not None:
            self.controller.send_command(control, mode, self.counter, self.now_ns)
        self.bridge.tick(self.now_ns)
        self.heard.drain(self.controller_bus, self.now_ns)
        if self.heard.state is not None:
            self.counter = self.heard.state.counter
        return self.heard


@pytest.fixture
def rig() -> Iterator[Rig]:
    channel = f"bridge-test-{next(_channels)}"
    scenario = load_scenario("straight")
    with open_bus("virtual", channel) as bus, open_bus("virtual", channel) as controller_bus:
        bridge = Bridge(
            bus=bus,
            inbox=CommandInbox(),
            outbox=VehicleOutbox(bus),
            car=build_car(scenario),
            scenario=scenario,
        )
        yield Rig(bridge, ControllerOutbox(controller_bus), controller_bus, bus, Inbox())


def test_the_car_waits_at_its_start_until_a_controller_drives(rig: Rig) -> None:
    first = rig.tick(control=None).state
    for _ in range(20):
        waiting = rig.tick(CRUISE, Mode.STANDBY).state
    assert first is not None
    assert waiting is not None
    assert waiting.state == first.state
    assert waiting.counter != first.counter
    assert rig.bridge.is_waiting
    rig.tick()
    assert not rig.bridge.is_waiting


def test_state_path_mission_and_identity_are_told_from_the_first_tick(rig: Rig) -> None:
    heard = rig.tick(control=None)
    assert heard.state is not None
    assert heard.reference is not None
    assert heard.mission is not None
    assert heard.mission.is_engaged
    assert heard.peer is not None
    assert heard.state.state.vx_mps == pytest.approx(60 / 3.6, abs=0.01)
    assert heard.state.state.ds_m == pytest.approx(60 / 3.6 * 0.025, abs=1e-3)


def test_a_command_moves_the_car_and_comes_back_as_feedback(rig: Rig) -> None:
    for _ in range(40):
        heard = rig.tick(ControlInput(0.1, 0.0, 0.2))
    assert heard.state is not None
    assert heard.state.state.yaw_rate_radps > 0.03
    assert heard.feedback is not None
    assert heard.feedback.applied.steer_rad == pytest.approx(0.2, abs=1e-3)


def test_a_silent_controller_ends_in_a_standing_car(rig: Rig) -> None:
    for _ in range(10):
        rig.tick()
    for _ in range(3):
        heard = rig.tick(control=None)
        assert heard.state is not None
        assert not heard.state.is_watchdog_braking
    heard = rig.tick(control=None)
    assert heard.state is not None
    assert heard.state.is_watchdog_braking
    while not rig.bridge.is_over:
        rig.tick(control=None)
    assert rig.bridge.summary().watchdog_braked
    assert rig.bridge.summary().final_speed_mps < 0.5
    assert rig.heard.feedback is not None
    assert rig.heard.feedback.applied.brake_n == pytest.approx(BRAKE_N, abs=0.01)


def test_a_frozen_counter_is_silence(rig: Rig) -> None:
    rig.tick()
    stuck = can.Message(arbitration_id=0x100, is_extended_id=False)
    recorded: list[bytes] = []

    class Tap:
        def record(self, message: can.Message, timestamp_ns: int) -> None:
            recorded.append(bytes(message.data))

    tapped = ControllerOutbox(rig.controller_bus, Tap())
    tapped.send_command(CRUISE, Mode.NOMINAL, rig.counter, rig.now_ns)
    stuck.data = bytearray(recorded[0])
    stuck.dlc = len(recorded[0])
    for _ in range(8):
        rig.controller_bus.send(stuck)
        heard = rig.tick(control=None)
    assert heard.state is not None
    assert heard.state.is_watchdog_braking


def test_a_controller_of_another_catalogue_is_refused(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rt_controller.bus.outbox.dbc_hash", lambda: 0xABCD)
    rig.controller.send_identity(None, 0)
    with pytest.raises(BusError, match="0000abcd"):
        rig.tick()


def test_the_end_of_the_mission_is_said_before_the_bridge_leaves(rig: Rig) -> None:
    ticks = 0
    while not rig.bridge.is_over:
        heard = rig.tick()
        ticks += 1
    assert ticks == load_scenario("straight").ticks + FAREWELL_TICKS - 1
    assert heard.mission is not None
    assert not heard.mission.is_engaged
    assert not rig.bridge.summary().watchdog_braked


def test_commands_that_come_a_second_late_are_no_commands(rig: Rig) -> None:
    late: deque[tuple[ControlInput, int]] = deque()
    for _ in range(20):
        rig.tick()
    for _ in range(60):
        late.append((CRUISE, rig.counter))
        if len(late) > 40:
            control, counter = late.popleft()
            rig.controller.send_command(control, Mode.NOMINAL, counter, rig.now_ns)
        heard = rig.tick(control=None)
    assert heard.state is not None
    assert heard.state.is_watchdog_braking


def test_a_car_stopped_by_its_watchdog_keeps_its_brake(rig: Rig) -> None:
    for _ in range(10):
        rig.tick()
    while not rig.bridge.is_over:
        heard = rig.tick(control=None)
        if heard.mission is not None and not heard.mission.is_engaged:
            assert heard.feedback is not None
            assert heard.feedback.applied.brake_n > 0.0


def test_a_bus_that_cannot_be_read_ends_the_bridge(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise can.CanOperationError("unplugged")

    rig.tick()
    monkeypatch.setattr(rig.bus, "recv", fail)
    with pytest.raises(BusError, match="unplugged"):
        rig.tick()
