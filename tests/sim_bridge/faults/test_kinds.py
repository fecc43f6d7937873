"""Each kind of fault at the vehicle's end of the bus: the frames that arrive are others."""

from collections.abc import Iterator
from functools import cache
from itertools import permutations
from typing import Any

import pytest
from faulty_drive import FAULTY_TICKS, START_TICK, FaultyDrive, Frame

from rt_controller.bus.catalogue import (
    COMMAND,
    MISSION,
    PREVIEW,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
)
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.bus import CODECS

DURING = range(START_TICK, START_TICK + FAULTY_TICKS)
EXAMPLES: dict[str, dict[str, Any]] = {
    "drop": {"messages": ["STATE_B"]},
    "delay": {"messages": ["state"], "delay_s": 0.05},
    "duplicate": {"messages": ["reference"]},
    "reorder": {"messages": ["state"]},
    "replay": {"messages": ["ACT_CMD"], "delay_s": 0.1},
    "corrupt": {"messages": ["vehicle"]},
    "burst": {"messages": ["vehicle"], "delay_s": 0.075},
    "bus_off": {},
    "masquerade": {"messages": ["MISSION"], "values": {"Engage": 0}},
    "freeze": {"messages": ["STATE_A", "STATE_B"]},
    "lag": {"messages": ["STATE_A"], "delay_s": 0.075},
    "scale": {"signals": ["vx_mps"], "value": -1.0},
    "bias": {"signals": ["LateralError"], "value": 0.5},
    "drift": {"signals": ["ey_m"], "value": 1.0},
    "noise": {"signals": ["STATE_A.YawRate"], "value": 0.1},
    "quantise": {"signals": ["vx_mps"], "value": 3.0},
    "set": {"signals": ["SteeringWheelAngle"], "value": 120.0},
    "rate": {"signals": ["ey_m"], "value": 1e-3},
    "stuck": {"signals": ["steer_rad"]},
}


@pytest.fixture
def drive(request: pytest.FixtureRequest) -> Iterator[FaultyDrive]:
    """Driven until just before the fault."""
    before = FaultyDrive([request.param])
    yield before.run(START_TICK - 1)
    before.close()


@cache
def driven(kind: str | None) -> FaultyDrive:
    """A drive with the example of a kind, or without a fault; each is driven once."""
    faults = () if kind is None else ({"kind": kind, **EXAMPLES[kind]},)
    drive = FaultyDrive(faults).run(DURING.stop + 4)
    drive.close()
    return drive


def counters(drive: FaultyDrive) -> list[int]:
    by_id = {codec.arbitration_id: codec for codec in CODECS.values()}
    return [by_id[f.arbitration_id].counter_of(f.data) for f in drive.to_controller]


def arrived(drive: FaultyDrive, before: int) -> list[Frame]:
    return [f for f in (*drive.to_controller, *drive.to_vehicle) if f.tick < before]


@pytest.mark.parametrize("kind", list(EXAMPLES))
def test_frames_differ_from_the_begin_of_a_fault_on_and_not_before(kind: str) -> None:
    faulty, good = driven(kind), driven(None)
    everything = DURING.stop + 5
    assert arrived(faulty, START_TICK) == arrived(good, START_TICK)
    assert arrived(faulty, everything) != arrived(good, everything)


@pytest.mark.parametrize("kind", list(EXAMPLES))
def test_only_a_corrupted_frame_fails_its_check(kind: str) -> None:
    codecs = {codec.arbitration_id: codec for codec in CODECS.values()}
    intact = [codecs[f.arbitration_id].is_intact(f.data) for f in arrived(driven(kind), 99)]
    assert all(intact) == (kind != "corrupt")


