"""Faults: what one may say, the values that it leaves, and the frames that arrive."""

import re
import tomllib
from collections.abc import Iterator
from contextlib import closing
from functools import cache
from itertools import permutations, product
from pathlib import Path
from typing import Any

import can
import pytest
from bridge_rig import FAULTY_TICKS, START_TICK, FaultyDrive, Frame
from pydantic import ValidationError

from rt_controller.bus.messages import MISSION, PREVIEW, REFERENCE, STATE
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT
from rt_controller.contract.timing import PERIOD_S
from rt_controller.settings import BusSettings, CarSettings
from rt_controller.simulation import open_virtual_car
from sim_bridge.faults.bus import FaultyBus
from sim_bridge.faults.effects import CODECS
from sim_bridge.faults.fault import KINDS, SHORTHANDS, Fault, FaultFile
from sim_bridge.faults.names import SignalName
from sim_bridge.scenario import parse_scenario
from sim_bridge.scenario.loading import add_faults

DURING = range(START_TICK, START_TICK + FAULTY_TICKS)
LATE = {"delay_s": 0.075}
EXAMPLES: dict[str, dict[str, Any]] = {
    "drop": {"messages": ["STATE_B"]},
    "delay": {"messages": ["state"], **LATE},
    "replay": {"messages": ["ACT_CMD"], **LATE},
    "burst": {"messages": ["vehicle"], **LATE},
    "lag": {"messages": ["STATE_A"], **LATE},
    **{kind: {"messages": ["state"]} for kind in ("duplicate", "reorder", "corrupt", "freeze")},
    **{kind: {"signals": ["ey_m"], "value": 1.0} for kind in ("bias", "drift", "noise", "set")},
    **{kind: {"signals": ["vx_mps"], "value": 3.0} for kind in ("scale", "quantise")},
    "rate": {"signals": ["ey_m"], "value": 1e-3},
    "masquerade": {"messages": ["MISSION"], "values": {"Engage": 0}},
    "stuck": {"signals": ["steer_rad"]},
    "bus_off": {},
    "jitter": {"value": 10.0},
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
        drive.run(1)
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
    if kind in ("freeze", "bias", "noise", "lag"):  # the counters go on
        found, without = (
            [BY_ID[f.arbitration_id].check(f.data) for f in each.to_controller]
            for each in (faulty, good)
        )
        assert found == without


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
    drive.run(1)
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


SCENARIO = parse_scenario(
    {"format": 2, "name": "x", "duration_s": 5.0, "reference": {"speed_kmh": 80.0}}, "test"
)


def test_a_signal_has_the_name_of_the_contract_or_of_the_dbc() -> None:
    for name in ("vx_mps", "VelocityX", "STATE_A.VelocityX"):
        fault = Fault.model_validate({"kind": "bias", "value": 1.0, "signal": name})
        assert fault.targets == (SignalName("STATE_A", "VelocityX"),)
    all_of_it = Fault(kind="freeze", messages=("STATE_A",)).targets
    assert [each.signal for each in all_of_it] == ["VelocityX", "VelocityY", "YawRate"]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "gremlins"}, "expected one of jitter, lag"),
        ({"kind": "drop"}, "messages: expected messages for drop, found none"),
        ({"kind": "drop", "messages": ["state"], "value": 1.0}, "value: expected none for drop"),
        ({"kind": "delay", "messages": ["state"]}, "delay_s: expected a value for delay"),
        ({"kind": "bias", "value": 1.0}, "signals: expected signals or messages for bias"),
        ({"kind": "state_delayed", "delay_s": 0.1, "signal": "ey_m"}, "found signals and messages"),
        ({"kind": "bias", "signals": ["Mode"], "value": 1.0}, "where several frames"),
        ({"kind": "bias", "signals": ["VelocityZ"], "value": 1.0}, "did you mean Velocity"),
        ({"kind": "bias", "signals": ["ey"], "value": 1.0}, "did you mean ey_m?"),
        ({"kind": "drop", "messages": ["state"], "counter": "own"}, "counter: expected none"),
        ({"kind": "drop", "messages": ["state"], "probability": 1.5}, "less than or equal to 1"),
        ({"kind": "masquerade", "frame_id": 5, "data": "0g"}, "hexadecimal"),
        ({"kind": "bus_off", "start_s": 1.001, "duration_s": 0.01}, "at least 1 control period"),
        ({"kind": "freeze", "messages": ["state"], "duration_s": 0.025}, "at least 2"),
        ({"kind": "rate", "signals": ["steer_rad"], "value": 0.0}, "more than 0 for rate"),
        ({"kind": "jitter", "value": 13.0}, "at most half a control period in ms, found 13"),
        ({"kind": "bus_off", "messages": ["state"]}, "messages: expected none for bus_off"),
    ],
)
def test_fields_that_do_not_fit_the_kind_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Fault(**fields)
    assert message in str(refused.value)


FILE = '[[faults]]\nkind = "bus_off"\nstart_s = 1.0\n'


