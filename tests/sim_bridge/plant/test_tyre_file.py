"""Tyre property files: what is read and refused, and the forces of their coefficients."""

from importlib import resources
from math import hypot, radians, tan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_tyre import TYRE_FILE_TEXT

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import default_car, load_parameters
from sim_bridge.plant.tyre import magic_formula
from sim_bridge.plant.tyre_file import TyreFile, parse_tyre_file, read_tyre_file

CAR = default_car()


def read(text: str = TYRE_FILE_TEXT) -> TyreFile:
    return parse_tyre_file(text, "made.tir")


TYRE = read().parameters


def side_n(angle_deg: float, load_n: float = 4500.0, road: float = 1.0) -> float:
    """Side force of a tyre that moves to its right by this angle."""
    return magic_formula.force(tan(radians(angle_deg)), 0.0, 0.0, load_n, road, 1.0, TYRE).left_n


def test_units_are_converted_and_unused_keys_are_listed() -> None:
    assert TYRE.fnomin == pytest.approx(4500.0)
    assert TYRE.unloaded_radius == pytest.approx(0.334)
    assert read().ignored == ("MODEL.LONGVL",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("PKY2 = 2.48\n", "", "PKY2: expected a value, found none"),
        ("PCY1 = 1.42", "PCY1 = big", "LATERAL_COEFFICIENTS.PCY1: expected a number, found 'big'"),
        ("FORCE = 'kN'", "FORCE = 'stone'", "UNITS.FORCE: expected one of newton"),
        ("'radians'", "'degree'", "UNITS.ANGLE: expected one of radians"),
        ("FITTYP = 52", "FITTYP = 21", "MODEL.FITTYP: expected one of 5, 6, 52"),
        ("PKY1 = -24.1", "PKY1 = 24.1", "PKY1: expected a negative number"),
        ("PDX2 = -0.05", "PDX1 = 0.9", "PDX1: expected one value, found a second"),
        ("FNOMIN = 4.5", "FNOMIN = 0.0", "FNOMIN: expected more than 0"),
        ("RCX1 = 1.1", "RCX1", "expected KEY = value, found 'RCX1'"),
        (
            "FORCE = 'kN'\n",
            "",
            "UNITS.FORCE: expected one of newton, n, kilonewton, kn, pound_force, found none",
        ),
        (
            "LENGTH = 'mm'",
            "LENGTH = 'm'",
            "UNLOADED_RADIUS: expected a radius in m of 0.1 to 2, found 334",
        ),
        ("PDY1 = 0.96", "PDY1 = 9.6", "PDY1, LMUY: expected a peak friction of either sign of 0.2"),
        ("PDY1 = 0.96", "PDY1 = 0.0", "PDY1, LMUY: expected a peak friction of either sign of 0.2"),
        ("PDX1 = 0.97", "PDX1 = 0.097", "PDX1, LMUX: expected a peak friction of 0.2 to 2.5"),
        ("PKX1 = 18.7", "PKX1 = 1.0", "PKX1, LKX: expected a slip stiffness over load of 2 to 200"),
        ("PKY1 = -24.1", "PKY1 = -0.42", "LKY: expected a cornering stiffness over load of 2 to"),
        ("'LEFT'", "'Links'", "MODEL.TYRESIDE: expected one of left, right, symmetric"),
        *(
            ("LMUX = 1.0", f"{name} = 0.0", f"{name}: expected more than 0.0, found 0.0")
            for name in ("LFZO", "LCX", "LMUX", "LKX", "LCY", "LMUY", "LKY", "PKY4")
        ),
    ],
)
def test_a_faulty_file_is_refused_with_the_name_of_the_key(
    old: str, new: str, message: str
) -> None:
    assert old in TYRE_FILE_TEXT
    with pytest.raises(ConfigError, match=r"made\.tir") as refused:
        read(TYRE_FILE_TEXT.replace(old, new))
    assert message in str(refused.value)