@pytest.mark.parametrize("kind", ["freeze", "bias", "noise", "lag"])
def test_counters_go_on_in_frames_with_wrong_values(kind: str) -> None:
    assert counters(driven(kind)) == counters(driven(None))


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({"kind": "state_lost"}, STATE),
        ({"kind": "drop", "messages": ["STATE_C"]}, STATE),
        ({"kind": "state_invalid"}, STATE),
        ({"kind": "reference_lost"}, REFERENCE),
        ({"kind": "preview_lost"}, PREVIEW),
        ({"kind": "bus_off"}, STATE),
        ({"kind": "corrupt", "messages": ["REF_PATH"], "count": 3}, REFERENCE),
    ],
    indirect=["drive"],
)
def test_a_lost_message_is_missing_while_the_fault_acts(drive: FaultyDrive, message: Any) -> None:
    assert drive.ticks_with(message, FAULTY_TICKS) == 0
    assert drive.ticks_with(message, 3) == 3


@pytest.mark.parametrize("drive", [{"kind": "state_lost"}], indirect=True)
def test_lost_frames_leave_a_gap_in_the_counters(drive: FaultyDrive) -> None:
    assert drive.bridge.faults_so_far() == ()
    drive.run(FAULTY_TICKS + 1)
    assert drive.bridge.faults_so_far() == ("state_lost from 0.25 s for 0.125 s",)
    assert drive.received.counts.counter_gap_frames == 3 * FAULTY_TICKS


@pytest.mark.parametrize("drive", [{"kind": "mission_lost"}], indirect=True)
def test_a_lost_mission_is_missing_while_the_fault_acts(drive: FaultyDrive) -> None:
    assert drive.ticks_with(MISSION, FAULTY_TICKS) == 0
    assert drive.ticks_with(MISSION, 4) == 1


@pytest.mark.parametrize("drive", [{"kind": "command_lost"}], indirect=True)
def test_lost_commands_make_the_watchdog_brake(drive: FaultyDrive) -> None:
    assert drive.run(FAULTY_TICKS).bridge.summary().watchdog_braked


def received(drive: FaultyDrive, field: str, ticks: int) -> list[float]:
    found = []
    for _ in range(ticks):
        drive.tick()
        newest = drive.received.newest(STATE)
        assert newest is not None
        found.append(getattr(newest.content.state, field))
    return found


@pytest.mark.parametrize(
    "drive", [{"kind": "state_offset", "signal": "ey_m", "value": 0.5}], indirect=True
)
def test_an_offset_is_added_to_one_signal(drive: FaultyDrive) -> None:
    good = FaultyDrive(()).run(START_TICK - 1)
    true = received(good, "ey_m", FAULTY_TICKS + 1)
    seen = received(drive, "ey_m", FAULTY_TICKS + 1)
    offsets = [a - b for a, b in zip(seen, true, strict=True)]
    assert offsets == pytest.approx([0.5] * FAULTY_TICKS + [0.0], abs=2e-3)


@pytest.mark.parametrize("drive", [{"kind": "freeze", "messages": ["STATE_A"]}], indirect=True)
def test_a_frozen_signal_keeps_the_value_of_the_first_tick(drive: FaultyDrive) -> None:
    seen = received(drive, "vx_mps", FAULTY_TICKS + 1)
    assert len(set(seen[:-1])) == 1
    assert seen[-1] != seen[0]


@pytest.mark.parametrize(
    "drive", [{"kind": "lag", "messages": ["state"], "delay_s": 0.075}], indirect=True
)
def test_lagging_signals_are_those_of_earlier_periods(drive: FaultyDrive) -> None:
    good = FaultyDrive(()).run(START_TICK - 4)
    true = received(good, "vx_mps", FAULTY_TICKS)
    assert received(drive, "vx_mps", FAULTY_TICKS) == true


@pytest.mark.parametrize(
    "drive", [{"kind": "delay", "messages": ["state"], "delay_s": 0.075}], indirect=True
)
def test_delayed_frames_arrive_later_and_together_with_the_next_ones_at_the_end(
    drive: FaultyDrive,
) -> None:
    assert drive.ticks_with(STATE, 3) == 0
    assert drive.ticks_with(STATE, FAULTY_TICKS - 3) == FAULTY_TICKS - 3
    frames = len(drive.to_controller)
    drive.tick()
    number = CODECS["STATE_A"].arbitration_id
    late = [f for f in drive.to_controller[frames:] if f.arbitration_id == number]
    assert len(late) == 4
    assert drive.received.counts.counter_gap_frames == 0


