"""The vehicle's end of the bus, with a scripted controller at the other."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import Any

import can
import numpy as np
import pytest
from recorded_frames import RecordedFrames

from rt_controller.bus.catalogue import (
    COMMAND,
    CONTROLLER_IDENTITY,
    FEEDBACK,
    MISSION,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
    Command,
    Identity,
    StateSample,
)
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Message, Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from sim_bridge.bridge import AT_REST_MPS, END_TICKS, Bridge
from sim_bridge.scenario import load_scenario
from sim_bridge.session import build_car
from sim_bridge.watchdog import BRAKE_N

CRUISE = ControlInput(0.12, 0.0, 0.0)
_channels = count()


@dataclass(slots=True)
class Rig:
    """A bridge and a scripted controller, ticked in lockstep."""

    bridge: Bridge
    controller: Outbox
    controller_bus: can.BusABC
    bus: can.BusABC
    received: Inbox
    now_ns: int = 0
    counter: int = 0
    """that the controller answers with"""

    def tick(self, control: ControlInput | None = CRUISE, mode: Mode = Mode.NOMINAL) -> StateSample:
        """The state after a period in which the controller sends a command, or none."""
        self.now_ns += PERIOD_NS
        if control is not None:
            command = Command(control, mode)
            self.controller.send(COMMAND, command, self.now_ns, counter=self.counter)
        self.bridge.tick(self.now_ns)
        self.received.drain(self.controller_bus, self.now_ns)
        state = self.received.newest(STATE)
        assert state is not None
        self.counter = state.counter
        return state.content

    def newest(self, message: Message) -> Any:
        received = self.received.newest(message)
        assert received is not None
        return received.content


@pytest.fixture
def rig() -> Iterator[Rig]:
    channel = f"bridge-test-{next(_channels)}"
    scenario = load_scenario("straight")
    with open_bus("virtual", channel) as bus, open_bus("virtual", channel) as controller_bus:
        bridge = Bridge(bus, build_car(scenario), scenario)
        controller = Outbox(controller_bus, Node.CONTROLLER)
        yield Rig(bridge, controller, controller_bus, bus, Inbox(Node.CONTROLLER))


def test_the_car_waits_at_its_start_until_a_controller_drives(rig: Rig) -> None:
    first = rig.tick(control=None)
    for _ in range(20):
        waiting = rig.tick(CRUISE, Mode.STANDBY)
    assert waiting.state == first.state
    assert waiting.sample_time_ns > first.sample_time_ns
    assert rig.bridge.is_waiting
    rig.tick()
    assert not rig.bridge.is_waiting


def test_state_path_mission_and_identity_are_sent_from_the_first_tick(rig: Rig) -> None:
    sample = rig.tick(control=None)
    assert rig.newest(REFERENCE) is not None
    assert rig.newest(MISSION).is_engaged
    assert rig.newest(VEHICLE_IDENTITY) is not None
    assert sample.state.vx_mps == pytest.approx(60 / 3.6, abs=0.01)
    assert sample.state.ds_m == pytest.approx(60 / 3.6 * PERIOD_S, abs=1e-3)


def test_a_command_moves_the_car_and_comes_back_as_feedback(rig: Rig) -> None:
    for _ in range(40):
        sample = rig.tick(ControlInput(0.1, 0.0, 0.2))
    assert sample.state.yaw_rate_radps > 0.03
    assert rig.newest(FEEDBACK).steer_rad == pytest.approx(0.2, abs=1e-3)


def test_a_silent_controller_ends_in_a_standing_car(rig: Rig) -> None:
    for _ in range(10):
        rig.tick()
    for _ in range(3):
        assert not rig.tick(control=None).is_watchdog_braking
    assert rig.tick(control=None).is_watchdog_braking
    while not rig.bridge.is_over:
        rig.tick(control=None)
    assert rig.bridge.summary().watchdog_braked
    assert rig.bridge.summary().final_speed_mps < 0.5
    assert rig.newest(FEEDBACK).brake_n == pytest.approx(BRAKE_N, abs=0.01)


@pytest.mark.parametrize("is_crash", [True, False])
def test_silence_after_a_stopped_car_is_the_end_of_a_drive_and_not_after_a_crash(
    rig: Rig, is_crash: bool
) -> None:
    """A controller that crashes sends one last command with the mode SAFE_STOP too."""
    stop = ControlInput(0.0, 100.0, 0.0)
    sample = rig.tick()
    rig.tick(stop, Mode.SAFE_STOP)
    while not is_crash and sample.state.vx_mps > AT_REST_MPS:
        sample = rig.tick(stop, Mode.SAFE_STOP)
    while not rig.bridge.is_over:
        rig.tick(control=None)
    assert rig.bridge.summary().watchdog_braked
    assert rig.bridge.summary().controller_ended is not is_crash


def test_a_car_that_is_driven_slowly_has_left_its_start(rig: Rig) -> None:
    rig.tick(CRUISE, Mode.LOW_SPEED)
    assert not rig.bridge.is_waiting


def test_a_car_beyond_the_speeds_of_the_bus_is_a_failed_plant(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
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


def test_a_second_vehicle_is_recognised_before_anything_is_sent(rig: Rig) -> None:
    rig.bridge.listen(0)
    assert rig.controller_bus.recv(0) is None
    Outbox(rig.controller_bus, Node.VEHICLE).send(VEHICLE_IDENTITY, Identity(1, None), 0)
    with pytest.raises(BusError, match="only vehicle on this bus"):
        rig.bridge.listen(0)


def test_a_frozen_counter_counts_as_no_command(rig: Rig) -> None:
    rig.tick()
    stuck = can.Message(arbitration_id=0x100, is_extended_id=False)
    recorder = RecordedFrames()
    tapped = Outbox(rig.controller_bus, Node.CONTROLLER, recorder)
    tapped.send(COMMAND, Command(CRUISE, Mode.NOMINAL), rig.now_ns, counter=rig.counter)
    first = recorder.frames[0][2]
    stuck.data, stuck.dlc = bytearray(first), len(first)
    for _ in range(8):
        rig.controller_bus.send(stuck)
        sample = rig.tick(control=None)
    assert sample.is_watchdog_braking


def test_a_controller_of_another_catalogue_is_refused(rig: Rig) -> None:
    rig.controller.send(CONTROLLER_IDENTITY, Identity(0xABCD, None), 0)
    with pytest.raises(BusError, match="0000abcd"):
        rig.tick()


def test_a_safe_stop_that_outlasts_the_scenario_brings_the_car_to_rest(rig: Rig) -> None:
    ticks = load_scenario("straight").ticks
    braking = ControlInput(0.0, 75.0, 0.0)
    for _ in range(ticks - 20):
        rig.tick()
    for _ in range(20 * round(1 / PERIOD_S)):
        rig.tick(braking, Mode.SAFE_STOP)
        if rig.bridge.is_over:
            break
        if rig.newest(MISSION).is_engaged:
            assert rig.newest(FEEDBACK).brake_n == braking.brake_n
    assert rig.bridge.is_over
    assert rig.bridge.driven_ticks > ticks + END_TICKS
    assert rig.bridge.summary().final_speed_mps < AT_REST_MPS


def test_the_end_of_the_mission_is_sent_before_the_bridge_leaves(rig: Rig) -> None:
    ticks = 0
    while not rig.bridge.is_over:
        rig.tick()
        ticks += 1
    assert ticks == load_scenario("straight").ticks + END_TICKS - 1
    assert not rig.newest(MISSION).is_engaged
    assert not rig.bridge.summary().watchdog_braked


def test_commands_that_arrive_a_second_late_are_ignored(rig: Rig) -> None:
    late: deque[tuple[ControlInput, int]] = deque()
    for _ in range(20):
        rig.tick()
    for _ in range(60):
        late.append((CRUISE, rig.counter))
        if len(late) > 40:
            control, counter = late.popleft()
            command = Command(control, Mode.NOMINAL)
            rig.controller.send(COMMAND, command, rig.now_ns, counter=counter)
        sample = rig.tick(control=None)
    assert sample.is_watchdog_braking


def test_a_car_stopped_by_its_watchdog_keeps_its_brake(rig: Rig) -> None:
    for _ in range(10):
        rig.tick()
    while not rig.bridge.is_over:
        rig.tick(control=None)
        if not rig.newest(MISSION).is_engaged:
            assert rig.newest(FEEDBACK).brake_n > 0.0


def test_a_bus_that_cannot_be_read_ends_the_bridge(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise can.CanOperationError("unplugged")

    rig.tick()
    monkeypatch.setattr(rig.bus, "recv", fail)
    with pytest.raises(BusError, match="unplugged"):
        rig.tick()