def test_all_faults_of_a_file_are_reported_at_once() -> None:
    with pytest.raises(ConfigError) as refused:
        read(TYRE_FILE_TEXT.replace("PKY2 = 2.48\n", "").replace("'radians'", "'degree'"))
    assert "PKY2" in str(refused.value)
    assert "UNITS.ANGLE" in str(refused.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected a tyre file"):
        read_tyre_file(tmp_path / "none.tir")


def test_pure_slip_has_the_stiffness_and_the_peak_of_the_coefficients() -> None:
    stiffness = 24.1 * 4500.0 * np.sin(2.0 * np.arctan(1.0 / 2.48))
    assert side_n(0.01) / radians(0.01) == pytest.approx(stiffness, rel=1e-3)
    peak_n = max(side_n(a) for a in np.arange(1.0, 20.0, 0.1))
    assert peak_n == pytest.approx(0.96 * 4500.0, rel=1e-3)
    slips = np.arange(0.01, 0.4, 0.005)
    along = [magic_formula.force(0.0, s, 0.0, 4500.0, 1.0, 1.0, TYRE).forward_n for s in slips]
    assert max(along) == pytest.approx(0.97 * 4500.0, rel=1e-3)


def test_the_road_scales_the_peak_and_keeps_the_stiffness() -> None:
    assert side_n(0.01, road=0.5) == pytest.approx(side_n(0.01), rel=1e-3)
    assert max(side_n(a, road=0.5) for a in np.arange(1.0, 20.0, 0.1)) == pytest.approx(
        0.48 * 4500.0, rel=1e-3
    )


@pytest.mark.parametrize("angle_deg", [0.3, 2.0, 6.0])
def test_the_road_acts_as_the_scaling_factors_of_friction(angle_deg: float) -> None:
    """On forces and aligning moment, with its residual part and the arm of longitudinal force."""
    tyre = TYRE._replace(
        phy1=0.003, pvy1=0.02, qbz9=9.0, qbz10=0.4, qdz6=0.003, qdz8=-0.1, ssz2=0.02, lcy=1.1
    )
    slips = (tan(radians(angle_deg)), 0.02, 0.03, 4500.0)
    icy = magic_formula.force(*slips, 0.3, 1.0, tyre)
    scaled = magic_formula.force(*slips, 1.0, 1.0, tyre._replace(lmux=0.3, lmuy=0.3))
    assert icy == pytest.approx(scaled, rel=1e-12)


def test_the_shape_of_the_side_force_does_not_change_the_steepness_of_the_residual_moment() -> None:
    """B C of the side force is its stiffness over its peak, whatever the scale of C."""
    tyre = TYRE._replace(qbz10=0.4, qdz1=0.0, qdz6=0.003)
    moments = [
        magic_formula.force(0.02, 0.0, 0.0, 4500.0, 1.0, 1.0, tyre._replace(lcy=scale)).aligning_nm
        for scale in (1.0, 1.1)
    ]
    assert moments[0] == pytest.approx(moments[1], rel=1e-12)


def test_the_sign_of_the_lateral_peak_changes_nothing_if_all_that_it_multiplies_changes() -> None:
    """D = mu N and B = K / (C D) both change sign; RVY1 to RVY3 are times D, QBZ10 times B C."""
    names = ("pdy1", "pdy2", "rvy1", "rvy2", "rvy3", "qbz10")
    one = TYRE._replace(rvy1=0.05, rvy2=-0.02, rvy3=-0.8, qbz9=9.0, qbz10=0.4, qdz6=0.003)
    other = one._replace(**{name: -getattr(one, name) for name in names})
    for across in (-1.5, -0.05, 0.0, 0.01, 0.1):
        for along in (-0.5, 0.0, 0.03):
            slips = (across, along, 0.03, 4000.0, 0.8, 1.0)
            assert magic_formula.force(*slips, other) == pytest.approx(
                magic_formula.force(*slips, one), rel=1e-12, abs=1e-9
            )


def test_a_file_with_a_negative_lateral_peak_has_the_same_side_force() -> None:
    text = TYRE_FILE_TEXT.replace("PDY1 = 0.96", "PDY1 = -0.96")
    negative = read(text.replace("PDY2 = -0.02", "PDY2 = 0.02")).parameters
    assert negative.pdy1 == -0.96
    for load_n in (1500.0, 4500.0, 9000.0):
        force = magic_formula.force(0.05, 0.0, 0.0, load_n, 1.0, 1.0, negative)
        assert force.left_n == pytest.approx(side_n(np.degrees(np.arctan(0.05)), load_n))


@pytest.mark.parametrize(("side", "is_right"), [("left", 0.0), ("Right", 1.0), ("SYMMETRIC", 0.0)])
def test_the_side_of_the_tyre_is_read_in_any_case(side: str, is_right: float) -> None:
    assert read(TYRE_FILE_TEXT.replace("LEFT", side)).parameters.is_right == is_right


def test_the_aligning_moment_turns_the_wheel_back() -> None:
    force = magic_formula.force(tan(radians(2.0)), 0.0, 0.0, 4500.0, 1.0, 1.0, TYRE)
    assert force.left_n > 0.0
    assert -0.04 < force.aligning_nm / force.left_n < -0.02


def test_lean_pushes_to_the_side_of_the_lean() -> None:
    force = magic_formula.force(0.0, 0.0, radians(2.0), 4500.0, 1.0, 1.0, TYRE)
    assert force.left_n == pytest.approx(-0.45 * radians(2.0) * 4500.0, rel=0.01)


def test_the_scale_of_camber_removes_its_thrust() -> None:
    level = TYRE._replace(lgay=0.0)
    force = magic_formula.force(0.0, 0.0, radians(2.0), 4500.0, 1.0, 1.0, level)
    assert force.left_n == pytest.approx(0.0, abs=1e-9)


def test_a_tyre_of_the_other_side_is_the_mirror_image() -> None:
    here = magic_formula.force(0.05, 0.02, 0.03, 4000.0, 0.9, 1.0, TYRE)
    there = magic_formula.force(-0.05, 0.02, -0.03, 4000.0, 0.9, -1.0, TYRE)
    assert there.forward_n == pytest.approx(here.forward_n)
    assert there.left_n == pytest.approx(-here.left_n)
    assert there.aligning_nm == pytest.approx(-here.aligning_nm)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    across=st.floats(-3.0, 3.0),
    along=st.floats(-3.0, 3.0),
    lean=st.floats(-0.2, 0.2),
    load_n=st.floats(100.0, 12000.0),
    road=st.floats(0.1, 1.2),
)
def test_no_slip_leaves_the_friction_ellipse(
    across: float, along: float, lean: float, load_n: float, road: float
) -> None:
    force = magic_formula.force(across, along, lean, load_n, road, 1.0, TYRE)
    x = magic_formula.longitudinal(along, lean, load_n, road, TYRE)
    y = magic_formula.lateral(-across, lean, load_n, road, TYRE)
    share = hypot(
        force.forward_n / (x.peak_n + abs(x.offset_n)), force.left_n / (y.peak_n + abs(y.offset_n))
    )
    assert share <= 1.0 + 1e-9


