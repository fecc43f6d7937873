"""What a fault may say, and how it is refused."""

from contextlib import closing
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import PERIOD_S
from rt_controller.settings import BusSettings, CarSettings
from rt_controller.simulation import open_virtual_car
from sim_bridge.faults.bus import CODECS
from sim_bridge.faults.fault import SHORTHANDS, Fault
from sim_bridge.faults.kinds import KINDS
from sim_bridge.faults.names import ACTUATOR, FRAMES, MESSAGES, SignalName, signals_of
from sim_bridge.scenario import parse_scenario
from sim_bridge.scenario.loading import add_faults

SCENARIO = parse_scenario(
    {"format": 2, "name": "x", "duration_s": 5.0, "reference": {"speed_kmh": 80.0}}, "test"
)


def test_the_names_are_those_of_the_catalogue() -> None:
    assert set(FRAMES) == {*CODECS, ACTUATOR}
    for name, codec in CODECS.items():
        assert (FRAMES[name].number, FRAMES[name].sender) == (codec.arbitration_id, codec.sender)
        assert [each.signal for each in signals_of(name)] == [each.name for each in codec.signals]
    assert set(MESSAGES["controller"]) == {"ACT_CMD", "CTRL_HB", "IDENT_CONTROLLER"}
    assert {*MESSAGES["controller"], *MESSAGES["vehicle"]} == set(MESSAGES["all"])


@pytest.mark.parametrize("name", ["vx_mps", "VelocityX", "STATE_A.VelocityX"])
def test_a_signal_has_the_name_of_the_contract_or_of_the_dbc(name: str) -> None:
    for fields in ({"signals": (name,)}, {"signal": name}):
        fault = Fault.model_validate({"kind": "bias", "value": 1.0, **fields})
        assert fault.targets == (SignalName("STATE_A", "VelocityX"),)
    all_of_it = Fault(kind="freeze", messages=("STATE_A",)).targets
    assert [each.signal for each in all_of_it] == ["VelocityX", "VelocityY", "YawRate"]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "gremlins"}, "expected one of lag, freeze"),
        ({"kind": "drop"}, "messages: expected messages for drop, found none"),
        ({"kind": "drop", "messages": ["STATES"]}, "did you mean"),
        ({"kind": "drop", "messages": []}, "expected at least one entry"),
        ({"kind": "drop", "messages": ["state"], "value": 1.0}, "value: expected none for drop"),
        ({"kind": "delay", "messages": ["state"]}, "delay_s: expected a value for delay"),
        ({"kind": "bias", "messages": ["STATE_A"]}, "value: expected a value for bias"),
        ({"kind": "bias", "value": 1.0}, "signals: expected signals or messages for bias"),
        ({"kind": "state_delayed", "delay_s": 0.1, "signal": "ey_m"}, "found signals and messages"),
        ({"kind": "bias", "signals": ["Mode"], "value": 1.0}, "where several frames"),
        ({"kind": "bias", "signals": ["VelocityZ"], "value": 1.0}, "did you mean Velocity"),
        ({"kind": "stuck"}, "signals: expected signals for stuck"),
        ({"kind": "drop", "messages": ["state"], "counter": "own"}, "counter: expected none"),
        ({"kind": "drop", "messages": ["state"], "probability": 1.5}, "less than or equal to 1"),
        ({"kind": "masquerade", "frame_id": 5, "data": "0g"}, "hexadecimal"),
        ({"kind": "masquerade", "frame_id": 5, "data": "00" * 65}, "at most 64"),
        ({"kind": "bus_off", "start_s": 1.001, "duration_s": 0.01}, "at least 1 control period"),
        ({"kind": "freeze", "messages": ["state"], "duration_s": 0.025}, "at least 2"),
        ({"kind": "rate", "signals": ["steer_rad"], "value": 0.0}, "more than 0 for rate"),
        ({"kind": "bus_off", "messages": ["state"]}, "messages: expected none for bus_off"),
    ],
)
def test_fields_that_do_not_fit_the_kind_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Fault(**fields)
    assert message in str(refused.value)


def test_every_shorthand_is_a_fault() -> None:
    one = {"signal": "ey_m", "value": 0.1}
    extra = {"state_offset": one, "state_noise": one, "state_delayed": {"delay_s": 0.05}}
    for name in SHORTHANDS:
        fault = Fault.model_validate({"kind": name, **extra.get(name, {})})
        assert fault.kind in KINDS
        assert fault.frames or fault.targets


FILE = '[[faults]]\nkind = "bus_off"\nstart_s = 1.0\n'


def test_a_file_of_faults_is_added_to_a_scenario(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text(FILE)
    settings = CarSettings(scenario="straight", faults=path)
    with closing(open_virtual_car(BusSettings(bus="virtual", channel="faults"), settings)) as car:
        assert [each.kind for each in car.bridge.scenario.faults] == ["bus_off"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "expected a TOML file"),
        ("faults = 3", "faults: expected"),
        ("faults = []", "faults: expected"),
        ('[[faults]]\nkind = "drop"\n', "faults[0].messages: expected messages for drop"),
        (FILE.replace("1.0", "5.0"), "faults[0].start_s: expected less than"),
        (FILE.replace("start_s", "begin_s"), "faults[0].begin_s: no such setting"),
        (FILE + 'signal = "a"\nsignals = []', "faults[0].signal: no such setting"),
        ("[[faults", "expected a TOML file"),
        ("# \udce9", "expected a TOML file"),
        (FILE * 200, "faults: expected at most 100 entries, found 200."),
    ],
)
def test_a_file_that_does_not_fit_is_refused_with_its_fields(
    tmp_path: Path, text: str | None, message: str
) -> None:
    path = tmp_path / "faults.toml"
    if text is not None:
        path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(ConfigError) as refused:
        add_faults(SCENARIO, path)
    assert message in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_fault_acts_in_as_many_ticks_as_its_duration_has_periods() -> None:
    for first, length in product(range(1, 60, 7), range(1, 100, 9)):
        times = {"start_s": first * PERIOD_S, "duration_s": length * PERIOD_S}
        assert Fault(kind="bus_off", **times).ticks == range(first, first + length)
    assert Fault(kind="bus_off", duration_s=0.05).ticks == range(1, 3)
    assert Fault(kind="bus_off", start_s=1.0).acts(100_000)


def test_a_fault_is_named_with_its_targets_and_the_time_that_was_written() -> None:
    brake = Fault(kind="scale", signals=("brake_n",), value=0.3)
    assert brake.text == "scale of ACTUATOR.brake_n from 0 s on"
    lost = Fault(kind="drop", messages=("vehicle",), start_s=2.01, duration_s=0.1)
    assert lost.text == "drop of STATE_A, STATE_B, STATE_C and 7 more from 2.01 s for 0.1 s"
