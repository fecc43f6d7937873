"""The vehicle's end of the bus, with a scripted controller at the other, and how its drive ends."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isnan, nan
from typing import Any, cast

import can
import numpy as np
import pytest
from bridge_rig import CRUISE, BridgeRig, open_bridge, send_command
from made_frames import SAMPLE
from own_car import command_writer, example

from rt_controller.bus.messages import (
    COMMAND,
    CONTROLLER_IDENTITY,
    FEEDBACK,
    MISSION,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
    Command,
    Identity,
    Node,
)
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.braking import MOST_BRAKE_N
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.receive import Receiver
from rt_controller.safety.tick import Tick
from sim_bridge.bridge import END_TICKS, LONGEST_END_TICKS, Bridge, Delay
from sim_bridge.foreign_bus import ForeignBus
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario_run import AT_REST_MPS
from sim_bridge.session import BridgeSession


@pytest.fixture
def rig() -> Iterator[BridgeRig]:
    with open_bridge() as rig:
        yield rig


def test_the_car_waits_at_its_start_until_a_controller_drives(rig: BridgeRig) -> None:
    first = rig.tick(control=None)
    assert rig.newest(REFERENCE) is not None
    assert rig.newest(MISSION).is_engaged
    assert rig.newest(VEHICLE_IDENTITY) is not None
    assert first.state.vx_mps == pytest.approx(60 / 3.6, abs=0.01)
    assert first.state.ds_m == pytest.approx(60 / 3.6 * PERIOD_S, abs=1e-3)
    for _ in range(20):
        waiting = rig.tick(CRUISE, Mode.STANDBY)
    assert waiting.state == first.state
    assert waiting.sample_time_ns > first.sample_time_ns
    assert rig.bridge.is_waiting
    rig.tick()
    rig.tick()  # the command arrives a period later
    assert not rig.bridge.is_waiting


@pytest.mark.parametrize(
    ("speed_mps", "words"), [(650.0, "of at most 100 m/s, found 650 m/s"), (nan, "nan")]
)
def test_a_failed_plant_is_sent_as_an_invalid_state_until_the_bridge_ends(
    rig: BridgeRig, monkeypatch: pytest.MonkeyPatch, speed_mps: float, words: str
) -> None:
    """The controller keeps the last valid state, whose age grows."""
    for _ in range(8):
        last = rig.tick()
    runaway = np.array(((speed_mps, 0.0, 0.0),))
    monkeypatch.setattr(rig.bridge._car.plant, "step", lambda control, dt_s: runaway)
    sent = len(rig.arrived.of(STATE.codecs[1]))
    while not rig.bridge.is_over:
        kept = rig.tick()
    assert rig.bridge.has_failed
    assert kept == last
    assert rig.newest(MISSION).is_engaged
    for codec in STATE.codecs[:2]:
        is_valid = [frame[1] >> 4 & 1 for frame in rig.arrived.of(codec)]
        assert is_valid == [1] * sent + [0] * (END_TICKS + 1)
    for frame in rig.arrived.of(STATE.codecs[1])[sent:]:
        assert any(isnan(value) for value in STATE.codecs[1].decode(frame))
    summary = rig.bridge.summary()
    assert words in str(summary.plant_failure)
    assert summary.final_speed_mps == pytest.approx(last.state.vx_mps, abs=0.01)


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


def test_a_silent_controller_ends_in_a_standing_car(rig: BridgeRig) -> None:
    for _ in range(10):
        rig.tick()
    for _ in range(3):
        assert not rig.tick(control=None).is_watchdog_braking
    assert rig.tick(control=None).is_watchdog_braking
    while not rig.bridge.is_over:
        rig.tick(control=None)
        if not rig.newest(MISSION).is_engaged:
            assert rig.newest(FEEDBACK).brake_n > 0.0
    assert rig.bridge.summary().watchdog_braked
    assert rig.bridge.summary().braking_cause == "NO_COMMAND"
    assert rig.bridge.summary().final_speed_mps < 0.5
    assert rig.newest(FEEDBACK).brake_n == pytest.approx(MOST_BRAKE_N, abs=0.01)


@pytest.mark.parametrize("is_crash", [True, False])
def test_silence_after_a_stopped_car_is_the_end_of_a_drive_and_not_after_a_crash(
    rig: BridgeRig, is_crash: bool
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


def test_a_safe_stop_that_outlasts_the_scenario_brings_the_car_to_rest(rig: BridgeRig) -> None:
    ticks = load_scenario("straight").ticks
    braking = ControlInput(0.0, 75.0, 0.0)
    for _ in range(ticks - 20):
        rig.tick()
    for _ in range(20 * round(1 / PERIOD_S)):
        rig.tick(braking, Mode.SAFE_STOP)
        if rig.bridge.is_over:
            break
        if rig.newest(MISSION).is_engaged and rig.bridge.applied.throttle == 0.0:
            assert rig.newest(FEEDBACK).brake_n == braking.brake_n
    assert rig.bridge.is_over
    assert rig.bridge.summary().ticks > ticks + END_TICKS
    assert rig.bridge.summary().final_speed_mps < AT_REST_MPS


@pytest.mark.parametrize("ended_after", [None, 10])
def test_the_end_of_the_mission_is_sent_before_the_bridge_leaves(
    rig: BridgeRig, ended_after: int | None
) -> None:
    """It leaves later if the controller drives on: the mission may take long on its way."""
    ticks = 0
    while not rig.bridge.is_over:
        if ticks == ended_after:
            rig.bridge.end_mission()
        rig.tick()
        ticks += 1
    # The first command arrives a period later; a request ends the mission with the next tick.
    last = load_scenario("straight").ticks if ended_after is None else ended_after
    assert ticks == last + LONGEST_END_TICKS
    assert not rig.newest(MISSION).is_engaged
    assert not rig.bridge.summary().watchdog_braked


def test_a_car_is_released_by_standby_after_the_end_of_the_mission(rig: BridgeRig) -> None:
    for _ in range(3):
        rig.tick()
    rig.bridge.end_mission()
    rig.tick()
    assert not rig.bridge.summary().released
    for _ in range(2):  # the command arrives a period later
        rig.tick(NEUTRAL_INPUT, Mode.STANDBY)
    assert rig.bridge.summary().released


def _unplug(*_: object, **__: object) -> None:
    raise can.CanOperationError("unplugged")


def test_a_car_whose_bus_fails_is_braked_to_rest_and_before_the_drive_it_is_an_error(
    rig: BridgeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch, open_bridge() as other:
        patch.setattr(other.bus, "recv", _unplug)
        with pytest.raises(BusError, match="unplugged"):
            other.tick(control=None)
    for _ in range(10):
        rig.tick()
    monkeypatch.setattr(rig.bus, "recv", _unplug)
    for _ in range(1000):
        if not rig.bridge.is_over:
            rig.tick()
    summary = rig.bridge.summary()
    assert rig.bridge.is_over
    assert summary.watchdog_braked
    assert summary.final_speed_mps < AT_REST_MPS
    with pytest.raises(BusError, match="unplugged"):
        rig.bridge.require_readable_bus()


def test_of_two_commands_in_one_period_a_foreign_car_gets_the_newest_once() -> None:
    car = example()
    writer, passed = command_writer(car), []
    with open_bus("virtual", "foreign") as wire, open_bus("virtual", "foreign") as far_end:
        bus = ForeignBus(wire, car, lambda: 20.0)
        vehicle, inbox = Outbox(bus, Node.VEHICLE), Inbox(Node.VEHICLE)
        for period in range(6):
            vehicle.send(STATE, SAMPLE, 0, counter=period)
            for number in (2 * period, 2 * period + 1):
                values = {"throttle": number / 20, "brake_n": 0.0, "steer_rad": 0.0}
                named = {f"commands.{name}": value for name, value in values.items()}
                named["commands.mode"] = float(Mode.NOMINAL)
                for frame in writer.frames(named, number, True):
                    far_end.send(frame)
            while (received := bus.recv(0)) is not None:
                inbox.accept(received, period)
            newest = inbox.newest(COMMAND)
            passed.append(None if newest is None else newest.content.control.throttle)
    assert inbox.counts.contradicting == 0
    assert inbox.counts.wrong_sequence == 0
    assert passed == pytest.approx([(2 * period + 1) / 20 for period in range(6)], abs=0.01)


PATIENCE_S = 10.0


@dataclass(slots=True)
class EndlessBridge:
    """A bridge whose controller drives on for some ticks after the end of the mission."""

    ticks_after_end: int
    is_waiting: bool = False
    ticks: int = 0
    is_mission_over: bool = False

    @property
    def is_over(self) -> bool:
        return self.is_mission_over and self.ticks_after_end < 0

    def end_mission(self) -> None:
        self.is_mission_over = True

    def tick(self, _: int) -> None:
        self.ticks += 1
        self.ticks_after_end -= self.is_mission_over

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("requests", "ticks_after_end", "is_waiting"),
    [
        (1, 2, False),  # the first ends the mission
        (2, 10**6, False),  # the second ends at once
        (1, 10**6, True),  # no mission yet
        (0, 10**6, False),  # closed
    ],
)
def test_the_first_request_ends_the_mission_and_the_second_one_the_thread(
    requests: int, ticks_after_end: int, is_waiting: bool
) -> None:
    bridge = EndlessBridge(ticks_after_end, is_waiting)
    session = BridgeSession(open_bus("virtual", "session"), cast(Bridge, cast(Any, bridge)))
    thread = session.start(priority=0)
    for _ in range(requests):
        session.request_stop()
    thread.join(PATIENCE_S * (requests > 0))
    is_ended = not thread.is_alive()
    session.close()
    assert is_ended is session.is_stop_requested is (requests > 0)
    assert not thread.is_alive()
