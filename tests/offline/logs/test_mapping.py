"""A mapping file is parsed, and refused with the names of its wrong fields."""

from pathlib import Path

import pytest
from made_logs import MAPPING, POSE

from offline.logs.mapping import read_mapping
from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.quantity import Quantity

EXAMPLES = Path(__file__).parents[3] / "examples"


ROLE = '[roles]\nodd = ["steer_rad"]\n'
SPEED = '"speed", unit = "m/s"'


@pytest.mark.parametrize(
    ("changes", "extra", "message"),
    [
        ({}, "[spilt]\nseed = 1\n", "spilt"),
        ({}, "[split]\nseed = -1\n", "split.seed: .*found -1"),
        ({}, "[car]\nwheelbase_m = 2910.0\n", "car.wheelbase_m: .*found 2910"),
        ({}, '[csv]\ndelimiter = "::"\n', "csv.delimiter: .*found '::'"),
        ({}, "[inputs.more]\nunit = 'N'\n", "inputs.more.column"),
        ({}, "[inputs.more]\ncolumn = 'x'\nkeep = [9, 3]\n", "inputs.more.keep"),
        ({}, "[inputs.more]\ncolumn = 'x'\ndelay_s = inf\n", "delay_s: .*found inf"),
        ({SPEED: '"speed", unit = "km/hh"'}, "", "km/h .*found 'km/hh'"),
        ({SPEED: '"speed", unit = "deg/s"'}, "", "m/s, .*found 'deg/s'"),
        ({SPEED: '"speed", unit = "deg/s"'}, ROLE, r"vx_mps: (.|\n)*roles\.odd: .*steer_rad"),
        ({SPEED: '"speed", unit = "m/z"', 'column = "wheel"': 'colum = "wheel"'}, "")
        + (r"mapping\.toml(.|\n)*states\.vx_mps\.unit(.|\n)*inputs\.road_wheel_rad\.colum",),
        ({'"time"': ""}, "", "line 3"),
        ({"vy_mps": "slip_mps"}, POSE, "states vx_mps, vy_mps, yaw_rate_radps"),
        ({'column = "time"': 'file = "t.npy"'}, "", r"time\.file"),
        ({SPEED: f'{SPEED}, file = "v.csv"'}, "", "column side: expected a file"),
    ],
)
def test_a_wrong_field_is_named_with_the_value_found(parse, changes, extra, message):
    text = MAPPING
    for old, new in changes.items():
        text = text.replace(old, new)
    with pytest.raises(ConfigError, match=message):
        parse(text + extra)


def test_a_missing_mapping_file_is_refused_with_its_name(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        read_mapping(tmp_path / "nowhere.toml")


def test_the_quantity_follows_from_the_name_or_from_the_mapping(parse):
    mapping = parse(MAPPING.replace("force_n = {", 'pull_n = { quantity = "drive", '))
    assert mapping.quantity("yaw_rate_radps") is Quantity.YAW_RATE
    assert mapping.name_of(Quantity.DRIVE) == "pull_n"


def test_default_roles_assume_no_symmetry_and_the_past_has_the_order_of_the_signals(parse):
    roles = parse().resolve_roles()
    assert (roles.centred, roles.odd) == (("vx_mps",), None)
    assert roles.past == ("vx_mps", "vy_mps", "yaw_rate_radps", "road_wheel_rad", "force_n")
    roles = parse(MAPPING + '[roles]\npast = ["force_n", "vx_mps"]\n').resolve_roles()
    assert roles.past == ("vx_mps", "force_n")


def test_paths_are_relative_to_the_mapping_file(parse, tmp_path):
    text = MAPPING + '[can]\ndbc = "car.dbc"\n' + POSE + 'reference_line = "track.csv"\n'
    mapping = parse(text)
    assert mapping.can.dbc == tmp_path / "car.dbc"
    assert mapping.pose.reference_line == tmp_path / "track.csv"


@pytest.mark.parametrize("name", ["av21", "can", "comma2k19", "files", "gti"])
def test_every_example_is_a_valid_mapping(name):
    mapping, _ = read_mapping(EXAMPLES / f"import_{name}.toml")
    assert mapping.quantity("vx_mps") is Quantity.SPEED
