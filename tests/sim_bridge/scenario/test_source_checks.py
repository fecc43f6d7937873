"""Limits of the road and of the initial state, from whatever file they come."""

from math import nan, radians

import pytest

from sim_bridge.scenario.road import Road
from sim_bridge.scenario.scenario import Start
from sim_bridge.scenario.source_checks import road_problems, start_problems
from sim_bridge.scenario.table import Table, constant, through


def road(curvature: float = 0.0, bank_deg: float = 0.0, grade: Table | None = None) -> Road:
    friction = constant(0.85)
    bank = constant(radians(bank_deg))
    return Road(constant(curvature), friction, friction, bank, grade or constant(0.0))


def test_the_limits_themselves_are_accepted() -> None:
    assert not list(road_problems(road(-0.15, 12.0, constant(0.2))))
    assert not list(start_problems(Start(250.0 / 3.6, 0.0, -5.0, radians(30.0))))


@pytest.mark.parametrize(
    ("out", "message"),
    [
        (road(-0.151), "road.curvature_per_m: expected -0.15..0.15 1/m, found -0.151"),
        (road(nan), "road.curvature_per_m: expected -0.15..0.15 1/m, found nan"),
        (road(bank_deg=-12.1), "road.bank_deg: expected -12..12 deg, found -12.1 at s = 0.0 m"),
        (road(grade=through((0.0, 50.0, 90.0), (0.0, 0.21, 0.0))),
         "road.grade_percent: expected -20..20 %, found 21 at s = 50.0 m"),
    ],
)  # fmt: skip
def test_a_road_out_of_its_limits_is_named_once(out: Road, message: str) -> None:
    (line,) = road_problems(out)
    assert line.startswith(message)


def test_all_parts_of_an_initial_state_are_named() -> None:
    lines = list(start_problems(Start(-1.0, 0.0, 5.1, nan)))
    assert [line.split(":")[0] for line in lines] == [
        "initial.speed_kmh", "initial.ey_m", "initial.epsi_deg"
    ]  # fmt: skip
