"""The supervisor refuses a car that is not where it can be taken over."""

import pytest
from kinematic_car import (
    STRAIGHT,
    WatchedCar,
    replaced,
)

from rt_controller.contract.faults import StopCause


@pytest.mark.parametrize(("ey_m", "epsi_rad"), [(1.5, 0.0), (0.0, 0.5), (-2.0, -0.3), (0.8, 0.1)])
def test_a_car_outside_of_the_engagement_window_is_refused(ey_m: float, epsi_rad: float) -> None:
    qualified = WatchedCar(ey_m=ey_m, epsi_rad=epsi_rad).tick()
    assert (qualified.rejection, qualified.is_measured) == (StopCause.NOT_ENGAGED, False)


def test_a_path_that_is_too_sharp_is_refused_at_the_start() -> None:
    car = WatchedCar(vx_mps=33.0, path=STRAIGHT._replace(c2_per_m=0.005))
    assert car.tick().rejection is StopCause.NOT_ENGAGED


def test_a_car_inside_of_the_window_is_taken_over() -> None:
    qualified = WatchedCar(ey_m=0.8, epsi_rad=-0.1).tick()
    assert (qualified.rejection, qualified.is_measured) == (StopCause.NONE, True)


@pytest.mark.parametrize(("vx_mps", "is_refused"), [(16.7, False), (33.3, True)])
def test_a_heading_that_leads_far_from_the_path_at_this_speed_is_refused(
    vx_mps: float, is_refused: bool
) -> None:
    qualified = WatchedCar(vx_mps=vx_mps, epsi_rad=0.1).tick()
    assert (qualified.rejection is StopCause.NOT_ENGAGED) == is_refused


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("away_mps", "is_refused"), [(-1.0, False), (1.0, True)])
def test_a_car_that_slides_away_from_the_path_is_refused(
    side: float, away_mps: float, is_refused: bool
) -> None:
    car = WatchedCar(ey_m=0.9 * side, disturb=replaced(vy_mps=away_mps * side))
    assert (car.tick().rejection is StopCause.NOT_ENGAGED) == is_refused