@pytest.mark.parametrize("drive", [{"kind": "stuck", "signals": ["steer_rad"]}], indirect=True)
def test_a_stuck_actuator_does_not_follow_and_the_feedback_shows_it(drive: FaultyDrive) -> None:
    before = len(drive.applied)
    drive.run(FAULTY_TICKS + 1)
    wheel = [control.steer_rad for control in drive.applied[before:]]
    assert len(set(wheel[:-1])) == 1
    assert wheel[-1] > wheel[0]


@pytest.mark.parametrize(
    "drive",
    [{"kind": "masquerade", "messages": ["ACT_CMD"], "values": {"SteeringWheelAngle": -30.0}}],
    indirect=True,
)
def test_frames_of_a_third_participant_reach_both_ends(drive: FaultyDrive) -> None:
    drive.run(3)
    codec = COMMAND.codecs[0]
    assert codec.arbitration_id in {frame.arbitration_id for frame in drive.to_controller}
    wheel_deg = [
        codec.decode(frame.data)[-1]
        for frame in drive.to_vehicle
        if frame.arbitration_id == codec.arbitration_id
    ]
    assert wheel_deg.count(-30.0) == 2  # what is sent in the first tick is read in the next one
    assert drive.bridge.applied.steer_rad > 0.0  # the vehicle follows neither of two sources


@pytest.mark.parametrize(
    "drive",
    [{"kind": "masquerade", "messages": ["IDENT_VEHICLE"], "values": {"IDENT_VEHICLE.DbcHash": 1}}],
    indirect=True,
)
def test_a_foreign_frame_has_the_named_values_and_the_other_ones_of_the_genuine(
    drive: FaultyDrive,
) -> None:
    drive.tick()
    found = drive.received.newest(VEHICLE_IDENTITY)
    assert found is not None
    assert found.content == (1, None)


@pytest.mark.parametrize(
    "drive", [{"kind": "masquerade", "frame_id": 0x7A, "data": "0102", "count": 5}], indirect=True
)
def test_a_frame_that_no_catalogue_has_can_be_sent_in_any_number(drive: FaultyDrive) -> None:
    drive.run(2)
    assert [f.data for f in drive.to_controller if f.arbitration_id == 0x7A] == [b"\1\2"] * 10


@pytest.mark.parametrize(
    "drive",
    [{"kind": "drop", "messages": ["state"], "probability": 0.5, "seed": 3, "duration_s": 2.5}],
    indirect=True,
)
def test_a_probability_affects_a_share_of_the_frames_the_same_one_each_time(
    drive: FaultyDrive,
) -> None:
    frames = len(drive.to_controller)
    drive.run(100)
    ids = {CODECS[name].arbitration_id for name in ("STATE_A", "STATE_B", "STATE_C")}
    kept = sum(frame.arbitration_id in ids for frame in drive.to_controller[frames:])
    assert 110 < kept < 190


def test_a_fault_may_act_before_the_car_is_driven() -> None:
    fault = {"kind": "drop", "messages": ["ACT_CMD"], "start_s": 0.0, "before_drive": True}
    drive = FaultyDrive([fault]).run(12)
    assert drive.bridge.is_waiting
    drive.close()


def test_faults_that_act_together_have_the_same_effect_in_any_order() -> None:
    faults = (
        {"kind": "bias", "signals": ["vx_mps"], "value": 0.5},
        {"kind": "freeze", "messages": ["STATE_A"], "start_s": 12 * PERIOD_S},
        {"kind": "lag", "messages": ["state"], "delay_s": 0.05},
        {"kind": "lag", "messages": ["state"], "delay_s": 0.025},
    )
    seen = set()
    for order in list(permutations(faults))[::9]:
        drive = FaultyDrive(order)
        seen.add(tuple(received(drive, "vx_mps", 20)[5:]))
        drive.close()
    assert len(seen) == 1
