"""Each kind of fault at the vehicle's end of the bus: the frames that arrive are others."""

from collections.abc import Iterator
from contextlib import closing
from functools import cache
from itertools import permutations
from typing import Any

import pytest
from faulty_drive import FAULTY_TICKS, START_TICK, FaultyDrive, Frame

from rt_controller.bus.messages import MISSION, PREVIEW, REFERENCE, STATE, VEHICLE_IDENTITY
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.bus import CODECS

DURING = range(START_TICK, START_TICK + FAULTY_TICKS)
_LATE = {"delay_s": 0.075}
EXAMPLES: dict[str, dict[str, Any]] = {
    "drop": {"messages": ["STATE_B"]},
    "delay": {"messages": ["state"], **_LATE},
    "replay": {"messages": ["ACT_CMD"], **_LATE},
    "burst": {"messages": ["vehicle"], **_LATE},
    "lag": {"messages": ["STATE_A"], **_LATE},
    **{kind: {"messages": ["state"]} for kind in ("duplicate", "reorder", "corrupt", "freeze")},
    **{kind: {"signals": ["ey_m"], "value": 1.0} for kind in ("bias", "drift", "noise", "set")},
    **{kind: {"signals": ["vx_mps"], "value": 3.0} for kind in ("scale", "quantise")},
    "rate": {"signals": ["ey_m"], "value": 1e-3},
    "masquerade": {"messages": ["MISSION"], "values": {"Engage": 0}},
    "stuck": {"signals": ["steer_rad"]},
    "bus_off": {},
}
BY_ID = {codec.arbitration_id: codec for codec in CODECS.values()}


@pytest.fixture
def drive(request: pytest.FixtureRequest) -> Iterator[FaultyDrive]:
    """Driven until just before the fault."""
    with closing(FaultyDrive([request.param])) as before:
        yield before.run(START_TICK - 1)


def under(kind: str, **fields: Any) -> pytest.MarkDecorator:
    """The test has a drive with this fault."""
    return pytest.mark.parametrize("drive", [{"kind": kind, **fields}], indirect=True)


@cache
def driven(kind: str | None) -> FaultyDrive:
    """A drive with the example of a kind, or without a fault; each is driven once."""
    faults = () if kind is None else ({"kind": kind, **EXAMPLES[kind]},)
    with closing(FaultyDrive(faults)) as drive:
        return drive.run(DURING.stop + 4)


def arrived(drive: FaultyDrive, before: int) -> list[Frame]:
    return [f for f in (*drive.to_controller, *drive.to_vehicle) if f.tick < before]


def of_id(frames: list[Frame], *names: str) -> list[Frame]:
    ids = {CODECS[name].arbitration_id for name in names}
    return [frame for frame in frames if frame.arbitration_id in ids]


def received(drive: FaultyDrive, field: str, ticks: int) -> list[float]:
    found = []
    for _ in range(ticks):
        drive.tick()
        newest = drive.received.newest(STATE)
        assert newest is not None
        found.append(getattr(newest.content.state, field))
    return found


@pytest.mark.parametrize("kind", list(EXAMPLES))
def test_frames_differ_from_the_begin_of_a_fault_on_and_not_before(kind: str) -> None:
    faulty, good = driven(kind), driven(None)
    assert arrived(faulty, START_TICK) == arrived(good, START_TICK)
    assert arrived(faulty, 99) != arrived(good, 99)
    intact = [(BY_ID[f.arbitration_id].check(f.data) >= 0) for f in arrived(faulty, 99)]
    assert all(intact) == (kind != "corrupt")


@pytest.mark.parametrize("kind", ["freeze", "bias", "noise", "lag"])
def test_counters_go_on_in_frames_with_wrong_values(kind: str) -> None:
    with_faults, without = (
        [BY_ID[f.arbitration_id].check(f.data) for f in driven(each).to_controller]
        for each in (kind, None)
    )
    assert with_faults == without


@pytest.mark.parametrize(
    ("drive", "message", "after"),
    [
        ({"kind": "state_lost"}, STATE, 3),
        ({"kind": "drop", "messages": ["STATE_C"]}, STATE, 3),
        ({"kind": "state_invalid"}, STATE, 3),
        ({"kind": "reference_lost"}, REFERENCE, 3),
        ({"kind": "preview_lost"}, PREVIEW, 3),
        ({"kind": "bus_off"}, STATE, 3),
        ({"kind": "corrupt", "messages": ["REF_PATH"], "count": 3}, REFERENCE, 3),
        ({"kind": "mission_lost"}, MISSION, 1),  # in 4 periods
    ],
    indirect=["drive"],
)
def test_a_lost_message_is_missing_while_the_fault_acts(
    drive: FaultyDrive, message: Any, after: int
) -> None:
    assert drive.ticks_with(message, FAULTY_TICKS) == 0
    assert drive.ticks_with(message, 3 if after == 3 else 4) == after


