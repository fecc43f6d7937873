"""Forces of a tyre: of the default car, and from a made `.tir` file; what such a file may have."""

import re
from importlib import resources
from math import degrees, hypot, radians, tan
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_tyre import TYRE_FILE_TEXT

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.library import car_library, car_record
from sim_bridge.plant.parameters import default_car, load_parameters
from sim_bridge.plant.tyre_file import parse_tyre_file
from sim_bridge.validation.run import input_table, replay

CAR = default_car()
OWN = car_record(CAR)
TYRE = parse_tyre_file(TYRE_FILE_TEXT, "made.tir")


def of_file(**changes: float) -> Array:
    return car_record(CAR._replace(tyre_file=TYRE._replace(**changes)))


FILE = of_file()


class Force(NamedTuple):
    forward_n: float
    left_n: float
    aligning_nm: float


def force(
    across: float = 0.0, along: float = 0.0, lean: float = 0.0, load_n: float = 4500.0,
    road: float = 1.0, tyre: Array = OWN,
) -> Force:  # fmt: skip
    found = np.empty(3)
    car_library().car_tyre_force(across, along, lean, load_n, road, tyre, found)
    return Force(*found.tolist())


def side_n(angle_deg: float, load_n: float = 4500.0, road: float = 1.0, tyre: Array = OWN) -> float:
    return force(tan(radians(angle_deg)), 0.0, 0.0, load_n, road, tyre).left_n


def peaks_n(load_n: float, lean: float = 0.0, road: float = 1.0, tyre: Array = OWN) -> Array:
    """Largest (longitudinal, lateral) force of one slip alone."""
    slips = np.geomspace(1e-3, 3.0, 150) * max(road, 0.1)
    slips = np.concatenate((-slips, slips))
    along = [abs(force(0.0, slip, lean, load_n, road, tyre).forward_n) for slip in slips]
    across = [abs(force(slip, 0.0, lean, load_n, road, tyre).left_n) for slip in slips]
    return np.array((max(along), max(across)))


def test_friction_has_the_published_peaks() -> None:
    """On a road of 0.85: 0.82 at 2.6 kN and 0.81 at 6.5 kN; falling by a tenth at 25 deg."""
    angles = np.arange(0.5, 30.0, 0.05)
    for load_n, peak in ((2600.0, 0.82), (6500.0, 0.81)):
        assert peaks_n(load_n, road=0.85)[1] / load_n == pytest.approx(peak, abs=0.01)
    load_n = CAR.tyre.reference_load_n
    friction = np.array([side_n(a, load_n) / load_n for a in angles])
    assert angles[friction.argmax()] == pytest.approx(8.5, abs=0.5)
    assert np.interp(25.0, angles, friction) == pytest.approx(0.96 * 0.88 / 0.974, abs=0.01)
    slips = np.arange(0.01, 0.4, 0.001)
    along = [force(along=slip, load_n=load_n).forward_n / load_n for slip in slips]
    assert max(along) == pytest.approx(0.974, abs=1e-3)
    assert slips[int(np.argmax(along))] == pytest.approx(0.14, abs=0.005)


def test_a_tyre_file_has_the_stiffness_and_the_peaks_of_its_coefficients() -> None:
    """Also with both signs of PDY1."""
    stiffness = 24.1 * 4500.0 * np.sin(2.0 * np.arctan(1.0 / 2.48))
    for tyre in (FILE, of_file(pdy1=-0.96, pdy2=0.02)):
        assert side_n(0.01, tyre=tyre) / radians(0.01) == pytest.approx(stiffness, rel=1e-3)
        wanted_n = np.array((0.97, 0.96)) * 4500.0
        np.testing.assert_allclose(peaks_n(4500.0, tyre=tyre), wanted_n, rtol=2e-3)
    assert side_n(0.01, road=0.5, tyre=FILE) == pytest.approx(side_n(0.01, tyre=FILE), rel=1e-3)
    assert peaks_n(4500.0, road=0.5, tyre=FILE)[1] == pytest.approx(0.48 * 4500.0, rel=2e-3)


