"""Paths and curvatures: rejected, replaced, a stop, or approached smoothly."""

from dataclasses import replace
from math import isnan

import numpy as np
import pytest
from kinematic_car import (
    STRAIGHT,
    WITHOUT_FROZEN,
    WatchedCar,
    driven,
    nothing,
    only,
    shifted,
    turning,
    undisturbed,
)

from rt_controller.contract.faults import StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import ControlInput, CurvaturePreview, PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.coast_model import StoppingCar

RAMP = CurvaturePreview(5.0, 0.0, 0.002, 0.004, 0.006, 0.008)
FLAT = CurvaturePreview(5.0, *[0.0] * 5)


def test_a_path_that_is_faulty_in_a_stop_is_not_compared_or_followed_again():
    car = driven(5, checks=only(Quantity.PATH_STEP_M))
    car.is_stopping = True
    car.path = STRAIGHT._replace(c0_m=0.6)
    assert car.tick().rejection is StopCause.PATH_JUMP
    car.path = STRAIGHT._replace(c0_m=0.1)
    qualified = car.tick()
    assert (qualified.rejection, qualified.is_path_received) == (StopCause.NONE, False)
    assert qualified.path == STRAIGHT
    assert isnan(car.supervisor.values[Quantity.PATH_STEP_M])


def test_a_curvature_ahead_that_is_faulty_in_a_stop_is_not_used_again():
    car = driven(5, only(Quantity.PREVIEW_STEP_PER_M), preview=FLAT)
    car.is_stopping = True
    for preview, rejection in (
        (FLAT._replace(k3_per_m=0.02, k4_per_m=0.02), StopCause.PREVIEW_JUMP),
        (CurvaturePreview(5.0, *[0.001] * 5), StopCause.NONE),
    ):
        car.preview = preview
        qualified = car.tick()
        assert (qualified.rejection, qualified.path) == (rejection, STRAIGHT)
    assert qualified.preview == FLAT


@pytest.mark.parametrize("is_state_lost", [False, True])
def test_without_a_state_a_curvature_ahead_is_rejected_if_it_jumps_and_not_estimated(is_state_lost):
    car = driven(5, preview=FLAT)
    car.preview = CurvaturePreview(5.0, *[0.02] * 5)
    if is_state_lost:
        car.disturb = lambda received: replace(received, state=None)
    assert car.tick().rejection is (StopCause.PREVIEW_JUMP if is_state_lost else StopCause.NONE)
    car = driven(1, (), preview=RAMP)
    car.preview = None
    if is_state_lost:
        car.disturb = nothing
    assert (car.tick().preview is None) is not is_state_lost
    car.is_stopping = True
    assert (car.tick().preview is None) is not is_state_lost


@pytest.mark.parametrize("ticks", [1, 3])
def test_an_implausible_curvature_ahead_is_used_in_a_stop_at_most(ticks):
    car = driven(ticks, (), preview=RAMP)
    assert None not in {qualified.preview for qualified in car.qualified}
    car = driven(ticks, (), preview=RAMP, disturb=implausible)
    assert {qualified.preview for qualified in car.qualified} == {None}
    car.is_stopping = True
    assert car.tick().preview is not None


def implausible(received):
    return replace(received, has_implausible_preview=True)


def test_a_lost_path_is_replaced_by_the_last_one_moved_along():
    car = driven(1, path=STRAIGHT._replace(c1=0.02), epsi_rad=0.02)
    car.path = None
    qualified = car.tick()
    assert not qualified.is_path_received
    assert qualified.is_measured
    assert qualified.path.c0_m == pytest.approx(0.01, rel=1e-3)


def test_in_a_stop_the_path_has_the_speed_of_the_braking_car():
    car = driven(3, checks=(), control=ControlInput(0.0, 60.0, 0.0))
    assert car.qualified[-1].path.v_mps == STRAIGHT.v_mps
    car.is_stopping = True
    qualified = car.tick(10)
    assert qualified.path.v_mps == pytest.approx(car.state.vx_mps)
    assert qualified.path.a_mps2 == pytest.approx(-60.0 * StoppingCar().brake_mps2_per_n)