@under("state_lost")
def test_lost_frames_leave_a_gap_in_the_counters(drive: FaultyDrive) -> None:
    assert drive.bridge.faults_so_far() == ()
    drive.run(FAULTY_TICKS + 1)
    (text,) = drive.bridge.faults_so_far()
    assert text == "drop of STATE_A, STATE_B, STATE_C from 0.25 s for 0.125 s"
    assert drive.received.counts.counter_gap_frames == 3 * FAULTY_TICKS


@under("command_lost")
def test_lost_commands_make_the_watchdog_brake(drive: FaultyDrive) -> None:
    assert drive.run(FAULTY_TICKS).bridge.summary().watchdog_braked


@under("delay", messages=["state"], delay_s=0.075)
def test_delayed_frames_arrive_later_and_together_with_the_next_ones_at_the_end(
    drive: FaultyDrive,
) -> None:
    assert drive.ticks_with(STATE, 3) == 0
    assert drive.ticks_with(STATE, FAULTY_TICKS - 3) == FAULTY_TICKS - 3
    frames = len(drive.to_controller)
    drive.tick()
    assert len(of_id(drive.to_controller[frames:], "STATE_A")) == 4
    assert drive.received.counts.counter_gap_frames == 0


@under("masquerade", messages=["ACT_CMD"], values={"SteeringWheelAngle": -30.0})
def test_frames_of_a_third_participant_reach_both_ends(drive: FaultyDrive) -> None:
    drive.run(3)
    assert of_id(drive.to_controller, "ACT_CMD")
    frames = of_id(drive.to_vehicle, "ACT_CMD")
    wheel_deg = [CODECS["ACT_CMD"].decode(frame.data)[-1] for frame in frames]
    assert wheel_deg.count(-30.0) == 2  # what is sent in the first tick is read in the next one
    assert drive.bridge.applied.steer_rad > 0.0  # the vehicle follows neither of two sources


@under("masquerade", messages=["IDENT_VEHICLE"], values={"IDENT_VEHICLE.DbcHash": 1})
def test_a_foreign_frame_has_the_named_values_and_the_other_ones_of_the_genuine(
    drive: FaultyDrive,
) -> None:
    drive.tick()
    found = drive.received.newest(VEHICLE_IDENTITY)
    assert found is not None
    assert found.content == (1, None)


@under("masquerade", frame_id=0x7A, data="0102", count=5)
def test_a_frame_that_no_catalogue_has_can_be_sent_in_any_number(drive: FaultyDrive) -> None:
    drive.run(2)
    assert [f.data for f in drive.to_controller if f.arbitration_id == 0x7A] == [b"\1\2"] * 10


@under("drop", messages=["state"], probability=0.5, seed=3, duration_s=2.5)
def test_a_probability_affects_a_share_of_the_frames(drive: FaultyDrive) -> None:
    frames = len(drive.to_controller)
    drive.run(100)
    kept = of_id(drive.to_controller[frames:], "STATE_A", "STATE_B", "STATE_C")
    assert 110 < len(kept) < 190


def test_a_fault_may_act_before_the_car_is_driven() -> None:
    fault = {"kind": "drop", "messages": ["ACT_CMD"], "start_s": 0.0, "before_drive": True}
    with closing(FaultyDrive([fault]).run(12)) as drive:
        assert drive.bridge.is_waiting


def test_faults_that_act_together_have_the_same_effect_in_any_order() -> None:
    faults = (
        {"kind": "bias", "signals": ["vx_mps"], "value": 0.5},
        {"kind": "freeze", "messages": ["STATE_A"], "start_s": 12 * PERIOD_S},
        {"kind": "lag", "messages": ["state"], "delay_s": 0.05},
        {"kind": "lag", "messages": ["state"], "delay_s": 0.025},
    )
    seen = set()
    for order in list(permutations(faults))[::9]:
        with closing(FaultyDrive(order)) as drive:
            seen.add(tuple(received(drive, "vx_mps", 20)[5:]))
    assert len(seen) == 1
