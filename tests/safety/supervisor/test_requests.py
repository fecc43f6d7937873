"""Requests that change at once: other speeds, and paths beside the one that is followed."""

import numpy as np
import pytest
from kinematic_car import STRAIGHT, WITHOUT_FROZEN, WatchedCar

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.checks import Quantity

CHECKS = [check for check in WITHOUT_FROZEN if check.quantity is not Quantity.TRACKING_M]
"""the scripted car does not follow its path"""


def followed(paths: list[PathReference]) -> list[PathReference]:
    """What is to be followed, with these paths, one in each period; no check fails."""
    car = WatchedCar(CHECKS)
    car.tick(5)
    found = []
    for path in paths:
        car.path = path
        qualified = car.tick()
        assert (qualified.alarm, qualified.rejection) == (StopCause.NONE, StopCause.NONE)
        assert qualified.is_path_received
        assert qualified.path is not None
        found.append(qualified.path)
    return found


@pytest.mark.parametrize(
    ("v_mps", "a_mps2", "lowest_mps2", "highest_mps2"),
    [
        (17.0, 0.0, -3.0, 0.0),
        (0.0, 0.0, -3.0, 0.0),
        (15.0, -5.0, -8.0, -5.0),
        (25.0, 0.0, 0.0, 2.0),
        (28.0, 3.0, 3.0, 5.0),
    ],
)
def test_another_wanted_speed_is_approached_at_a_comfortable_rate(
    v_mps: float, a_mps2: float, lowest_mps2: float, highest_mps2: float
) -> None:
    found = followed([STRAIGHT._replace(v_mps=v_mps, a_mps2=a_mps2)] * 600)
    speeds = np.array([20.0, *(path.v_mps for path in found)])
    rates = np.diff(speeds) / PERIOD_S
    is_on_the_way = np.abs(speeds[1:] - v_mps) > 0.5
    assert np.all(rates[is_on_the_way] >= lowest_mps2 - 1e-6)
    assert np.all(rates[is_on_the_way] <= highest_mps2 + 1e-6)
    fastest = rates.max() if v_mps > 20.0 else rates.min()
    assert fastest == pytest.approx(highest_mps2 if v_mps > 20.0 else lowest_mps2, abs=0.2)
    assert found[-1] == STRAIGHT._replace(v_mps=v_mps, a_mps2=a_mps2)


@pytest.mark.parametrize("a_mps2", [-8.0, -3.0, 1.0, 4.0])
def test_a_speed_that_changes_with_its_acceleration_is_followed_as_it_is(a_mps2: float) -> None:
    paths = [
        STRAIGHT._replace(v_mps=20.0 + a_mps2 * PERIOD_S * k, a_mps2=a_mps2) for k in range(80)
    ]
    assert followed(paths) == paths


@pytest.mark.parametrize("step_m", [0.15, 0.3, -0.5])
def test_a_path_that_moves_sideways_is_approached_within_two_seconds(step_m: float) -> None:
    found = followed([STRAIGHT._replace(c0_m=step_m)] * 160)
    places = np.array([path.c0_m for path in found])
    assert abs(places[0]) < 0.01
    assert places[80] == pytest.approx(step_m, abs=0.03)
    assert found[-1] == STRAIGHT._replace(c0_m=step_m)
    speeds = np.diff(places[:80]) / PERIOD_S
    accelerations = np.diff(speeds) / PERIOD_S
    assert np.abs(accelerations).max() < 3.0 * abs(step_m)
    assert np.abs(np.diff(accelerations)).max() / PERIOD_S < 45.0 * abs(step_m)
    for path, speed_mps in zip(found[1:79], speeds[1:], strict=True):
        assert path.c1 == pytest.approx(speed_mps / 20.0, abs=2e-3)


def test_two_requests_in_a_row_are_one_steady_path() -> None:
    moved = [STRAIGHT._replace(c0_m=0.4)] * 10 + [STRAIGHT._replace(c0_m=-0.1)] * 200
    places = np.array([path.c0_m for path in followed(moved)])
    assert np.abs(np.diff(places)).max() < 0.02
    assert places[-1] == -0.1
