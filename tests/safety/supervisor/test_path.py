"""Which path and which road ahead the supervisor passes on, and how the car tracks the path."""

from dataclasses import replace

import pytest
from kinematic_car import (
    STRAIGHT,
    WITHOUT_FROZEN,
    WatchedCar,
    nothing,
    only,
    shifted,
    turning,
    undisturbed,
)

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import ControlInput, CurvaturePreview, PathReference
from rt_controller.safety.checks import CHECKS, Quantity
from rt_controller.safety.coast_model import StoppingCar

RAMP = CurvaturePreview(5.0, 0.0, 0.002, 0.004, 0.006, 0.008)


def test_a_path_that_is_faulty_in_a_stop_is_not_compared_or_followed_again() -> None:
    car = WatchedCar(checks=only(Quantity.PATH_STEP_M))
    car.tick(5)
    car.is_stopping = True
    car.path = STRAIGHT._replace(c0_m=0.6)
    assert car.tick().rejection is StopCause.PATH_JUMP
    car.path = STRAIGHT._replace(c0_m=0.1)
    qualified = car.tick()
    assert (qualified.rejection, qualified.is_path_received) == (StopCause.NONE, False)
    assert qualified.path == STRAIGHT
    assert car.supervisor.values[Quantity.PATH_STEP_M] == 0.0


def test_a_curvature_ahead_that_is_faulty_in_a_stop_is_not_used_again() -> None:
    flat = CurvaturePreview(5.0, *[0.0] * 5)
    car = WatchedCar(checks=only(Quantity.PREVIEW_STEP_PER_M), preview=flat)
    car.tick(5)
    car.is_stopping = True
    car.preview = CurvaturePreview(5.0, 0.0, 0.0, 0.0, 0.02, 0.02)
    qualified = car.tick()
    assert qualified.rejection is StopCause.PREVIEW_JUMP
    assert qualified.path == STRAIGHT
    car.preview = CurvaturePreview(5.0, 0.001, 0.001, 0.001, 0.001, 0.001)
    qualified = car.tick()
    assert (qualified.rejection, qualified.preview) == (StopCause.NONE, flat)


@pytest.mark.parametrize("is_state_lost", [False, True])
def test_a_curvature_ahead_that_contradicts_the_state_is_rejected_only_without_one(
    is_state_lost: bool,
) -> None:
    car = WatchedCar(preview=CurvaturePreview(5.0, *[0.0] * 5))
    car.tick(5)
    car.preview = CurvaturePreview(5.0, *[0.02] * 5)
    if is_state_lost:
        car.disturb = lambda received: replace(received, state=None)
    expected = StopCause.PREVIEW_JUMP if is_state_lost else StopCause.NONE
    assert car.tick().rejection is expected


@pytest.mark.parametrize("is_state_lost", [False, True])
def test_a_missing_curvature_ahead_is_estimated_only_with_the_state(is_state_lost: bool) -> None:
    car = WatchedCar(preview=RAMP, checks=())
    car.tick()
    car.preview = None
    if is_state_lost:
        car.disturb = nothing
    preview = car.tick().preview
    assert (preview is None) is not is_state_lost


def test_a_lost_path_is_replaced_by_the_last_one_moved_along() -> None:
    car = WatchedCar(path=STRAIGHT._replace(c1=0.02), epsi_rad=0.02)
    car.tick()
    car.path = None
    qualified = car.tick()
    assert not qualified.is_path_received
    assert qualified.is_measured
    assert qualified.path is not None
    assert qualified.path.c0_m == pytest.approx(0.01, rel=1e-3)


def test_in_a_stop_the_path_has_the_speed_of_the_braking_car() -> None:
    car = WatchedCar(checks=(), control=ControlInput(0.0, 60.0, 0.0))
    car.tick(3)
    driven = car.qualified[-1].path
    assert driven is not None
    assert driven.v_mps == STRAIGHT.v_mps
    car.is_stopping = True
    qualified = car.tick(10)
    assert qualified.path is not None
    assert qualified.path.v_mps == pytest.approx(car.state.vx_mps)
    assert qualified.path.a_mps2 == pytest.approx(-60.0 * StoppingCar().brake_mps2_per_n)


@pytest.mark.parametrize("is_stopping", [False, True])
def test_a_path_whose_speed_jumps_keeps_its_course(is_stopping: bool) -> None:
    """The drive is held and then stopped, each time along the path that arrives."""
    car = WatchedCar(checks=only(Quantity.PATH_SPEED_STEP_MPS))
    car.tick(5)
    car.is_stopping = is_stopping
    for c0_m in (0.05, 0.1):
        car.path = STRAIGHT._replace(c0_m=c0_m, v_mps=STRAIGHT.v_mps + 50.0)
        qualified = car.tick()
        assert qualified.rejection is StopCause.PATH_SPEED_JUMP
        assert qualified.is_path_received is is_stopping
        assert qualified.path is not None
        assert (qualified.path.c0_m, qualified.path.v_mps) == (c0_m, STRAIGHT.v_mps)
    car.path = STRAIGHT
    assert car.tick().rejection is StopCause.NONE


def test_without_any_path_there_is_none() -> None:
    car = WatchedCar(path=None)
    car.tick(2)
    assert car.qualified[-1].path is None


def test_a_rejected_state_is_not_measured_against_the_path() -> None:
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