def test_friction_decreases_with_load_and_stiffness_is_degressive() -> None:
    loads = np.linspace(1000.0, 9000.0, 9)
    friction = np.array([peaks_n(load_n) / load_n for load_n in loads])
    assert np.all(np.diff(friction, axis=0) < 0.0)
    stiffness = np.array([side_n(1e-3, load_n) for load_n in loads])
    assert np.all(np.diff(stiffness) > 0.0)
    assert np.all(np.diff(stiffness, 2) < 0.0)


@pytest.mark.parametrize("road", [0.3, 0.85])
def test_a_slippery_road_scales_the_curve_by_similarity(road: float) -> None:
    """F = mu f(slip / mu): the stiffness is constant, peak and its slip decrease together."""
    for slip in (0.001, 0.02, 0.1, 0.3):
        here = force(slip, -0.5 * slip, 0.0, 4000.0, road)
        there = force(slip / road, -0.5 * slip / road, 0.0, 4000.0)
        assert here[:2] == pytest.approx((road * there.forward_n, road * there.left_n))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    across=st.floats(-3.0, 3.0),
    along=st.floats(-3.0, 3.0),
    lean=st.floats(-0.2, 0.2),
    load_n=st.floats(100.0, 12000.0),
    road=st.floats(0.1, 1.2),
    tyre=st.sampled_from((OWN, FILE)),
)
def test_combined_force_stays_within_friction(
    across: float, along: float, lean: float, load_n: float, road: float, tyre: Array
) -> None:
    shares = force(across, along, lean, load_n, road, tyre)[:2] / peaks_n(load_n, lean, road, tyre)
    assert hypot(*shares) <= 1.005


def test_the_aligning_moment_ends_before_the_side_force() -> None:
    """A trail of 31 mm at small slip, zero at 6 deg, nearly zero where the tyre slides."""

    def trail_m(angle_deg: float, tyre: Array = OWN) -> float:
        found = force(tan(radians(angle_deg)), tyre=tyre)
        return -found.aligning_nm / found.left_n

    assert trail_m(0.01) == pytest.approx(0.031, rel=0.01)
    assert trail_m(6.0) == pytest.approx(0.0, abs=1e-3)
    assert -0.01 < trail_m(15.0) < 0.0
    assert 0.02 < trail_m(2.0, FILE) < 0.04


def test_lean_pushes_to_the_side_of_the_lean() -> None:
    """0.008 of the load per degree; with a file its PVY3, which LGAY scales."""
    lean = radians(1.0)
    assert force(lean=lean).left_n == pytest.approx(-0.008 * 4500.0, rel=0.05)
    assert force(lean=lean, tyre=FILE).left_n == pytest.approx(-0.45 * lean * 4500.0, rel=0.01)
    assert force(lean=lean, tyre=of_file(lgay=0.0)).left_n == pytest.approx(0.0, abs=1e-9)


SHIFTED = TYRE._replace(
    phy1=0.003, pvy1=0.02, rvy1=0.05, rvy2=-0.02, rvy3=-0.8, qbz9=9.0, qbz10=0.4, qdz6=0.003,
    qdz8=-0.1, ssz2=0.02,
)  # fmt: skip
"""with shifts, a residual moment, and the arm of the longitudinal force"""


@pytest.mark.parametrize("across", [-1.5, 0.01])
@pytest.mark.parametrize("along", [-0.5, 0.03])
def test_road_and_signs_act_on_all_that_the_formula_has_them_in(
    across: float, along: float
) -> None:
    """The road as LMUX and LMUY. With a negative PDY1 both D = mu N and B = K / (C D) change sign:
    RVY1 to RVY3 are times D, QBZ10 times B C."""
    slips = (across, along, 0.03, 4000.0)
    icy, scaled = (
        of_file(**SHIFTED._asdict()),
        of_file(**SHIFTED._asdict() | {"lmux": 0.3, "lmuy": 0.3}),
    )
    assert force(*slips, 0.3, icy) == pytest.approx(force(*slips, 1.0, scaled), 1e-12)
    names = ("pdy1", "pdy2", "rvy1", "rvy2", "rvy3", "qbz10")
    turned = of_file(**SHIFTED._asdict() | {name: -getattr(SHIFTED, name) for name in names})
    assert force(*slips, 0.8, turned) == pytest.approx(force(*slips, 0.8, icy), 1e-12, 1e-9)


