"""What a lost or faulty state is replaced by, and when a prediction begins."""

from dataclasses import replace

import pytest
from kinematic_car import (
    STRAIGHT,
    WITHOUT_FROZEN,
    WatchedCar,
    growing,
    nothing,
    only,
    replaced,
    shifted,
    undisturbed,
)

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import NEUTRAL_INPUT, CurvaturePreview, VehicleState
from rt_controller.safety.checks import Quantity, Reaction
from rt_controller.safety.isolation import Faulty
from rt_controller.safety.motion import MotionPrediction
from rt_controller.safety.tick import Estimate

RAMP = CurvaturePreview(5.0, 0.0, 0.002, 0.004, 0.006, 0.008)


def spy(car: WatchedCar) -> list[str]:
    """Names of the calls that begin, end or advance predictions."""
    calls: list[str] = []

    class Spy(MotionPrediction):
        def begin(self, psi: object) -> None:
            calls.append("begin")
            super().begin(psi)  # type: ignore[arg-type]

        def advance(self, applied: object, curvature_per_m: float) -> None:
            calls.append("advance")
            super().advance(applied, curvature_per_m)  # type: ignore[arg-type]

        def fall_back(self) -> None:
            calls.append("fall_back")
            super().fall_back()

    assert car.supervisor._prediction is not None
    car.supervisor._prediction.__class__ = Spy
    return calls


def test_a_drive_begins_without_predictions() -> None:
    car = WatchedCar()
    calls = spy(car)
    car.tick(3)
    assert calls == ["begin", "advance", "begin", "advance", "begin"]
    car.is_driven = False
    car.disturb = replaced(vx_mps=5.0)
    assert car.tick().rejection is StopCause.NONE


def test_a_lost_state_is_estimated_on_the_road_that_was_seen_ahead() -> None:
    car = WatchedCar(checks=(), preview=RAMP)
    car.tick()
    car.disturb = nothing
    heading_rad, place_m = 0.0, 0.0
    for _ in range(3):
        qualified = car.tick()
        heading_rad -= 0.5 * (0.0004 * place_m + 0.0004 * (place_m + 0.5)) * 0.5
        place_m += 0.5
        assert qualified.curvature_per_m == pytest.approx(0.0004 * place_m)
        assert qualified.state is not None
        assert qualified.state.epsi_rad == pytest.approx(heading_rad)
        assert qualified.state.ds_m == 0.5
        assert qualified.preview is not None
        assert qualified.preview.k0_per_m == pytest.approx(0.0004 * place_m)


@pytest.mark.parametrize("periods", [1, 3, 4, 6])
def test_skipped_periods_move_road_path_and_predictions_on(periods: int) -> None:
    sloped = STRAIGHT._replace(c1=0.06)
    car = WatchedCar(checks=(), preview=RAMP, path=sloped)
    calls = spy(car)
    car.tick()
    car.disturb = lambda received: replace(nothing(received), periods=periods)
    qualified = car.tick()
    assert qualified.curvature_per_m == pytest.approx(0.0004 * 0.5 * periods)
    assert qualified.path is not None
    assert qualified.path.c0_m == pytest.approx(0.06 * 0.5 * periods)
    assert calls == ["begin", *["advance"] * min(periods, 4)]


def test_a_lost_state_moves_with_the_command_that_was_sent() -> None:
    car = WatchedCar(checks=())
    car.tick(2)
    car.control = NEUTRAL_INPUT._replace(brake_n=40.0)
    car.tick()
    car.disturb = lambda received: replace(nothing(received), applied=NEUTRAL_INPUT)
    qualified = car.tick()
    assert qualified.state is not None
    assert qualified.state.vx_mps == pytest.approx(car.qualified[-2].state.vx_mps - 0.05)  # type: ignore[union-attr]


@pytest.mark.parametrize(("vx_mps", "is_modelled"), [(7.0, True), (6.99, False)])
def test_below_7_m_per_s_the_model_is_not_used(vx_mps: float, is_modelled: bool) -> None:
    car = WatchedCar(checks=(), vx_mps=vx_mps)
    calls = spy(car)
    car.tick(2)
    assert ("advance" in calls) is is_modelled


def test_without_measured_motion_predictions_go_on_until_they_are_old() -> None:
    car = WatchedCar(checks=())
    calls = spy(car)
    car.tick()
    car.disturb = nothing
    car.tick(80)
    assert calls == ["begin", *["advance"] * 80, "begin"]


def test_without_a_lifted_state_no_prediction_begins() -> None:
    car = WatchedCar()
    calls = spy(car)
    car.supervisor.note(car.control, None)
    assert calls == []


def test_a_drift_of_the_motion_takes_the_predictions_back_once() -> None:
    checks = [
        check._replace(reaction=Reaction.STOP) for check in only(Quantity.YAW_RATE_STEP_RADPS)
    ]
    car = WatchedCar(checks=checks)
    calls = spy(car)
    car.tick(20)
    car.disturb = shifted(yaw_rate_radps=0.3)
    car.tick(5)
    assert calls.count("fall_back") == 1


