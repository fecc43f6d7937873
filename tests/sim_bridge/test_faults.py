"""Faults of a scenario at the vehicle's end of the bus."""

from collections.abc import Iterator
from itertools import count, permutations
from typing import Any

import pytest

from rt_controller.bus.catalogue import (
    COMMAND,
    MISSION,
    PREVIEW,
    REFERENCE,
    STATE,
    Command,
    StateSample,
)
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import AT_REST, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from sim_bridge.bridge import Bridge
from sim_bridge.faults import FaultInjector
from sim_bridge.scenario import parse_scenario
from sim_bridge.scenario.faults import Fault, FaultKind, ticks_between
from sim_bridge.session import build_car

_channels = count()
START_TICK, FAULTY_TICKS = 10, 8


class Drive:
    """A bridge whose scenario has one fault, with a scripted controller."""

    def __init__(self, fault: dict[str, Any], bus, controller_bus) -> None:
        times = {"start_s": START_TICK * PERIOD_S, "duration_s": FAULTY_TICKS * PERIOD_S}
        content = {
            "format": 2, "name": "faulty", "duration_s": 5.0, "reference": {"speed_kmh": 50.0},
            "faults": [fault | times],
        }  # fmt: skip
        scenario = parse_scenario(content, "test")
        self.bridge = Bridge(bus, build_car(scenario), scenario)
        self.bus, self.received = controller_bus, Inbox(Node.CONTROLLER)
        self.controller = Outbox(controller_bus, Node.CONTROLLER)
        self.now_ns = 0

    def tick(self) -> None:
        self.now_ns += PERIOD_NS
        state = self.received.newest(STATE)
        counter = 0 if state is None else state.counter
        command = Command(ControlInput(0.1, 0.0, 0.0), Mode.NOMINAL)
        self.controller.send(COMMAND, command, self.now_ns, counter=counter)
        self.bridge.tick(self.now_ns)
        self.received.drain(self.bus, self.now_ns)

    def received_in(self, message, ticks: int) -> int:
        """Number of ticks that brought a new content of a message."""
        found = 0
        for _ in range(ticks):
            before = self.received.newest(message)
            self.tick()
            found += self.received.newest(message) is not before
        return found


@pytest.fixture
def drive(request: pytest.FixtureRequest) -> Iterator[Drive]:
    channel = f"faults-{next(_channels)}"
    with open_bus("virtual", channel) as bus, open_bus("virtual", channel) as other:
        driven = Drive(request.param, bus, other)
        for _ in range(START_TICK - 1):
            driven.tick()
        yield driven


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({"kind": "state_lost"}, STATE),
        ({"kind": "state_invalid"}, STATE),
        ({"kind": "reference_lost"}, REFERENCE),
        ({"kind": "preview_lost"}, PREVIEW),
    ],
    indirect=["drive"],
)
def test_a_lost_message_is_missing_while_the_fault_acts(drive: Drive, message) -> None:
    assert drive.received_in(message, FAULTY_TICKS) == 0
    assert drive.received_in(message, 3) == 3


@pytest.mark.parametrize("drive", [{"kind": "state_lost"}], indirect=True)
def test_lost_frames_leave_a_gap_in_the_counters(drive: Drive) -> None:
    assert drive.bridge.faults_so_far() == ()
    drive.received_in(STATE, FAULTY_TICKS + 1)
    assert drive.bridge.faults_so_far() == ("state_lost from 0.25 s",)
    assert drive.received.counts.counter_gap_frames == 3 * FAULTY_TICKS


@pytest.mark.parametrize("drive", [{"kind": "mission_lost"}], indirect=True)
def test_a_lost_mission_is_missing_while_the_fault_acts(drive: Drive) -> None:
    assert drive.received_in(MISSION, FAULTY_TICKS) == 0
    assert drive.received_in(MISSION, 4) == 1


@pytest.mark.parametrize("drive", [{"kind": "command_lost"}], indirect=True)
def test_lost_commands_make_the_watchdog_brake(drive: Drive) -> None:
    for _ in range(FAULTY_TICKS):
        drive.tick()
    assert drive.bridge.summary().watchdog_braked


@pytest.mark.parametrize(
    "drive", [{"kind": "state_offset", "signal": "ey_m", "value": 0.5}], indirect=True
)
def test_an_offset_is_added_to_one_signal(drive: Drive) -> None:
    seen = []
    for _ in range(FAULTY_TICKS + 1):
        drive.tick()
        newest = drive.received.newest(STATE)
        assert newest is not None
        seen.append(newest.content.state.ey_m)
    assert seen == pytest.approx([0.5] * FAULTY_TICKS + [0.0], abs=2e-3)


def sample(k: int) -> StateSample:
    return StateSample(AT_REST._replace(vx_mps=float(k)), 0.0, k * PERIOD_NS, None, False)


def test_a_delay_repeats_older_samples_with_their_stamps() -> None:
    injector = FaultInjector([Fault(FaultKind.STATE_DELAYED, range(4, 44), delay_ticks=3)])
    sent = [injector.sample(sample(k), k).sample_time_ns // PERIOD_NS for k in range(8)]
    assert sent == [0, 1, 2, 3, 1, 2, 3, 4]


def test_a_frozen_state_is_repeated_with_new_stamps() -> None:
    injector = FaultInjector([Fault(FaultKind.STATE_FROZEN, range(2, 5))])
    sent = [injector.sample(sample(k), k) for k in range(7)]
    assert [one.state.vx_mps for one in sent] == [0.0, 1.0, 2.0, 2.0, 2.0, 5.0, 6.0]
    assert [one.sample_time_ns for one in sent] == [k * PERIOD_NS for k in range(7)]


def test_noise_has_its_deviation_and_is_repeatable() -> None:
    def noisy() -> list[float]:
        fault = Fault(FaultKind.STATE_NOISE, range(2000), "vy_mps", 0.2, seed=3)
        injector = FaultInjector([fault])
        return [injector.sample(sample(0), k).state.vy_mps for k in range(2000)]

    values = noisy()
    assert (sum(v * v for v in values) / 2000) ** 0.5 == pytest.approx(0.2, rel=0.05)
    assert values == noisy()


def test_a_fault_acts_in_as_many_ticks_as_its_duration_has_periods() -> None:
    for first in range(1, 80):
        for length in range(1, 100):
            expected = range(first, first + length)
            assert ticks_between(first * PERIOD_S, length * PERIOD_S) == expected
    assert ticks_between(0.0, 0.05) == range(1, 3)
    assert len(ticks_between(1.001, 0.01)) == 0


def test_faults_that_act_together_have_the_same_effect_in_any_order() -> None:
    faults = (
        Fault(FaultKind.STATE_OFFSET, range(1, 9), "vx_mps", 0.5),
        Fault(FaultKind.STATE_FROZEN, range(5, 8)),
        Fault(FaultKind.STATE_DELAYED, range(2, 9), delay_ticks=2),
        Fault(FaultKind.STATE_DELAYED, range(2, 9), delay_ticks=1),
    )
    for order in permutations(faults):
        injector = FaultInjector(order)
        sent = [injector.sample(sample(k), k).state.vx_mps for k in range(10)]
        assert sent == [0.0, 1.5, 0.5, 1.5, 2.5, 3.5, 3.5, 3.5, 6.5, 9.0]
