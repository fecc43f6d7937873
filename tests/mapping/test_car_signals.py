"""A mapping file for driving is refused with the names of what is missing."""

import pytest
from own_car import EXAMPLE, example

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.car_file import read_car


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


def test_a_speed_is_required(tmp_path):
    path = changed(tmp_path, ("vx_mps = {", "vy_mps = {"))
    with pytest.raises(ConfigError, match=r"states: expected vx_mps, yaw_rate_radps"):
        read_car(path)


def test_a_place_on_the_road_is_required(tmp_path):
    path = changed(tmp_path, ('reference_line = "line.csv"\n', ""))
    with pytest.raises(ConfigError, match="expected the place on the road"):
        read_car(path)


def test_a_unit_of_another_quantity_is_refused(tmp_path):
    path = changed(tmp_path, ('"VehicleSpeed", unit = "km/h"', '"VehicleSpeed", unit = "deg/s"'))
    with pytest.raises(ConfigError, match=r"vx_mps: expected a unit that is converted to m/s"):
        read_car(path)


def test_a_message_that_is_not_in_the_dbc_is_refused(tmp_path):
    path = changed(tmp_path, ("[messages.WheelSpeed]", "[messages.WheelSped]"))
    with pytest.raises(ConfigError, match=r"messages of car\.dbc, found WheelSped"):
        read_car(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r".*none\.toml: expected a mapping file"):
        read_car(tmp_path / "none.toml")
