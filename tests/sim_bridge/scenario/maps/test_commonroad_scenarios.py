"""CommonRoad scenarios: route, reference line, start, speed, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from made_maps import arc, lanelet, planning_problem, straight, write_commonroad
from reference_driver import drive

from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario.maps.centre_line import through_points
from sim_bridge.scenario.maps.lanelets import read_network

GOAL = '<position><lanelet ref="2"/></position>'
FIRST = lanelet("1", straight(0.0, 100.0), '<successor ref="2"/>')
BEND = lanelet("2", arc(100.0, 60.0, 1.2), '<predecessor ref="1"/>')


def test_a_route_along_successors_becomes_the_road(tmp_path: Path) -> None:
    problem = planning_problem(5.0, 0.3, 0.02, 12.0, GOAL)
    scenario = load_scenario(str(write_commonroad(tmp_path / "a.xml", FIRST, BEND, problem)))
    assert scenario.name == "ZAM_Made-1_1_T-1"
    start = scenario.start
    found = (start.speed_mps, start.s_m, start.ey_m, start.epsi_rad)
    assert found == pytest.approx((12.0, 5.0, 0.3, 0.02), abs=0.01)
    curvature = scenario.road.curvature_per_m(np.array([40.0, 130.0, 150.0]))
    assert curvature == pytest.approx([0.0, 1 / 60, 1 / 60], abs=5e-4)
    assert scenario.end_m == pytest.approx(172.0, abs=0.1)
    driven = drive(scenario)
    assert driven.metrics.ey_peak_m < 0.5
    assert driven.s_m > 165.0


def test_what_a_map_asks_for_is_not_refused_by_a_field_of_a_file(tmp_path: Path) -> None:
    problem = planning_problem(5.0, 0.0, 0.0, 40.0, GOAL)
    path = write_commonroad(tmp_path / "a.xml", FIRST, BEND, problem)
    with pytest.raises(ConfigError, match="speed on the map: expected a lateral acceleration"):
        load_scenario(str(path))


def test_a_goal_in_the_neighbouring_lane_is_reached_by_a_lane_change(tmp_path: Path) -> None:
    right = lanelet("1", straight(0, 100), '<adjacentLeft ref="2" drivingDir="same"/>')
    left = lanelet("2", straight(0, 100, 3.5), '<adjacentRight ref="1" drivingDir="same"/>')
    place = "<rectangle><length>5</length><width>2</width><center><x>95</x><y>3.5</y></center>"
    problem = planning_problem(5, 0, 0, 15.0, f"<position>{place}</rectangle></position>")
    scenario = load_scenario(str(write_commonroad(tmp_path / "a.xml", right, left, problem)))
    turned = np.cumsum(scenario.road.curvature_per_m(np.arange(0.0, 90.0, 0.1))) * 0.1
    assert np.sin(turned).sum() * 0.1 == pytest.approx(3.5, abs=0.15)
    assert scenario.end_m == pytest.approx(95.0, abs=0.3)


def test_the_speed_reaches_the_goal_in_its_time_within_the_limit(tmp_path: Path) -> None:
    sign = (
        '<trafficSign id="9"><trafficSignElement><trafficSignID>274</trafficSignID>'
        "<additionalValue>{}</additionalValue></trafficSignElement></trafficSign>"
    )
    time = "<time><intervalStart>90</intervalStart><intervalEnd>110</intervalEnd></time>"
    problem = planning_problem(5.0, 0.0, 0.0, 12.0, GOAL, time)
    limited = FIRST.replace("</lanelet>", '<trafficSignRef ref="9"/></lanelet>')
    path = tmp_path / "a.xml"
    free = load_scenario(str(write_commonroad(path, FIRST, BEND, problem)))
    assert free.speed.highest_mps == pytest.approx(16.7, abs=0.1)
    held = load_scenario(str(write_commonroad(path, limited, BEND, sign.format(13.0), problem)))
    assert held.speed.highest_mps == pytest.approx(13.0, abs=1e-6)


@pytest.mark.parametrize(
    "sign_id",
    ["274", "274.1", "R2-1", "r301", "3.24", "R15", "C43", "B14", "\u03a1-32", "B31"],
)
def test_speed_limits_of_all_catalogues_are_read(tmp_path: Path, sign_id: str) -> None:
    sign = (
        f'<trafficSign id="9"><trafficSignElement><trafficSignID>{sign_id}</trafficSignID>'
        "<additionalValue>8.5</additionalValue></trafficSignElement></trafficSign>"
    )
    limited = BEND.replace("</lanelet>", '<trafficSignRef ref="9"/></lanelet>')
    problem = planning_problem(5.0, 0.0, 0.0, 12.0, GOAL)
    path = write_commonroad(tmp_path / "a.xml", FIRST, limited, sign, problem)
    assert min(lanelet.limit_mps for lanelet in read_network(path).lanelets.values()) == 8.5


def test_points_that_are_close_to_each_other_are_a_line() -> None:
    line = through_points(straight(0.0, 60.0, n=1201))
    assert line.length_m == pytest.approx(60.0, abs=0.2)


def test_a_goal_without_a_place_is_a_drive_straight_on(tmp_path: Path) -> None:
    problem = planning_problem(5.0, 0.0, 0.0, 12.0, "")
    scenario = load_scenario(str(write_commonroad(tmp_path / "a.xml", FIRST, BEND, problem)))
    assert scenario.end_m == pytest.approx(172.0, abs=0.1)
    assert scenario.distance_m == pytest.approx(167.0, abs=0.1)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([FIRST, BEND], "a planningProblem expected"),
        ([FIRST, BEND, planning_problem(5, 50, 0, 9, GOAL)], "expected an initial position on"),
        ([FIRST, planning_problem(5, 0, 0, 9, GOAL)], "no route to 2"),
        ([BEND, FIRST, planning_problem(5, 0, 0, 9,
          "<position><point><x>5</x><y>90</y></point></position>")], "expected a goal on a lanel"),
        ([FIRST, BEND, planning_problem(90, 0, 0, 9,
          "<position><point><x>20</x><y>0</y></point></position>")], "expected a goal ahead of"),
        ([lanelet("2", arc(0, 15, 1.5)), planning_problem(1, 0, 0, 9, GOAL)],
         "curvature_per_m: expected"),
        ([FIRST.replace("leftBound", "middle"), planning_problem(5, 0, 0, 9, GOAL)],
         "leftBound and rightBound expected"),
        ([FIRST, BEND, planning_problem(5, 0, 0, -5, GOAL)],
         "initial.speed_kmh: expected 0..250, found -18"),
        ([FIRST, BEND, planning_problem(5, 0, 0, 100, GOAL)],
         "initial.speed_kmh: expected 0..250, found 360"),
        ([FIRST, BEND, planning_problem(5, 0, 3.1, 9, GOAL)],
         "initial.epsi_deg: expected -30..30, found 177.6"),
        ([FIRST, BEND, planning_problem(5, 0, np.nan, 9, GOAL)], "as orientation, found 'nan'"),
        ([FIRST, BEND, planning_problem(5, 0, 0, np.nan, GOAL)], "as velocity, found 'nan'"),
        ([FIRST.replace("<x>5.0", "<x>nan", 1), BEND, planning_problem(5, 0, 0, 9, GOAL)],
         "as x of a point, found 'nan"),
        ([FIRST.replace("</lanelet>", "<speedLimit>0</speedLimit></lanelet>"), BEND,
          planning_problem(5, 0, 0, 9, GOAL)], "a speed limit above 0 expected as speedLimit"),
        ([lanelet("2", straight(0, 0.5)), planning_problem(0.2, 0, 0, 9, GOAL)],
         "route: expected a centre line of 2..250000 m, found 0.5"),
        ([lanelet("2", straight(0, 0.01)), planning_problem(0.0, 0, 0, 9, GOAL)],
         "route: expected a centre line of 2..250000 m, found 0 m"),
        ([FIRST, lanelet("2", straight(130, 200)), planning_problem(5, 0, 0, 9, GOAL)],
         "between lanelet 1 and its successor 2, found 30.0 m"),
    ],
)  # fmt: skip
def test_a_scenario_that_cannot_be_driven_is_refused(
    tmp_path: Path, parts: list[str], message: str
) -> None:
    path = write_commonroad(tmp_path / "a.xml", *parts)
    with pytest.raises(ConfigError, match=message):
        load_scenario(str(path))


def test_a_drive_on_a_loop_begins_in_its_first_lap(tmp_path: Path) -> None:
    loop = lanelet("1", arc(0.0, 60.0, 2.0 * np.pi, n=200), '<successor ref="1"/>')
    problem = planning_problem(10.0, 1.0, 0.17, 12.0, "")
    scenario = load_scenario(str(write_commonroad(tmp_path / "a.xml", loop, problem)))
    assert scenario.start.s_m == pytest.approx(10.0, abs=0.5)
    assert scenario.distance_m == pytest.approx(500.0)


def test_a_start_on_the_edge_of_the_road_belongs_to_the_nearest_lanelet(tmp_path: Path) -> None:
    problem = planning_problem(5.0, 2.2, 0.0, 12.0, GOAL)
    scenario = load_scenario(str(write_commonroad(tmp_path / "a.xml", FIRST, BEND, problem)))
    assert scenario.start.ey_m == pytest.approx(2.2, abs=0.01)


def test_another_version_is_refused(tmp_path: Path) -> None:
    path = write_commonroad(tmp_path / "a.xml", FIRST, version="2017a")
    with pytest.raises(ConfigError, match="version 2018b or 2020a, found <commonRoad> of version"):
        load_scenario(str(path))


@pytest.mark.parametrize("points", [8, 40])
def test_a_line_through_points_has_the_curvature_of_the_road(points: int) -> None:
    road = np.concatenate((straight(0, 100, n=points), arc(100.0, 60.0, 1.2, n=points)))
    line = through_points(road)
    assert np.abs(line.curvature_per_m(np.arange(0.0, 85.0))).max() < 2e-3
    assert line.curvature_per_m(np.arange(115.0, 160.0)) == pytest.approx(1 / 60, abs=1.5e-3)
    assert line.place(np.array([50.0, 1.0]), 0.1) == pytest.approx((50.0, 1.0, 0.1), abs=0.02)


def test_lanelets_are_read_as_commonroad_io_reads_them(tmp_path: Path) -> None:
    reader = pytest.importorskip("commonroad.common.file_reader").CommonRoadFileReader
    problem = planning_problem(5.0, 0.3, 0.02, 12.0, GOAL)
    path = write_commonroad(tmp_path / "a.xml", FIRST, BEND, problem)
    theirs, _ = reader(str(path)).open()
    for lane in theirs.lanelet_network.lanelets:
        ours = read_network(path).lanelets[str(lane.lanelet_id)]
        np.testing.assert_allclose(ours.centre, lane.center_vertices)
