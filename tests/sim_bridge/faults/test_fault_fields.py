"""What a fault may say, and how it is refused."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import LISTED_ERRORS
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.bus import CODECS
from sim_bridge.faults.fault import SHORTHANDS, Fault, ticks_between
from sim_bridge.faults.kinds import KINDS
from sim_bridge.faults.names import ACTUATOR, SignalName, frames_of, known_frames
from sim_bridge.scenario import parse_scenario
from sim_bridge.scenario.loading import add_faults

SCENARIO = parse_scenario(
    {"format": 2, "name": "x", "duration_s": 5.0, "reference": {"speed_kmh": 80.0}}, "test"
)


def test_the_names_are_those_of_the_catalogue() -> None:
    names = known_frames()
    assert set(names) == {*CODECS, ACTUATOR}
    for name, codec in CODECS.items():
        assert names[name].number == codec.arbitration_id
        assert names[name].signals == tuple(signal.name for signal in codec.signals)
        assert names[name].sender == codec.sender


def test_groups_stand_for_their_frames() -> None:
    assert frames_of("state") == ("STATE_A", "STATE_B", "STATE_C")
    assert set(frames_of("controller")) == {"ACT_CMD", "CTRL_HB", "IDENT_CONTROLLER"}
    assert set(frames_of("all")) == {*frames_of("controller"), *frames_of("vehicle")}


@pytest.mark.parametrize("name", ["vx_mps", "VelocityX", "STATE_A.VelocityX"])
def test_a_signal_has_the_name_of_the_contract_or_of_the_dbc(name: str) -> None:
    fault = Fault(kind="bias", signals=(name,), value=1.0)
    assert fault.targets == (SignalName("STATE_A", "VelocityX"),)


def test_messages_stand_for_all_their_signals() -> None:
    fault = Fault(kind="freeze", messages=("STATE_A",))
    assert [each.signal for each in fault.targets] == ["VelocityX", "VelocityY", "YawRate"]


def test_without_a_duration_a_fault_acts_to_the_end() -> None:
    assert Fault(kind="bus_off", start_s=1.0).acts(100_000)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "gremlins"}, "expected one of lag, freeze"),
        ({"kind": "drop"}, "messages: expected a value for drop, found none"),
        ({"kind": "drop", "messages": ["STATES"]}, "did you mean"),
        ({"kind": "drop", "messages": []}, "expected at least one entry"),
        ({"kind": "drop", "messages": ["state"], "value": 1.0}, "value: expected none for drop"),
        ({"kind": "delay", "messages": ["state"]}, "delay_s: expected a value for delay"),
        ({"kind": "bias", "messages": ["STATE_A"]}, "value: expected a value for bias"),
        ({"kind": "bias", "value": 1.0}, "messages: expected a value for bias"),
        ({"kind": "bias", "signals": ["Mode"], "value": 1.0}, "expected the frame too"),
        ({"kind": "bias", "signals": ["VelocityZ"], "value": 1.0}, "did you mean Velocity"),
        ({"kind": "stuck"}, "signal: expected a value for stuck"),
        ({"kind": "stuck", "signals": ["ey_m"]}, "expected actuators for stuck"),
        ({"kind": "drop", "messages": ["state"], "counter": "own"}, "counter: expected none"),
        ({"kind": "drop", "messages": ["state"], "probability": 1.5}, "less than or equal to 1"),
        ({"kind": "masquerade", "frame_id": 5, "data": "0g"}, "hexadecimal"),
        ({"kind": "mission_lost", "duration_s": 0.05}, "at least 4 control periods"),
        ({"kind": "freeze", "messages": ["state"], "duration_s": 0.025}, "at least 2"),
        ({"kind": "rate", "signals": ["steer_rad"]}, "value: expected a value for rate"),
        ({"kind": "rate", "signals": ["steer_rad"], "value": 0.0}, "more than 0 for rate"),
        ({"kind": "bus_off", "messages": ["state"]}, "messages: expected none for bus_off"),
    ],
)
def test_fields_that_do_not_fit_the_kind_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Fault(**fields)
    assert message in str(refused.value)


@pytest.mark.parametrize("name", SHORTHANDS)
def test_every_shorthand_is_a_fault(name: str) -> None:
    extra: dict[str, Any] = {
        "state_offset": {"signal": "ey_m", "value": 0.1},
        "state_noise": {"signal": "ey_m", "value": 0.1},
        "state_delayed": {"delay_s": 0.05},
    }.get(name, {})
    fault = Fault(kind=name, **extra)
    assert fault.base in KINDS
    assert fault.frames or fault.targets
    assert fault.text.startswith(name)


def test_a_file_of_faults_is_added_to_a_scenario(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text('[[faults]]\nkind = "bus_off"\nstart_s = 1.0\n')
    assert [each.kind for each in add_faults(SCENARIO, path).faults] == ["bus_off"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("faults = 3", "faults: expected"),
        ("faults = []", "faults: expected"),
        ('[[faults]]\nkind = "drop"\n', "faults[0].messages: expected a value for drop"),
        ('[[faults]]\nkind = "bus_off"\nstart_s = 5.0', "faults[0].start_s: expected less than"),
        ('[[faults]]\nkind = "bus_off"\nbegin_s = 5.0', "faults[0].begin_s: no such setting"),
        ("[[faults", "expected a TOML file"),
        ("# \udce9", "expected a TOML file"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_with_its_fields(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "faults.toml"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(ConfigError) as refused:
        add_faults(SCENARIO, path)
    assert message in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_fault_acts_in_as_many_ticks_as_its_duration_has_periods() -> None:
    for first in range(1, 80):
        for length in range(1, 100):
            expected = range(first, first + length)
            assert ticks_between(first * PERIOD_S, length * PERIOD_S) == expected
    assert ticks_between(0.0, 0.05) == range(1, 3)
    assert len(ticks_between(1.001, 0.01)) == 0


def test_a_file_with_too_many_faults_is_refused_by_their_number(tmp_path: Path) -> None:
    file = tmp_path / "many.toml"
    file.write_text('[[faults]]\nkinds = "drop"\n' * 200)
    with pytest.raises(ConfigError, match=r"faults: expected at most 100 entries, found 200\.$"):
        add_faults(SCENARIO, file)


def test_of_many_errors_the_first_ones_are_listed(tmp_path: Path) -> None:
    file = tmp_path / "many.toml"
    file.write_text('[[faults]]\nkinds = "drop"\n' * 100)
    with pytest.raises(ConfigError, match=r"more\. Correct these first\.$") as refused:
        add_faults(SCENARIO, file)
    assert len(str(refused.value).splitlines()) == 1 + LISTED_ERRORS + 1


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        (
            {"kind": "scale", "signals": ["brake_n"], "value": 0.3},
            "scale of ACTUATOR.brake_n from 0 s on",
        ),
        (
            {"kind": "drop", "messages": ["STATE_B"], "start_s": 2.01, "duration_s": 0.1},
            "drop of STATE_B from 2.01 s for 0.1 s",
        ),
        ({"kind": "state_lost", "start_s": 3.0}, "state_lost from 3 s on"),
        (
            {"kind": "drop", "messages": ["vehicle"]},
            "drop of STATE_A, STATE_B, STATE_C and 7 more from 0 s on",
        ),
    ],
)
def test_a_fault_is_named_with_its_targets_and_the_time_that_was_written(
    fields: dict[str, Any], expected: str
) -> None:
    assert Fault.model_validate(fields).text == expected
