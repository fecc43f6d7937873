"""What a lost or faulty state is replaced by, in a drive and in a stop."""

from dataclasses import replace

import pytest
from kinematic_car import (
    STRAIGHT,
    WITHOUT_FROZEN,
    WatchedCar,
    driven,
    growing,
    nothing,
    only,
    replaced,
    shifted,
    turning,
    undisturbed,
)

from rt_controller.contract.faults import StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import NEUTRAL_INPUT, CurvaturePreview
from rt_controller.safety.checks import Reaction
from rt_controller.safety.isolation import Faulty
from rt_controller.safety.motion import MotionPrediction
from rt_controller.safety.tick import Estimate

RAMP = CurvaturePreview(5.0, 0.0, 0.002, 0.004, 0.006, 0.008)


def spy(car):
    """Names of the calls that begin, end or advance predictions."""
    calls = []

    class Spy(MotionPrediction):
        def begin(self, psi):
            calls.append("begin")
            super().begin(psi)

        def advance(self, applied, curvature_per_m):
            calls.append("advance")
            super().advance(applied, curvature_per_m)

        def fall_back(self):
            calls.append("fall_back")
            super().fall_back()

    car.supervisor._prediction.__class__ = Spy
    return calls


def test_a_drive_begins_without_predictions():
    car = WatchedCar()
    calls = spy(car)
    car.tick(3)
    assert calls == ["begin", "advance", "begin", "advance", "begin"]
    car.is_driven = False
    car.disturb = replaced(vx_mps=5.0)
    assert car.tick().rejection is StopCause.NONE


def test_a_lost_state_is_estimated_on_the_road_that_was_seen_ahead():
    car = driven(1, checks=(), preview=RAMP)
    car.disturb = nothing
    heading_rad, place_m = 0.0, 0.0
    for _ in range(3):
        qualified = car.tick()
        heading_rad -= 0.5 * (0.0004 * place_m + 0.0004 * (place_m + 0.5)) * 0.5
        place_m += 0.5
        assert qualified.curvature_per_m == pytest.approx(0.0004 * place_m)
        assert qualified.state.epsi_rad == pytest.approx(heading_rad)
        assert qualified.state.ds_m == 0.5
        assert qualified.preview.k0_per_m == pytest.approx(0.0004 * place_m)


@pytest.mark.parametrize("periods", [1, 3, 4, 6])
def test_skipped_periods_move_road_path_and_predictions_on(periods):
    sloped = STRAIGHT._replace(c1=0.06)
    car = WatchedCar(checks=(), preview=RAMP, path=sloped)
    calls = spy(car)
    car.tick()
    car.disturb = lambda received: replace(nothing(received), periods=periods)
    qualified = car.tick()
    assert qualified.curvature_per_m == pytest.approx(0.0004 * 0.5 * periods)
    assert qualified.path.c0_m == pytest.approx(0.06 * 0.5 * periods)
    assert calls == ["begin", *["advance"] * min(periods, 4)]


def test_a_lost_state_moves_with_the_command_that_was_sent():
    car = driven(2, checks=())
    car.control = NEUTRAL_INPUT._replace(brake_n=40.0)
    car.tick()
    car.disturb = lambda received: replace(nothing(received), applied=NEUTRAL_INPUT)
    assert car.tick().state.vx_mps == pytest.approx(car.qualified[-2].state.vx_mps - 0.05)


@pytest.mark.parametrize(("vx_mps", "is_modelled"), [(7.0, True), (6.99, False)])
def test_below_7_m_per_s_the_model_is_not_used(vx_mps, is_modelled):
    car = WatchedCar(checks=(), vx_mps=vx_mps)
    calls = spy(car)
    car.tick(2)
    assert ("advance" in calls) is is_modelled


def test_without_measured_motion_predictions_go_on_until_they_are_old():
    car = WatchedCar(checks=())
    calls = spy(car)
    car.tick()
    car.disturb = nothing
    car.tick(80)
    assert calls == ["begin", *["advance"] * 80, "begin"]


def test_without_a_lifted_state_no_prediction_begins():
    car = WatchedCar()
    calls = spy(car)
    car.supervisor.note(car.control, None)
    assert calls == []