def test_a_file_of_faults_is_added_to_a_scenario(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text(FILE)
    settings = CarSettings(scenario="straight", faults=path)
    with closing(open_virtual_car(BusSettings(bus="virtual", channel="faults"), settings)) as car:
        assert [each.kind for each in car.bridge.scenario.faults] == ["bus_off"]


def test_a_fault_acts_in_as_many_ticks_as_its_duration_has_periods() -> None:
    for first, length in product(range(1, 60, 7), range(1, 100, 9)):
        times = {"start_s": first * PERIOD_S, "duration_s": length * PERIOD_S}
        assert Fault(kind="bus_off", **times).ticks == range(first, first + length)
    assert Fault(kind="bus_off", duration_s=0.05).ticks == range(1, 3)
    assert Fault(kind="bus_off", start_s=1.0).acts(100_000)


def distorted(fields: dict[str, Any], ticks: range, values: list[float]) -> list[float]:
    """The angle, tick by tick; `ticks` are those of the fault."""
    start_s, duration_s = ticks.start * PERIOD_S, len(ticks) * PERIOD_S
    signals = ("ACTUATOR.steer_rad",)
    fault = Fault(signals=signals, start_s=start_s, duration_s=duration_s, **fields)
    with can.Bus(interface="virtual", channel="distortion") as bus:
        actuators = FaultyBus(bus, [fault])
        found = [
            actuators.actuated(NEUTRAL_INPUT._replace(brake_n=10.0, steer_rad=value), tick)
            for tick, value in enumerate(values)
        ]
    assert {each.brake_n for each in found} == {10.0}, "the other values are not changed"
    return [each.steer_rad for each in found]


RAMP = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
LAG_2, LAG_9 = 2 * PERIOD_S, 9 * PERIOD_S


@pytest.mark.parametrize(
    ("fields", "ticks", "expected"),
    [
        ({"kind": "freeze"}, range(2, 5), [0, 1, 2, 2, 2, 5]),
        ({"kind": "lag", "delay_s": LAG_2}, range(2, 5), [0, 1, 0, 1, 2, 5]),
        ({"kind": "lag", "delay_s": LAG_9}, range(1, 3), [0, 0, 0, 3, 4, 5]),
        ({"kind": "scale", "value": -1.0}, range(2, 4), [0, 1, -2, -3, 4, 5]),
        ({"kind": "bias", "value": 0.5}, range(2, 4), [0, 1, 2.5, 3.5, 4, 5]),
        ({"kind": "drift", "value": 4.0}, range(2, 5), [0, 1, 2.1, 3.2, 4.3, 5]),
        ({"kind": "quantise", "value": 2.0}, range(1, 6), [0, 0, 2, 4, 4, 4]),
        ({"kind": "set", "value": 9.0}, range(4, 9), [0, 1, 2, 3, 9, 9]),
        ({"kind": "rate", "value": 20.0}, range(2, 5), [0, 1, 1.5, 2, 2.5, 5]),
        ({"kind": "rate", "value": 80.0}, range(2, 5), [0, 1, 2, 3, 4, 5]),
        ({"kind": "stuck"}, range(3, 5), [0, 1, 2, 3, 3, 5]),
        ({"kind": "stuck", "value": 7.0}, range(3, 5), [0, 1, 2, 7, 7, 5]),
    ],
)
def test_a_distortion_changes_a_ramp_while_it_acts(
    fields: dict[str, Any], ticks: range, expected: list[float]
) -> None:
    assert distorted(fields, ticks, RAMP) == pytest.approx(expected)


def test_noise_has_its_deviation_and_is_repeatable() -> None:
    ticks, still = range(1, 2000), [0.0] * 2000
    values = distorted({"kind": "noise", "value": 0.2, "seed": 3}, ticks, still)
    assert (sum(v * v for v in values) / 2000) ** 0.5 == pytest.approx(0.2, rel=0.05)
    assert values == distorted({"kind": "noise", "value": 0.2, "seed": 3}, ticks, still)
    assert values != distorted({"kind": "noise", "value": 0.2, "seed": 4}, ticks, still)


GUIDE = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
GUIDE_EXAMPLES = re.findall(r"`(\{ kind = .*? \})`", GUIDE)
GUIDE_FILES = re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)


@under("masquerade", frame_id=0x7A, data="0102", count=5)
def test_a_frame_that_no_catalogue_has_can_be_sent_in_any_number(drive: FaultyDrive) -> None:
    drive.run(2)
    assert [f.data for f in drive.to_controller if f.arbitration_id == 0x7A] == [b"\1\2"] * 10


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "expected a faults file"),
        ("[[faults", "expected a TOML file"),
        ("faults = []", "faults: expected"),
        ('[[faults]]\nkind = "drop"\n', "faults[0].messages: expected messages for drop"),
        (FILE.replace("1.0", "5.0"), "faults[0].start_s: expected less than"),
        (FILE.replace("start_s", "begin_s"), "faults[0].begin_s: no such setting"),
        (FILE * 200, "faults: expected 1 to 100 entries, found 200."),
    ],
)
def test_a_file_that_does_not_fit_is_refused_with_its_fields(
    tmp_path: Path, text: str | None, message: str
) -> None:
    path = tmp_path / "faults.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        add_faults(SCENARIO, path)
    assert message in str(refused.value)
    assert str(path) in str(refused.value)


def test_the_guide_has_every_kind_and_field_and_its_examples_are_faults() -> None:
    faults = [Fault(**tomllib.loads(f"fault = {text}")["fault"]) for text in GUIDE_EXAMPLES]
    assert {fault.kind for fault in faults} == set(KINDS)
    for name in (*SHORTHANDS, *Fault.model_fields):
        assert re.search(rf"\b{name}\b", GUIDE), name
    assert len(FaultFile.model_validate(tomllib.loads(GUIDE_FILES[0])).faults) == 2