def test_the_deviation_from_the_path_is_that_of_car_and_path_together() -> None:
    path = PathReference(2.0, 0.0, 0.0, 0.0, 20.0, 0.0)
    car = WatchedCar(checks=only(Quantity.TRACKING_M), ey_m=2.5, path=path)
    car.tick(2)
    assert car.supervisor.values[Quantity.TRACKING_M] == pytest.approx(0.5)


def test_a_path_that_is_received_again_is_passed_on_as_it_is() -> None:
    path = STRAIGHT._replace(c1=0.06)
    car = WatchedCar(checks=(), path=path)
    car.disturb = lambda received: replace(received, path=path)
    car.tick(3)
    assert car.qualified[-1].path is path


def test_a_car_without_a_path_is_not_refused_before_one_arrives() -> None:
    qualified = WatchedCar(path=None).tick()
    assert (qualified.is_path_received, qualified.rejection) == (False, StopCause.NONE)


@pytest.mark.parametrize("c0_m", [30.0, 0.6, -3.0])
def test_a_path_that_jumps_is_not_followed_but_the_last_one_is(c0_m: float) -> None:
    car = WatchedCar()
    car.tick(20)
    car.path = STRAIGHT._replace(c0_m=c0_m)
    qualified = car.tick()
    assert (qualified.rejection, qualified.is_path_received) == (StopCause.PATH_JUMP, False)
    assert qualified.path == STRAIGHT


def test_a_path_that_turns_at_once_is_not_followed() -> None:
    car = WatchedCar(epsi_rad=0.06, path=STRAIGHT._replace(c1=0.06))
    car.tick(2)
    car.path = STRAIGHT._replace(c0_m=2 * 0.06 * 0.5, c1=-0.06)
    qualified = car.tick()
    assert qualified.rejection is StopCause.PATH_JUMP
    assert qualified.path is not None
    assert qualified.path.c1 == 0.06


def test_a_path_that_is_frozen_while_the_car_moves_along_it_stops_the_car() -> None:
    sloped = STRAIGHT._replace(c1=0.06)
    car = WatchedCar(epsi_rad=0.06, path=sloped)
    alarms = [car.tick().alarm for _ in range(30)]
    assert StopCause.PATH_INCONSISTENT in alarms
    first = alarms.index(StopCause.PATH_INCONSISTENT)
    path = car.qualified[first].path
    assert path is not None
    assert path.c0_m == pytest.approx(0.06 * 0.5 * first, abs=0.1)


def test_a_path_that_continues_the_one_before_is_followed() -> None:
    car = WatchedCar(epsi_rad=0.06)
    for k in range(40):
        car.path = STRAIGHT._replace(c0_m=0.06 * 0.5 * k, c1=0.06)
        qualified = car.tick()
        assert qualified.alarm is StopCause.NONE
        assert qualified.is_path_received


def test_a_path_that_is_too_sharp_is_not_followed() -> None:
    car = WatchedCar(vx_mps=33.0)
    car.tick(5)
    car.path = STRAIGHT._replace(c2_per_m=0.005)
    qualified = car.tick()
    assert qualified.rejection is StopCause.PATH_TOO_SHARP
    assert not qualified.is_path_received


def test_a_wanted_speed_that_no_request_has_is_not_driven() -> None:
    car = WatchedCar()
    car.tick(5)
    car.path = STRAIGHT._replace(v_mps=100.0)
    qualified = car.tick()
    assert (qualified.rejection, qualified.is_path_received) == (StopCause.PATH_SPEED_JUMP, False)


def test_a_car_that_stays_far_from_its_path_is_stopped() -> None:
    car = WatchedCar(checks=[c for c in CHECKS if c.quantity is Quantity.TRACKING_M])
    car.tick(5)
    car.path = STRAIGHT._replace(c0_m=1.2)
    alarms = [car.tick().alarm for _ in range(8)]
    assert alarms[6] is StopCause.NONE
    assert alarms[7] is StopCause.TRACKING_LOST


def test_a_curvature_that_contradicts_the_preview_is_replaced_by_it() -> None:
    car = WatchedCar(WITHOUT_FROZEN, preview=CurvaturePreview(5.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    car.tick(20)
    car.disturb = lambda received: replace(received, curvature_per_m=0.003)
    causes = {car.tick().alarm for _ in range(20)}
    assert causes == {StopCause.NONE, StopCause.CURVATURE_IMPLAUSIBLE}
    assert car.qualified[-1].curvature_per_m == 0.0


@pytest.mark.parametrize("curvature_per_m", [0.01, -0.01])
def test_curvatures_that_are_wrong_together_are_replaced_by_the_road_before(
    curvature_per_m: float,
) -> None:
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
    assert qualified.preview is not None
    assert qualified.preview.k0_per_m == 0.003


def test_a_curvature_ahead_that_jumps_with_the_right_beginning_is_not_used() -> None:
    car = WatchedCar(preview=CurvaturePreview(5.0, *[0.0] * 5))
    car.tick(20)
    car.disturb = lambda received: replace(
        received, preview=CurvaturePreview(5.0, 0.0, 0.0, 0.0, 0.02, 0.02)
    )
    qualified = car.tick()
    assert (qualified.rejection, qualified.is_path_received) == (StopCause.PREVIEW_JUMP, False)
    assert qualified.path == STRAIGHT