@pytest.mark.parametrize(
    ("quantity", "reaction", "signals", "ticks", "times"),
    [
        (Quantity.YAW_RATE_STEP_RADPS, Reaction.STOP, {"yaw_rate_radps": 0.3}, 5, 1),
        (Quantity.YAW_RATE_STEP_RADPS, Reaction.REJECT_STATE, {"yaw_rate_radps": 0.3}, 1, 0),
        (Quantity.LATERAL_ERROR_M, Reaction.STOP, {"ey_m": 1.0}, 1, 0),
    ],
    ids=["a drift", "an outlier", "a place"],
)
def test_only_a_drift_of_the_motion_takes_the_predictions_back_and_once(
    quantity, reaction, signals, ticks, times
):
    car = WatchedCar(checks=[only(quantity)[0]._replace(reaction=reaction)])
    calls = spy(car)
    car.tick(20)
    car.disturb = shifted(**signals)
    assert not car.tick().is_measured
    car.tick(ticks)
    assert calls.count("fall_back") == times


@pytest.mark.parametrize(("ey_m", "vx_mps"), [(0.0, 20.2), (1.0, 20.0)])
def test_a_heading_that_jumps_alone_leaves_the_other_signals_measured(ey_m, vx_mps):
    """Together with the lateral error it replaces the whole state."""
    car = driven(20, only(Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M))
    car.disturb = shifted(epsi_rad=0.1, vx_mps=0.2, ey_m=ey_m)
    qualified = car.tick()
    assert qualified.rejection is StopCause.HEADING_IMPLAUSIBLE
    assert qualified.state.vx_mps == pytest.approx(vx_mps)
    assert qualified.state.epsi_rad == pytest.approx(0.0, abs=1e-3)
    assert qualified.state.ey_m == pytest.approx(0.0, abs=1e-3)


def test_the_speed_difference_is_cleared_only_if_speed_or_progress_is_faulty():
    car = driven(20, checks=only(Quantity.PROGRESS_STEP_M, Quantity.LATERAL_ERROR_M))
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


def test_equal_curvatures_do_not_make_the_curvature_suspicious():
    road = CurvaturePreview(5.0, *[0.003] * 5)
    car = WatchedCar(WITHOUT_FROZEN, curvature_per_m=0.003, preview=road, has_model=False)
    car.control = car.control._replace(steer_rad=0.2)
    car.tick(20)
    car.disturb = shifted(yaw_rate_radps=0.03)
    causes = {car.tick().alarm for _ in range(40)}
    assert causes - {StopCause.NONE} == {StopCause.YAW_RATE_IMPLAUSIBLE}


def test_a_speed_is_known_from_speed_or_progress():
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


def test_a_faulty_curvature_makes_the_state_estimated():
    car = driven(1, checks=(), preview=RAMP)
    car.supervisor._faulty = Faulty.CURVATURE
    car.preview = None
    qualified = car.tick()
    assert not qualified.is_measured
    assert qualified.curvature_per_m == pytest.approx(0.0002)
    assert qualified.preview is not None


def test_a_car_without_checks_repeats_what_it_receives():
    car = driven(3, ())
    assert car.qualified[-1] == Estimate(car.state, 0.0, STRAIGHT, None, True, True, 20.0)
    car.disturb = replaced(vx_mps=0.0, ey_m=20.0)
    qualified = car.tick(5)
    assert qualified.is_measured
    assert qualified.state.ey_m == 20.0


def test_a_heading_is_integrated_with_the_road_when_the_curvature_is_faulty():
    checks = only(Quantity.CURVATURE_STEP_PER_M)
    road = CurvaturePreview(5.0, *[0.003] * 5)
    car = driven(5, checks=checks, curvature_per_m=0.003, preview=road)
    car.disturb, car.is_stopping = lambda received: replace(received, curvature_per_m=0.013), True
    for _ in range(3):
        assert car.tick().curvature_per_m == pytest.approx(0.003)
    assert car.supervisor.values[Quantity.HEADING_RAD] == pytest.approx(0.0, abs=1e-6)