@pytest.mark.parametrize(
    ("quantity", "reaction", "signals"),
    [
        (Quantity.LATERAL_ERROR_M, Reaction.STOP, {"ey_m": 1.0}),
        (Quantity.YAW_RATE_STEP_RADPS, Reaction.REJECT_STATE, {"yaw_rate_radps": 0.3}),
    ],
)
def test_neither_a_place_nor_an_outlier_takes_the_predictions_back(
    quantity: Quantity, reaction: Reaction, signals: dict[str, float]
) -> None:
    car = WatchedCar(checks=[only(quantity)[0]._replace(reaction=reaction)])
    calls = spy(car)
    car.tick(20)
    car.disturb = shifted(**signals)
    assert not car.tick().is_measured
    assert "fall_back" not in calls


def test_a_heading_that_jumps_alone_leaves_the_other_signals_measured() -> None:
    car = WatchedCar(checks=only(Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M))
    car.tick(20)
    car.disturb = shifted(epsi_rad=0.1, vx_mps=0.2)
    qualified = car.tick()
    assert qualified.rejection is StopCause.HEADING_IMPLAUSIBLE
    assert qualified.state is not None
    assert qualified.state.vx_mps == pytest.approx(20.2)
    assert qualified.state.epsi_rad == pytest.approx(0.0, abs=1e-3)


def test_heading_and_lateral_error_that_jump_together_replace_the_whole_state() -> None:
    car = WatchedCar(checks=only(Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M))
    car.tick(20)
    car.disturb = shifted(epsi_rad=0.1, ey_m=1.0, vx_mps=0.2)
    qualified = car.tick()
    assert qualified.state is not None
    assert qualified.state.vx_mps == pytest.approx(20.0)
    assert qualified.state.ey_m == pytest.approx(0.0, abs=1e-3)


def test_the_speed_difference_is_cleared_only_if_speed_or_progress_is_faulty() -> None:
    car = WatchedCar(checks=only(Quantity.PROGRESS_STEP_M, Quantity.LATERAL_ERROR_M))
    car.tick(20)
    car.is_stopping = True
    slips = []
    for disturbance in (shifted(ds_m=0.015), shifted(ds_m=0.015, ey_m=1.0), shifted(ds_m=0.015)):
        car.disturb = disturbance
        car.tick()
        slips.append(car.supervisor.values[Quantity.PROGRESS_SPEED_MPS])
    assert slips == pytest.approx([0.06, 0.114, 0.1626], rel=1e-3)
    car.disturb = shifted(ds_m=0.1)
    car.tick()
    car.disturb = undisturbed
    car.tick()
    assert car.supervisor.values[Quantity.PROGRESS_SPEED_MPS] == pytest.approx(0.0, abs=1e-9)


def test_equal_curvatures_do_not_make_the_curvature_suspicious() -> None:
    road = CurvaturePreview(5.0, *[0.003] * 5)
    car = WatchedCar(WITHOUT_FROZEN, curvature_per_m=0.003, preview=road, has_model=False)
    car.control = car.control._replace(steer_rad=0.2)
    car.tick(20)
    car.disturb = shifted(yaw_rate_radps=0.03)
    causes = {car.tick().alarm for _ in range(40)}
    assert causes - {StopCause.NONE} == {StopCause.YAW_RATE_IMPLAUSIBLE}


def test_a_speed_is_known_from_speed_or_progress() -> None:
    for faulty, expected_mps in (
        (Faulty.SPEED, 0.4 / 0.025),
        (Faulty.PROGRESS, 20.0),
        (Faulty.SPEED | Faulty.PROGRESS, None),
    ):
        car = WatchedCar(checks=())
        car.tick(2)
        car.supervisor._faulty = faulty
        car.disturb = replaced(ds_m=0.4)
        qualified = car.tick()
        assert qualified.speed_mps == (
            None if expected_mps is None else pytest.approx(expected_mps)
        )
        assert not qualified.is_measured


def test_a_faulty_curvature_makes_the_state_estimated() -> None:
    car = WatchedCar(checks=(), preview=RAMP)
    car.tick(1)
    car.supervisor._faulty = Faulty.CURVATURE
    car.preview = None
    qualified = car.tick()
    assert not qualified.is_measured
    assert qualified.curvature_per_m == pytest.approx(0.0002)
    assert qualified.preview is not None


def test_a_car_without_checks_repeats_what_it_receives() -> None:
    car = WatchedCar(checks=())
    car.tick(3)
    qualified = car.qualified[-1]
    assert isinstance(qualified.state, VehicleState)
    assert qualified == Estimate(car.state, 0.0, STRAIGHT, None, True, True, 20.0)


def test_a_heading_is_integrated_with_the_road_when_the_curvature_is_faulty() -> None:
    checks = only(Quantity.CURVATURE_STEP_PER_M)
    road = CurvaturePreview(5.0, *[0.003] * 5)
    car = WatchedCar(checks=checks, curvature_per_m=0.003, preview=road)
    car.tick(5)
    car.disturb, car.is_stopping = lambda received: replace(received, curvature_per_m=0.013), True
    for _ in range(3):
        qualified = car.tick()
        assert qualified.curvature_per_m == pytest.approx(0.003)
    assert car.supervisor.values[Quantity.HEADING_RAD] == pytest.approx(0.0, abs=1e-6)


def test_after_a_drift_of_v_y_the_measured_lateral_error_is_accepted() -> None:
    car = WatchedCar()
    car.tick(20)
    car.disturb = growing("vy_mps", 0.03)
    while not car.is_stopping:
        assert len(car.qualified) < 80
        car.is_stopping = car.tick().alarm is StopCause.LATERAL_SPEED_IMPLAUSIBLE
    last = car.tick(5).state
    assert last is not None
    assert last.ey_m == car.state.ey_m
