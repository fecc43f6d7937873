"""A mapping file and a log are refused with the names of what is missing or damaged."""

import can
import pytest
from own_car import EXAMPLE

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.car_file import find_source, load_dbc, read_car
from rt_controller.mapping.log_damage import explain_damage, is_candump_line


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
    with pytest.raises(ConfigError, match=r".*none\.toml: expected a mapping file"):
        read_car(tmp_path / "none.toml")


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8"])
def test_a_unit_is_read_in_either_encoding_of_a_dbc(tmp_path, encoding):
    path = tmp_path / "car.dbc"
    message = 'BO_ 291 Inertial: 8 CAR\n SG_ YawRate : 7|16@0- (0.01,0) [-300|300] "°/s" CAR\n'
    path.write_bytes(f'VERSION ""\nBU_: CAR\n{message}'.encode(encoding))
    assert find_source("here", load_dbc(path), "YawRate").signal.unit == "°/s"


@pytest.mark.parametrize(
    "line",
    [
        "(1.000000) can0 123#",
        "(1.000000) can0 00000123#0102 R\n",
        "(1.000000) can0 123##10102",
        "(1.000000) can0 123#R8",
        "(1.000000) can0 20000004#0000000000000000",
    ],
)
def test_lines_of_candump_are_whole(line):
    assert is_candump_line(line)


@pytest.mark.parametrize(
    "line", ["(17", "(1.0) can0", "(x) can0 123#00", "(1.0) can0 123#ZZ", "(1.0) can0 123#012"]
)
def test_a_damaged_line_of_candump_is_named_with_its_number(tmp_path, line):
    log = tmp_path / "a.log"
    log.write_text(f"(1.0) can0 123#00\n\n{line}\n")
    expected = r"(seconds) channel ID#DATA with ID and DATA in hexadecimal digits"
    assert explain_damage(log, 1) == f"{log}, line 3: expected {expected}, found {line!r}"


def test_a_damaged_log_of_another_format_is_named_with_the_frame(tmp_path):
    log = tmp_path / "a.asc"
    with can.ASCWriter(log) as writer:
        for number in range(3):
            writer.on_message_received(can.Message(timestamp=number, data=[number]))
    log.write_text(log.read_text().replace(" 02\n", " ZZ\n"))
    n_frames = 0
    with pytest.raises(ValueError, match="ZZ"), can.LogReader(log) as reader:  # noqa: PT012
        for _ in reader:
            n_frames += 1
    assert f"{log}, frame 3: expected a frame in the format .asc" in explain_damage(log, n_frames)


def test_a_log_without_any_frame_is_no_log_of_its_format(tmp_path):
    log = tmp_path / "a.blf"
    log.write_bytes(b"text")
    assert "expected a CAN log in the format of its suffix" in explain_damage(log, 0)