@pytest.mark.parametrize("is_stopping", [False, True])
def test_a_path_whose_speed_jumps_keeps_its_course(is_stopping):
    """The drive is held and then stopped, each time along the path that arrives."""
    car = driven(5, checks=only(Quantity.PATH_SPEED_STEP_MPS))
    car.is_stopping = is_stopping
    for c0_m in (0.05, 0.1):
        car.path = STRAIGHT._replace(c0_m=c0_m, v_mps=STRAIGHT.v_mps + 50.0)
        qualified = car.tick()
        assert qualified.rejection is StopCause.PATH_SPEED_JUMP
        assert qualified.is_path_received is is_stopping
        assert (qualified.path.c0_m, qualified.path.v_mps) == (c0_m, STRAIGHT.v_mps)
    car.path = STRAIGHT
    assert car.tick().rejection is StopCause.NONE


def test_without_any_path_there_is_none_and_the_car_is_not_refused():
    car = WatchedCar(path=None)
    qualified = car.tick()
    assert (qualified.is_path_received, qualified.rejection) == (False, StopCause.NONE)
    assert car.tick().path is None


def test_a_rejected_state_is_not_measured_against_the_path():
    tracking = only(Quantity.TRACKING_M)[0]._replace(window_ticks=1)
    for disturbance, path, is_stopping, is_found in (
        (undisturbed, STRAIGHT._replace(c0_m=1.2), False, True),
        (undisturbed, STRAIGHT._replace(c0_m=-1.2), False, True),
        (undisturbed, STRAIGHT._replace(c0_m=1.2), True, False),
        (shifted(ds_m=0.1), STRAIGHT._replace(c0_m=1.2), False, False),
        (undisturbed, STRAIGHT._replace(c0_m=1.2, c1=0.1), False, False),
        (lambda received: replace(received, state=None), STRAIGHT._replace(c0_m=1.2), False, False),
        (undisturbed, None, False, False),
    ):
        checks = [tracking, *only(Quantity.PROGRESS_STEP_M, Quantity.PATH_TURN_RAD)]
        car = WatchedCar(checks=checks)
        car.tick(5)
        car.disturb, car.path, car.is_stopping = disturbance, path, is_stopping
        assert (car.tick().alarm is StopCause.TRACKING_LOST) is is_found


def test_the_deviation_from_the_path_is_that_of_car_and_path_together():
    path = PathReference(2.0, 0.0, 0.0, 0.0, 20.0, 0.0)
    car = driven(2, checks=only(Quantity.TRACKING_M), ey_m=2.5, path=path)
    assert car.supervisor.values[Quantity.TRACKING_M] == pytest.approx(0.5)


def test_a_path_that_is_received_again_is_passed_on_as_it_is():
    path = STRAIGHT._replace(c1=0.06)
    car = WatchedCar(checks=(), path=path)
    car.disturb = lambda received: replace(received, path=path)
    car.tick(3)
    assert car.qualified[-1].path is path
    car = driven(3, only(Quantity.PREVIEW_STEP_PER_M), path=path, preview=FLAT, disturb=car.disturb)
    car.preview = FLAT._replace(k3_per_m=0.02)
    assert (car.tick().rejection, car.tick().path) == (StopCause.PREVIEW_JUMP, path)


SLOPED = {"epsi_rad": 0.06, "path": STRAIGHT._replace(c1=0.06)}


@pytest.mark.parametrize(
    ("car", "path", "preview", "cause"),
    [
        ({}, {"c0_m": 30.0}, None, StopCause.PATH_JUMP),
        ({}, {"c0_m": 0.6}, None, StopCause.PATH_JUMP),
        ({}, {"c0_m": -3.0}, None, StopCause.PATH_JUMP),
        (SLOPED, {"c0_m": 2 * 0.06 * 0.5, "c1": -0.06}, None, StopCause.PATH_JUMP),
        ({"vx_mps": 33.0}, {"c2_per_m": 0.005}, None, StopCause.PATH_TOO_SHARP),
        ({}, {"v_mps": 100.0}, None, StopCause.PATH_SPEED_JUMP),
        ({"preview": FLAT}, {}, FLAT._replace(k3_per_m=0.02), StopCause.PREVIEW_JUMP),
    ],
)
def test_a_path_that_cannot_be_driven_is_not_followed_but_the_last_one_is(
    car, path, preview, cause
):
    watched = driven(2, **car)
    before = watched.path
    watched.path, watched.preview = STRAIGHT._replace(**path), preview
    qualified = watched.tick()
    assert (qualified.rejection, qualified.is_path_received) == (cause, False)
    assert qualified.path[1:4] == before[1:4]
    assert qualified.path.c0_m == pytest.approx(before.c1 * 0.5, abs=1e-4)


