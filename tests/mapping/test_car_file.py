"""A mapping file for driving is refused with the names of what is missing."""

import pytest
from own_car import EXAMPLE, example

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.car_file import find_source, load_dbc, read_car


def changed(tmp_path, *replacements):
    text = EXAMPLE.read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    for name in ("car.dbc", "line.csv"):
        (tmp_path / name).write_text((EXAMPLE.parent / name).read_text())
    path = tmp_path / "car.toml"
    path.write_text(text)
    return path


def test_the_example_has_no_lateral_speed_and_no_place_on_the_road():
    mapping = example().mapping
    assert set(mapping.states) == {"vx_mps", "yaw_rate_radps"}
    assert mapping.roles is not None


def test_the_example_is_a_mapping_of_offline_import_too():
    log_mapping = pytest.importorskip("offline.logs.mapping")
    mapping, _ = log_mapping.read_mapping(EXAMPLE)
    assert mapping.state_names == ("vx_mps", "yaw_rate_radps", "ds_m", "ey_m", "epsi_rad")
    assert mapping.places_roads is False


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("vx_mps = {", "vy_mps = {", r"states: expected vx_mps, yaw_rate_radps"),
        ("[messages.", "[mesages.", r"mesages: no such setting \(did you mean messages\?\)"),
        ('reference_line = "line.csv"\n', "", "expected the place on the road"),
        (
            *('"VehicleSpeed", unit = "km/h"', '"VehicleSpeed", unit = "deg/s"'),
            r"vx_mps: expected a unit that is converted to m/s",
        ),
        (
            *("[messages.WheelSpeed]", "[messages.WheelSped]"),
            r"messages of car\.dbc, found WheelSped",
        ),
    ],
)
def test_a_mapping_for_driving_is_refused_with_what_is_missing(tmp_path, old, new, message):
    with pytest.raises(ConfigError, match=message):
        read_car(changed(tmp_path, (old, new)))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r".*none\.toml: expected a mapping file"):
        read_car(tmp_path / "none.toml")


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8"])
def test_a_unit_is_read_in_either_encoding_of_a_dbc(tmp_path, encoding):
    path = tmp_path / "car.dbc"
    message = 'BO_ 291 Inertial: 8 CAR\n SG_ YawRate : 7|16@0- (0.01,0) [-300|300] "°/s" CAR\n'
    path.write_bytes(f'VERSION ""\nBU_: CAR\n{message}'.encode(encoding))
    assert find_source("here", load_dbc(path), "YawRate").signal.unit == "°/s"
