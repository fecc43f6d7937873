"""A mapping file says what a column means, and is refused where it does not."""

from pathlib import Path

import pytest
from made_logs import MAPPING, POSE

from offline.logs.mapping_file import read_mapping
from offline.logs.quantity import Quantity
from rt_controller.contract.errors import ConfigError

EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("import_*.toml"))


def test_signals_keep_the_order_they_are_written_in(parse):
    mapping = parse()
    assert list(mapping.signals) == [
        "vx_mps",
        "vy_mps",
        "yaw_rate_radps",
        "road_wheel_rad",
        "force_n",
    ]
    assert mapping.columns == ("speed", "side", "turn", "wheel", "force")


def test_every_mistake_is_named_at_once(parse):
    text = MAPPING.replace('"m/s" }', '"m/z" }', 1).replace('column = "wheel"', 'colum = "wheel"')
    with pytest.raises(ConfigError) as caught:
        parse(text)
    message = str(caught.value)
    assert "states.vx_mps.unit" in message
    assert "inputs.road_wheel_rad.colum" in message
    assert "mapping.toml" in message


@pytest.mark.parametrize(
    ("extra", "complaint"),
    [
        ("[spilt]\nseed = 1\n", "spilt: expected a known field"),
        ("[split]\nseed = -1\n", "split.seed: .*found -1"),
        ('[csv]\ndelimiter = "::"\n', "csv.delimiter: .*found '::'"),
        ("[inputs.more]\nunit = 'N'\n", "inputs.more.column: expected that field, found nothing"),
        ("[inputs.more]\ncolumn = 'x'\nkeep = [9, 3]\n", r"keep: expected \[low, high\], found"),
        ("[inputs.more]\ncolumn = 'x'\ndelay_s = inf\n", "delay_s: .*found inf"),
    ],
)
def test_a_mistake_is_named_with_its_field_and_what_was_found(parse, extra, complaint):
    with pytest.raises(ConfigError, match=complaint):
        parse(MAPPING + extra)


def test_an_unknown_unit_is_answered_with_near_ones(parse):
    with pytest.raises(ConfigError, match=r"did you mean.*km/h"):
        parse(MAPPING.replace('"speed", unit = "m/s"', '"speed", unit = "km/hh"'))


def test_a_unit_that_contradicts_the_signals_name_is_refused(parse):
    with pytest.raises(ConfigError, match="becomes m/s, as the name says, found 'deg/s'"):
        parse(MAPPING.replace('"speed", unit = "m/s"', '"speed", unit = "deg/s"'))


def test_a_mistake_in_toml_is_named_with_its_line(parse):
    with pytest.raises(ConfigError, match="line 2"):
        parse("[time]\ncolumn =\n")


def test_a_missing_mapping_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        read_mapping(tmp_path / "nowhere.toml")


def test_known_names_say_what_they_measure_and_others_may_be_told(parse):
    mapping = parse(
        MAPPING.replace(
            'force_n = { column = "force"', 'pull_n = { quantity = "drive", column = "force"'
        )
    )
    assert mapping.quantity("yaw_rate_radps") is Quantity.YAW_RATE
    assert mapping.name_of(Quantity.DRIVE) == "pull_n"


def test_roles_have_defaults_that_assume_no_symmetry(parse):
    roles = parse().resolve_roles()
    assert roles.centred == ("vx_mps",)
    assert roles.odd is None
    assert roles.past == ("vx_mps", "vy_mps", "yaw_rate_radps", "road_wheel_rad", "force_n")


def test_the_past_is_in_the_order_of_the_signals_however_it_is_written(parse):
    roles = parse(MAPPING + '[roles]\npast = ["force_n", "vx_mps"]\n').resolve_roles()
    assert roles.past == ("vx_mps", "force_n")


def test_a_role_of_an_unknown_signal_is_refused(parse):
    with pytest.raises(ConfigError, match=r"roles\.odd.*found steer_rad"):
        parse(MAPPING + '[roles]\nodd = ["steer_rad"]\n')


def test_poses_bring_the_states_of_the_path_and_the_curvature(parse):
    mapping = parse(MAPPING + POSE)
    assert mapping.state_names[3:] == ("ds_m", "ey_m", "epsi_rad")
    assert mapping.exogenous_names == ("curvature_per_m",)


def test_roads_are_laid_under_the_states_of_a_car_only(parse):
    with pytest.raises(ConfigError, match="expected the states vx_mps, vy_mps, yaw_rate_radps"):
        parse(MAPPING.replace("vy_mps", "slip_mps") + POSE)


def test_paths_are_relative_to_the_mapping(parse, tmp_path):
    text = MAPPING + '[can]\ndbc = "car.dbc"\n' + POSE + 'reference_line = "track.csv"\n'
    mapping = parse(text)
    assert mapping.can.dbc == tmp_path / "car.dbc"
    assert mapping.pose.reference_line == tmp_path / "track.csv"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_are_mappings(path):
    mapping, _ = read_mapping(path)
    assert mapping.quantity("vx_mps") is Quantity.SPEED


def test_there_are_examples():
    assert len(EXAMPLES) >= 3