def test_a_path_that_is_frozen_while_the_car_moves_along_it_stops_the_car():
    sloped = STRAIGHT._replace(c1=0.06)
    car = WatchedCar(epsi_rad=0.06, path=sloped)
    alarms = [car.tick().alarm for _ in range(30)]
    assert StopCause.PATH_INCONSISTENT in alarms
    first = alarms.index(StopCause.PATH_INCONSISTENT)
    assert car.qualified[first].path.c0_m == pytest.approx(0.06 * 0.5 * first, abs=0.1)


def test_a_path_that_continues_the_one_before_is_followed():
    car = WatchedCar(epsi_rad=0.06)
    for k in range(40):
        car.path = STRAIGHT._replace(c0_m=0.06 * 0.5 * k, c1=0.06)
        qualified = car.tick()
        assert qualified.alarm is StopCause.NONE
        assert qualified.is_path_received


def test_a_curvature_that_contradicts_the_preview_is_replaced_by_it():
    car = driven(20, WITHOUT_FROZEN, preview=CurvaturePreview(5.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    car.disturb = lambda received: replace(received, curvature_per_m=0.003)
    causes = {car.tick().alarm for _ in range(20)}
    assert causes == {StopCause.NONE, StopCause.CURVATURE_IMPLAUSIBLE}
    assert car.qualified[-1].curvature_per_m == 0.0


@pytest.mark.parametrize("curvature_per_m", [0.01, -0.01])
def test_curvatures_that_are_wrong_together_are_replaced_by_the_road_before(curvature_per_m):
    road = CurvaturePreview(5.0, *[0.003] * 5)
    car = turning(preview=road)
    car.tick(20)
    wrong = CurvaturePreview(5.0, *[0.003 + curvature_per_m] * 5)
    car.disturb = lambda received: replace(
        received, curvature_per_m=0.003 + curvature_per_m, preview=CurvaturePreview(*wrong)
    )
    qualified = car.tick()
    assert qualified.rejection is StopCause.CURVATURE_IMPLAUSIBLE
    assert (qualified.curvature_per_m, qualified.preview) == (0.003, road)
    car.is_stopping = True
    qualified = car.tick(100)
    assert qualified.curvature_per_m == 0.003
    assert qualified.preview.k0_per_m == 0.003


FOLLOWED = [check for check in WITHOUT_FROZEN if check.quantity is not Quantity.TRACKING_M]
"""the scripted car does not follow its path"""


def followed(paths):
    """What is to be followed, with these paths, one in each period; no check fails."""
    car = driven(5, FOLLOWED)
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
    v_mps, a_mps2, lowest_mps2, highest_mps2
):
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
def test_a_speed_that_changes_with_its_acceleration_is_followed_as_it_is(a_mps2):
    paths = [
        STRAIGHT._replace(v_mps=20.0 + a_mps2 * PERIOD_S * k, a_mps2=a_mps2) for k in range(80)
    ]
    assert followed(paths) == paths


@pytest.mark.parametrize("step_m", [0.15, 0.3, -0.5])
def test_a_path_that_moves_sideways_is_approached_within_two_seconds(step_m):
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


def test_two_requests_in_a_row_are_one_steady_path():
    moved = [STRAIGHT._replace(c0_m=0.4)] * 10 + [STRAIGHT._replace(c0_m=-0.1)] * 200
    places = np.array([path.c0_m for path in followed(moved)])
    assert np.abs(np.diff(places)).max() < 0.02
    assert places[-1] == -0.1