def test_a_tyre_of_the_other_side_is_the_mirror_image() -> None:
    here = force(0.05, 0.02, 0.03, 4000.0, 0.9, FILE)
    there = force(-0.05, 0.02, -0.03, 4000.0, 0.9, of_file(is_right=1.0))
    assert there == pytest.approx((here.forward_n, -here.left_n, -here.aligning_nm))


CAR_TEXT = (resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml").read_text("utf-8")
ENTRY = 'tyre_file = { value = "made.tir", source = "estimate: a made file" }\n'


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
        ("RCX1 = 1.1", "RCX1", "expected KEY = value, found 'RCX1'"),
        ("LENGTH = 'mm'", "LENGTH = 'm'", "UNLOADED_RADIUS: expected a radius in m of 0.1 to 2"),
        ("PDY1 = 0.96", "PDY1 = 9.6", "PDY1, LMUY: expected a peak friction of either sign of 0.2"),
        ("PKY1 = -24.1", "PKY1 = -0.42", "LKY: expected a cornering stiffness over load of 2 to"),
        ("'LEFT'", "'Links'", "MODEL.TYRESIDE: expected one of left, right, symmetric"),
        ("LMUX = 1.0", "LMUX = 0.0", "LMUX: expected more than 0.0, found 0.0"),
    ],
)
def test_a_faulty_file_is_refused_with_the_name_of_the_key(
    old: str, new: str, message: str
) -> None:
    assert old in TYRE_FILE_TEXT
    with pytest.raises(ConfigError, match=r"made\.tir:\n  .*" + re.escape(message)):
        parse_tyre_file(TYRE_FILE_TEXT.replace(old, new), "made.tir")


def write_car(folder: Path, car_text: str, tyre_text: str = TYRE_FILE_TEXT) -> Path:
    """A car file with a tyre file beside it."""
    (folder / "made.tir").write_text(tyre_text, encoding="utf-8")
    (folder / "car.toml").write_text(car_text, encoding="utf-8")
    return folder / "car.toml"


def test_a_car_with_a_tyre_file_drives_a_bend_like_one_without(tmp_path: Path) -> None:
    with_file = load_parameters(write_car(tmp_path, ENTRY + CAR_TEXT))
    assert with_file.tyre_file == TYRE
    inputs = input_table(160, 0.12, steer_rad=radians(20.0))
    yaw = [replay(car, 20.0, inputs, 0.025).motion[-1, 2] for car in (with_file, CAR)]
    assert yaw[0] == pytest.approx(yaw[1], rel=0.05)


@pytest.mark.parametrize(
    ("before", "old", "new", "message"),
    [
        ("", "PKY2 = 2.48\n", "", r"(?m)PKY2: expected a value, found none\.$"),
        ("", "FORCE = 'kN'", "FORCE = 'newton'", "FNOMIN: expected 736 to 18400 N.*found 4.5 N"),
        ("[tyre]", "", "", r"tyre\.tyre_file: no such setting\. Move it above"),
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


@pytest.mark.parametrize("angle_deg", [5.0, 45.0])
def test_the_force_of_a_locked_wheel_is_opposite_to_its_sliding(angle_deg: float) -> None:
    """A locked wheel has slip -1 and the tangent of the angle."""
    found = force(-tan(radians(angle_deg)), -1.0)
    against = degrees(np.arctan2(-found.left_n, -found.forward_n))
    assert against == pytest.approx(angle_deg, abs=2.0)


@pytest.mark.parametrize("tyre", [OWN, FILE])
def test_a_tyre_without_load_has_no_force(tyre: Array) -> None:
    assert force(0.1, 0.1, 0.1, 0.0, tyre=tyre) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_units_are_converted_and_the_side_is_read_in_any_case() -> None:
    assert TYRE.fnomin == pytest.approx(4500.0)
    assert TYRE.unloaded_radius == pytest.approx(0.334)
    for side, is_right in (("left", 0.0), ("Right", 1.0), ("SYMMETRIC", 0.0)):
        found = parse_tyre_file(TYRE_FILE_TEXT.replace("LEFT", side), "made.tir")
        assert found.is_right == is_right
