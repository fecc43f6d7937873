"""OpenDRIVE maps: geometry as curvature, elevation, chains of roads, and what is refused."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from made_maps import ARC, LINE, SPIRAL, end_of, road, write_map

from rt_controller.contract.errors import ConfigError
from rt_controller.settings import CarSettings
from sim_bridge.scenario import load_scenario, opendrive, parse_scenario
from sim_bridge.scenario.opendrive import read_reference_line

ELEVATION = (
    '<elevationProfile><elevation s="0" a="0" b="0.05" c="0" d="0"/>'
    '<elevation s="60" a="3" b="0.05" c="0.001" d="0"/></elevationProfile>'
    '<lateralProfile><superelevation s="0" a="0.03" b="0" c="0" d="0"/></lateralProfile>'
    '<type s="0" type="rural"><speed max="72" unit="km/h"/></type>'
)


@pytest.fixture
def simple(tmp_path: Path) -> Path:
    return write_map(tmp_path / "map.xodr", road([(100.0, LINE), (50.0, SPIRAL), (80.0, ARC)]))


def test_a_road_against_its_direction_is_mirrored(tmp_path: Path) -> None:
    own = road([(100, LINE), (80, ARC)], "7", ELEVATION)
    path = write_map(tmp_path / "a.xodr", own, road([(9, LINE)], "6", junction="1"))
    assert read_reference_line(path).length_m == 180.0  # roads of junctions have to be named
    assert read_reference_line(path, ["6"]).length_m == 9.0
    line = read_reference_line(path, ["-7"])
    assert line.curvature_per_m(np.array([40.0, 120.0])) == pytest.approx([-0.01, 0.0])
    assert line.grade.at(150.0) == pytest.approx(-0.05)
    assert line.bank_rad.at(150.0) == pytest.approx(-0.03)


def test_roads_in_a_row_are_one_line(tmp_path: Path) -> None:
    corner = end_of([(100, LINE), (80, ARC)])
    x, y, yaw = end_of([(60, LINE)], corner)
    path = write_map(
        tmp_path / "a.xodr",
        road([(100, LINE)], "a"),
        road([(80, ARC)], "b", start=end_of([(100, LINE)])),
        road([(60, LINE)], "c", start=(x, y, yaw + np.pi)),
    )
    line = read_reference_line(path, ["a", "b", "-c"])
    assert line.length_m == 240.0
    assert line.curvature_per_m(np.array([99.0, 101.0, 179.0, 181.0])) == pytest.approx(
        [0.0, 0.01, 0.01, 0.0]
    )
    assert line.end[:2] == pytest.approx((x, y), abs=0.01)
    assert (line.end.yaw_rad - yaw) % (2.0 * np.pi) == pytest.approx(0.0, abs=1e-3)


def test_roads_that_do_not_join_are_refused(tmp_path: Path) -> None:
    for start, found in (
        ((112.0, 5.0, 0.0), "found 13.00 m and 0.0 deg"),
        ((100.0, 0.0, 0.5), "found 0.00 m and 28.6 deg"),
    ):
        parts = road([(100, LINE)], "a"), road([(80, ARC)], "b", start=start)
        path = write_map(tmp_path / "a.xodr", *parts)
        with pytest.raises(ConfigError, match=f"roads a and b: .*{found}"):
            read_reference_line(path, ["a", "b"])


@pytest.mark.parametrize(("p_range", "last"), [("arcLength", 30.0), ("normalized", 1.0)])
def test_a_polynomial_has_the_range_and_the_end_of_its_file(
    tmp_path: Path, p_range: str, last: float
) -> None:
    k = 30.0 / last
    shape = (
        f'<paramPoly3 pRange="{p_range}" aU="0" bU="{k}" cU="0" dU="0" '
        f'aV="0" bV="0" cV="{0.0005 * k**2}" dV="0"/>'
    )
    line = read_reference_line(write_map(tmp_path / "a.xodr", road([(30.0, shape)])))
    assert line.curvature_per_m.at(0.0) == pytest.approx(0.001)
    assert line.end == pytest.approx((30.0, 0.45, 0.03), abs=0.01)
    other = shape.replace(p_range, "normalized" if last > 1.0 else "arcLength")
    path = write_map(tmp_path / "b.xodr", road([(30.0, other)]))
    with pytest.raises(ConfigError, match="as long as its geometry, 30 m, expected, found"):
        read_reference_line(path)


def test_grade_and_bank_are_zero_before_their_first_record(tmp_path: Path) -> None:
    late = ELEVATION.replace('s="0"', 's="20"')
    first, last = road([(100, LINE)], "a", ELEVATION), road([(100, LINE)], "b", late, (100, 0, 0))
    path = write_map(tmp_path / "a.xodr", first, last)
    line = read_reference_line(path, ["a", "b"])
    at_m = np.array([99.0, 110.0, 130.0, 199.0])
    assert line.grade(at_m) == pytest.approx([0.05 + 0.002 * 39.0, 0.0, 0.05, 0.05 + 0.002 * 39.0])
    assert line.bank_rad(at_m) == pytest.approx([0.03, 0.0, 0.03, 0.03])
    assert line.speed_limit_mps(at_m) == pytest.approx([20.0, np.inf, 20.0, 20.0])
    against = read_reference_line(write_map(tmp_path / "b.xodr", last), ["-b"])
    at_m = np.array([10.0, 70.0, 90.0])
    assert against.grade(at_m) == pytest.approx([-0.05 - 0.002 * 30.0, -0.05, 0.0])
    assert against.bank_rad(at_m) == pytest.approx([-0.03, -0.03, 0.0])
    assert against.speed_limit_mps(at_m) == pytest.approx([20.0, 20.0, np.inf])


def test_speed_limits_have_units(tmp_path: Path) -> None:
    for speed, limit_mps in (
        ('max="10"', 10.0), ('max="36" unit="km/h"', 10.0), ('max="10" unit="mph"', 4.4704),
        ('max="no limit"', np.inf), ('max="undefined" unit="km/h"', np.inf),
    ):  # fmt: skip
        extra = f'<type s="0" type="town"><speed {speed}/></type>'
        line = read_reference_line(write_map(tmp_path / "a.xodr", road([(9, LINE)], "1", extra)))
        assert line.speed_limit_mps.at(5.0) == pytest.approx(limit_mps)


def test_a_map_is_a_scenario(simple: Path) -> None:
    scenario = load_scenario(f"{simple}#1")
    found = scenario.road.curvature_per_m(np.array([50.0, 125.0, 150.0, 229.0]))
    assert found == pytest.approx([0.0, 0.005, 0.01, 0.01])
    assert scenario.road.length_m == 230.0
    assert scenario.start.speed_mps == pytest.approx(50.0 / 3.6)
    assert scenario.duration_s * scenario.start.speed_mps > 230.0


@pytest.mark.parametrize(
    ("name", "roads"),
    [
        ("proj#2/map.xodr", "#1"),
        ("a.xodr#b/MAP.XODR", "#1"),
        ("map#2.xodr", ""),
        ("map.xodr#2.xodr", "#1"),
        ("proj#2/drive#1.toml", ""),
        ("map.xodr#2.toml", ""),
    ],
)
def test_only_behind_a_map_a_hash_separates_roads(tmp_path: Path, name: str, roads: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    write_map(path, road([(230.0, LINE)]))
    if path.suffix == ".toml":
        shipped = files("sim_bridge") / "scenarios" / "straight.toml"
        path.write_text(shipped.read_text("utf-8"))
    settings = CarSettings(scenario=f"{path}{roads}")
    assert load_scenario(settings.scenario).road.length_m >= 230.0


def test_a_file_of_format_2_takes_its_road_from_a_map(simple: Path) -> None:
    content = {
        "format": 2, "name": "x", "duration_s": 20.0, "reference": {"speed_kmh": 40.0},
        "road": {"opendrive": {"file": "map.xodr"}, "friction": 0.5},
    }  # fmt: skip
    scenario = parse_scenario(content, "test", simple.parent)
    assert scenario.road.curvature_per_m.at(200.0) == pytest.approx(0.01)
    assert scenario.road.friction_left.at(0.0) == 0.5


BOMB = """<!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><OpenDRIVE>&b;</OpenDRIVE>"""
EXTERNAL = """<!DOCTYPE a [<!ENTITY a SYSTEM "/etc/hostname">]><OpenDRIVE>&a;</OpenDRIVE>"""
ONE = road([(9, LINE)])
SHIFTED = road([(9, LINE), (8, LINE)]).replace('s="9.0" x="', 's="9.0" x="1')


def limited(old: str, new: str) -> list[str]:
    return [road([(9, LINE)], "1", ELEVATION.replace(old, new))]


@pytest.mark.parametrize(
    ("content", "roads", "message"),
    [
        ([ONE, road([(8, LINE)], "2")], "", r"Name some of 1 \(9.0 m\), 2 \(8"),
        ([ONE], "#5", r"expected a road of 1 \(9.0 m\), found '5'"),
        ([road([(9, "<nurbs/>")])], "", "road 1: "),
        ([SHIFTED], "", "geometry at s = 9 m: at most 0.5 m and 2.9 deg"),
        ([road([(9, "<arc/>")])], "", "attribute curvature of <arc>, found none"),
        ([ONE.replace('"9"', '"1e9"')], "", "length of 0..250000 m"),
        (limited("72", "0"), "", "max above 0, no limit"),
        (limited("km/h", "kmh"), "", "road 1: unit m/s, km/h, mph"),
        ([road([(9, '<arc curvature="0.2"/>')])], "", "road.curvature_per_m: expected"),
        (limited("0.05", "0.25"), "", "road.grade: expected"),
        ([road([(9e4, LINE)])], "", "duration_s: expected"),
        ([road([])], "", "no geometry in planView"),
        ([], "", "OpenDRIVE file with roads"),
        ("no xml", "", "syntax error"),
        (BOMB, "", "no <!DOCTYPE> expected"),
        (EXTERNAL, "", "no <!DOCTYPE> expected"),
        ("<a/>", "", "found <a>"),
        (None, "", "No such file"),
    ],
)
def test_a_map_that_cannot_be_driven_is_refused(
    tmp_path: Path, content: list[str] | str | None, roads: str, message: str
) -> None:
    path = tmp_path / "a.xodr"
    if isinstance(content, str):
        path.write_text(content)
    elif content is not None:
        write_map(path, *content)
    with pytest.raises(ConfigError, match=message) as refused:
        load_scenario(f"{path}{roads}")
    assert str(refused.value).startswith(f"{path}: ")
    assert len(str(refused.value).splitlines()) == 1


def test_a_huge_file_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opendrive, "LARGEST_MB", 1)
    (tmp_path / "a.xodr").write_text("<OpenDRIVE>" + " " * 2_000_000)
    with pytest.raises(ConfigError, match="2 MB, where at most 1 MB are read"):
        load_scenario(str(tmp_path / "a.xodr"))