def test_a_car_with_a_tyre_file_drives_a_bend_like_the_car_with_the_same_tyre(
    tmp_path: Path,
) -> None:
    (tmp_path / "made.tir").write_text(TYRE_FILE_TEXT, encoding="utf-8")
    text = (resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml").read_text("utf-8")
    entry = 'tyre_file = { value = "made.tir", source = "estimate: a made file" }\n'
    (tmp_path / "car.toml").write_text(entry + text, encoding="utf-8")
    with_file = load_parameters(tmp_path / "car.toml")
    assert with_file.tyre_file == TYRE
    inputs = np.tile((0.12, 0.0, radians(20.0)), (160, 1))
    yaw = [
        simulate(settle(20.0, car), inputs, car, STEPS_PER_PERIOD, STEP_S)[0][-1, 2]
        for car in (with_file, CAR)
    ]
    assert yaw[0] == pytest.approx(yaw[1], rel=0.05)


def test_a_car_file_names_the_faults_of_its_tyre_file(tmp_path: Path) -> None:
    (tmp_path / "made.tir").write_text(
        TYRE_FILE_TEXT.replace("PKY2 = 2.48\n", ""), encoding="utf-8"
    )
    entry = 'tyre_file = { value = "made.tir", source = "estimate: a made file" }\n'
    (tmp_path / "car.toml").write_text(entry, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"(?m)PKY2: expected a value, found none\.$"):
        load_parameters(tmp_path / "car.toml")


def write_car(folder: Path, tyre_text: str, old: str, new: str) -> Path:
    """The shipped car with a tyre file beside it, and one change of its text."""
    (folder / "made.tir").write_text(tyre_text, encoding="utf-8")
    text = (resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml").read_text("utf-8")
    assert old in text
    (folder / "car.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    return folder / "car.toml"


ENTRY = 'tyre_file = { value = "made.tir", source = "estimate: a made file" }\n'


def test_a_nominal_load_far_from_the_wheel_load_is_refused(tmp_path: Path) -> None:
    text = TYRE_FILE_TEXT.replace("FORCE = 'kN'", "FORCE = 'newton'")
    car = write_car(tmp_path, text, "[body]", ENTRY + "[body]")
    with pytest.raises(ConfigError, match=r"FNOMIN: expected 736 to 18400 N.*found 4.5 N"):
        load_parameters(car)


@pytest.mark.parametrize("section", ["tyre", "road"])
def test_a_tyre_file_in_a_section_is_refused_with_its_place(tmp_path: Path, section: str) -> None:
    car = write_car(tmp_path, TYRE_FILE_TEXT, f"[{section}]", f"[{section}]\n{ENTRY}")
    message = rf"{section}\.tyre_file: no such setting\. Move it above the first section"
    with pytest.raises(ConfigError, match=message):
        load_parameters(car)
