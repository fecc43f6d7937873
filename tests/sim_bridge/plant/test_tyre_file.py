"""Tyre property files: what is read and refused, alone and with a car file."""

import re
from importlib import resources
from math import radians
from pathlib import Path

import pytest
from made_tyre import TYRE_FILE_TEXT

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.parameters import default_car, load_parameters
from sim_bridge.plant.tyre_file import parse_tyre_file, read_tyre_file
from sim_bridge.validation.run import input_table, replay

CAR_TEXT = (resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml").read_text("utf-8")
ENTRY = 'tyre_file = { value = "made.tir", source = "estimate: a made file" }\n'
TYRE = parse_tyre_file(TYRE_FILE_TEXT, "made.tir")


def test_units_are_converted_and_the_side_is_read_in_any_case() -> None:
    assert TYRE.fnomin == pytest.approx(4500.0)
    assert TYRE.unloaded_radius == pytest.approx(0.334)
    for side, is_right in (("left", 0.0), ("Right", 1.0), ("SYMMETRIC", 0.0)):
        found = parse_tyre_file(TYRE_FILE_TEXT.replace("LEFT", side), "made.tir")
        assert found.is_right == is_right


NOT_A_FRICTION = "PDY1, LMUY: expected a peak friction of either sign of 0.2"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("PKY2 = 2.48\n", "", "PKY2: expected a value, found none"),
        ("PCY1 = 1.42", "PCY1 = big", "LATERAL_COEFFICIENTS.PCY1: expected a number, found 'big'"),
        ("FORCE = 'kN'", "FORCE = 'stone'", "UNITS.FORCE: expected one of newton"),
        ("FORCE = 'kN'\n", "", "UNITS.FORCE: expected one of newton, n, kilonewton, kn, pound"),
        ("'radians'", "'degree'", "UNITS.ANGLE: expected one of radians"),
        ("FITTYP = 52", "FITTYP = 21", "MODEL.FITTYP: expected one of 5, 6, 52"),
        ("PKY1 = -24.1", "PKY1 = 24.1", "PKY1: expected a negative number"),
        ("PDX2 = -0.05", "PDX1 = 0.9", "PDX1: expected one value, found a second"),
        ("FNOMIN = 4.5", "FNOMIN = 0.0", "FNOMIN: expected more than 0"),
        ("RCX1 = 1.1", "RCX1", "expected KEY = value, found 'RCX1'"),
        (
            "LENGTH = 'mm'",
            "LENGTH = 'm'",
            "UNLOADED_RADIUS: expected a radius in m of 0.1 to 2, fo",
        ),
        ("PDY1 = 0.96", "PDY1 = 9.6", NOT_A_FRICTION),
        ("PDY1 = 0.96", "PDY1 = 0.0", NOT_A_FRICTION),
        ("PDX1 = 0.97", "PDX1 = 0.097", "PDX1, LMUX: expected a peak friction of 0.2 to 2.5"),
        ("PKX1 = 18.7", "PKX1 = 1.0", "PKX1, LKX: expected a slip stiffness over load of 2 to 200"),
        ("PKY1 = -24.1", "PKY1 = -0.42", "LKY: expected a cornering stiffness over load of 2 to"),
        ("'LEFT'", "'Links'", "MODEL.TYRESIDE: expected one of left, right, symmetric"),
        ("LMUX = 1.0", "LMUX = 0.0", "LMUX: expected more than 0.0, found 0.0"),
        ("LMUX = 1.0", "PKY4 = 0.0", "PKY4: expected more than 0.0, found 0.0"),
    ],
)
def test_a_faulty_file_is_refused_with_the_name_of_the_key(
    old: str, new: str, message: str
) -> None:
    assert old in TYRE_FILE_TEXT
    with pytest.raises(ConfigError, match=r"made\.tir:\n  .*" + re.escape(message)):
        parse_tyre_file(TYRE_FILE_TEXT.replace(old, new), "made.tir")


def test_all_faults_of_a_file_are_reported_at_once() -> None:
    text = TYRE_FILE_TEXT.replace("PKY2 = 2.48\n", "").replace("'radians'", "'degree'")
    with pytest.raises(ConfigError, match=r"(?s)UNITS\.ANGLE.*PKY2"):
        parse_tyre_file(text, "made.tir")


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected a tyre file"):
        read_tyre_file(tmp_path / "none.tir")


def write_car(folder: Path, car_text: str, tyre_text: str = TYRE_FILE_TEXT) -> Path:
    """A car file with a tyre file beside it."""
    (folder / "made.tir").write_text(tyre_text, encoding="utf-8")
    (folder / "car.toml").write_text(car_text, encoding="utf-8")
    return folder / "car.toml"


def test_a_car_with_a_tyre_file_drives_a_bend_like_one_without(tmp_path: Path) -> None:
    with_file = load_parameters(write_car(tmp_path, ENTRY + CAR_TEXT))
    assert with_file.tyre_file == TYRE
    inputs = input_table(160, 0.12, steer_rad=radians(20.0))
    yaw = [replay(car, 20.0, inputs, 0.025).motion[-1, 2] for car in (with_file, default_car())]
    assert yaw[0] == pytest.approx(yaw[1], rel=0.05)


@pytest.mark.parametrize(
    ("before", "old", "new", "message"),
    [
        ("", "PKY2 = 2.48\n", "", r"(?m)PKY2: expected a value, found none\.$"),
        ("", "FORCE = 'kN'", "FORCE = 'newton'", "FNOMIN: expected 736 to 18400 N.*found 4.5 N"),
        ("[tyre]", "", "", r"tyre\.tyre_file: no such setting\. Move it above"),
        ("[road]", "", "", r"road\.tyre_file: no such setting\. Move it above"),
    ],
)
def test_a_car_file_names_the_faults_of_its_tyre_file(
    before: str, old: str, new: str, message: str, tmp_path: Path
) -> None:
    """Of the file, against the rest of the car, and where it is named below a section."""
    car_text = CAR_TEXT.replace(before, f"{before}\n{ENTRY}", 1)
    tyre_text = TYRE_FILE_TEXT.replace(old, new)
    with pytest.raises(ConfigError, match=message):
        load_parameters(write_car(tmp_path, car_text, tyre_text))