def test_a_measured_curvature_is_used_beside_a_faulty_lateral_error():
    car = driven(5, preview=CurvaturePreview(5.0, *[0.0] * 5))
    for ey_m in (1.0, 0.0):
        car.disturb = lambda received, ey_m=ey_m: shifted(ey_m=ey_m)(
            replace(received, curvature_per_m=0.0005)
        )
        qualified = car.tick()
        assert qualified.curvature_per_m == 0.0005
        assert qualified.is_measured is (ey_m == 0.0)


def test_after_a_drift_of_v_y_the_measured_lateral_error_is_accepted():
    car = driven(20)
    car.disturb = growing("vy_mps", 0.03)
    while not car.is_stopping:
        assert len(car.qualified) < 80
        car.is_stopping = car.tick().alarm is StopCause.LATERAL_SPEED_IMPLAUSIBLE
    assert car.tick(5).state.ey_m == car.state.ey_m


@pytest.mark.parametrize("has_model", [True, False])
def test_a_supervisor_that_prepares_its_ticks_finds_the_same(has_model):
    found = []
    for is_prepared in (True, False):
        car = turning(checks=(), has_model=has_model)
        for _ in range(30):
            car.tick()
            if is_prepared:
                car.supervisor.prepare(car.control)
        car.disturb = nothing
        car.tick()
        found.append(car.qualified)
    assert found[0] == found[1]


def test_the_predictions_of_the_next_tick_are_prepared():
    car = driven(5)
    calls = []
    car.supervisor._prediction.prepare = lambda *expected: calls.append(expected)
    car.supervisor.prepare(car.control)
    assert calls == [(car.control, car.curvature_per_m)]


@pytest.mark.parametrize("is_drift", [True, False])
def test_the_path_moves_with_an_estimate_only_when_a_drift_was_found(is_drift):
    """The car has been steered beside its path: it returns as to a path that moved sideways."""
    car = driven(5, checks=only(Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M))
    car.disturb = growing("ey_m", 0.0075) if is_drift else shifted(ey_m=1.0)
    while car.tick().is_measured:
        assert len(car.qualified) < 120
    before, now = car.qualified[-2:]
    assert (now.alarm is not StopCause.NONE) is is_drift
    found_m = now.path.c0_m - before.path.c0_m
    jump_m = now.state.ey_m - before.state.ey_m
    assert found_m == pytest.approx(jump_m, abs=0.01)
    assert (abs(jump_m) > 0.2) is is_drift


def test_a_lost_state_is_estimated_along_the_last_path():
    car = turning(path=STRAIGHT)
    car.tick(20)
    car.disturb, car.is_stopping = nothing, True
    qualified = car.tick(40)
    assert qualified.speed_mps is None
    assert not qualified.is_measured
    assert not qualified.is_path_received
    assert qualified.state.ey_m == pytest.approx(car.state.ey_m, abs=0.05)
    assert qualified.state.epsi_rad == pytest.approx(car.state.epsi_rad, abs=0.005)
    assert qualified.path is not None


def test_a_braking_car_without_states_comes_to_rest():
    car = driven(5, has_model=False)
    car.disturb, car.is_stopping = nothing, True
    car.control = car.control._replace(brake_n=75.0)
    assert car.tick(300).state.vx_mps == 0.0


def test_faulty_signals_of_a_safe_stop_last_until_standby():
    car = driven(20)
    car.disturb, car.is_stopping = shifted(ey_m=2.0), True
    car.tick(3)
    car.disturb = shifted(ey_m=0.1)
    assert not car.tick(5).is_measured
    car.is_driven = False
    assert car.tick().is_measured


def test_a_stop_without_speed_and_progress_has_no_known_speed():
    car = driven(20)
    car.is_stopping = True
    car.disturb = replaced(vx_mps=0.0)
    assert car.tick(3).speed_mps == pytest.approx(20.0, abs=0.2)
    car.disturb = replaced(vx_mps=0.0, ds_m=0.3)
    car.tick(20)
    qualified = car.tick()
    assert qualified.speed_mps is None or qualified.speed_mps > 10.0


def test_a_command_that_is_not_known_ends_the_predictions():
    car = driven(20)
    car.disturb = lambda received: replace(received, applied=None)
    assert car.tick(5).is_measured
