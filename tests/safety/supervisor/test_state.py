"""Signals that contradict each other, the model, the commands or a takeover."""

from dataclasses import replace

import pytest
from kinematic_car import (
    STRAIGHT,
    TURNING_RAD,
    WITHOUT_FROZEN,
    WatchedCar,
    growing,
    replaced,
    shifted,
    turning,
)

from rt_controller.contract.faults import StopCause
from rt_controller.safety.checks import CHECKS, Quantity


def test_a_car_whose_states_fit_together_is_accepted():
    car = turning()
    car.tick(100)
    assert all(qualified.is_measured for qualified in car.qualified)
    assert {qualified.alarm for qualified in car.qualified} == {StopCause.NONE}
    assert {qualified.rejection for qualified in car.qualified} == {StopCause.NONE}
    assert car.qualified[-1].state == car.state


@pytest.mark.parametrize(
    ("signals", "cause"),
    [
        ({"vx_mps": 0.0}, StopCause.SPEED_IMPLAUSIBLE),
        ({"ds_m": 0.0}, StopCause.PROGRESS_IMPLAUSIBLE),
        ({"vy_mps": 1.0}, StopCause.LATERAL_SPEED_IMPLAUSIBLE),
        ({"yaw_rate_radps": 0.3}, StopCause.YAW_RATE_IMPLAUSIBLE),
        ({"epsi_rad": 0.1}, StopCause.HEADING_IMPLAUSIBLE),
        ({"ey_m": 1.0}, StopCause.LATERAL_ERROR_IMPLAUSIBLE),
    ],
)
def test_a_signal_that_jumps_is_rejected_at_once_and_named(signals, cause):
    car = WatchedCar()
    car.tick(20)
    car.disturb = (
        shifted(**signals)
        if "vx_mps" not in signals and "ds_m" not in signals
        else replaced(**signals)
    )
    qualified = car.tick()
    assert (qualified.rejection, qualified.is_measured) == (cause, False)
    assert qualified.state.vx_mps == pytest.approx(20.0, abs=0.1)
    assert qualified.state.ey_m == pytest.approx(0.0, abs=0.05)


def test_several_signals_that_jump_together_are_all_replaced_until_the_car_stands():
    """In the second tick the jump is no longer new: it stays one while it is there."""
    car = turning(epsi_rad=0.05, ey_m=1.0)
    car.tick(20)

    def mirrored(received):
        assert received.state is not None
        state = received.state
        return replace(
            received,
            state=state._replace(
                vy_mps=-state.vy_mps,
                yaw_rate_radps=-state.yaw_rate_radps,
                ey_m=-state.ey_m,
                epsi_rad=-state.epsi_rad,
            ),
        )

    car.disturb = mirrored
    for _ in range(4):
        qualified = car.tick()
        assert not qualified.is_measured
        assert qualified.state.ey_m == pytest.approx(car.state.ey_m, abs=0.1)
        assert qualified.state.epsi_rad == pytest.approx(car.state.epsi_rad, abs=0.01)


def test_a_speed_that_stays_at_zero_while_the_throttle_is_open_stops_the_car():
    car = WatchedCar(vx_mps=0.0)
    car.control = car.control._replace(throttle=0.8)
    car.disturb = replaced(vx_mps=0.0, ds_m=0.0)
    qualified = [car.tick() for _ in range(80)]
    alarms = {qualified.alarm for qualified in qualified} - {StopCause.NONE}
    assert alarms == {StopCause.SPEED_IMPLAUSIBLE}
    assert qualified[-1].speed_mps is None  # a car that seems to stand may be moving


def test_a_single_outlier_is_forgotten_in_the_next_tick():
    car = WatchedCar()
    car.tick(20)
    car.disturb = shifted(ey_m=1.0)
    car.tick()
    car.disturb = lambda received: received
    assert car.tick().is_measured


def test_a_signal_that_is_rejected_again_and_again_stops_the_car():
    car = WatchedCar()
    car.tick(20)
    wrong = shifted(ey_m=1.0)
    alarms = []
    for k in range(16):
        car.disturb = wrong if k % 2 else lambda received: received
        alarms.append(car.tick().alarm)
    assert StopCause.LATERAL_ERROR_IMPLAUSIBLE in alarms


def test_a_yaw_rate_of_the_wrong_sign_is_replaced_by_that_of_the_model():
    car = WatchedCar()
    car.tick(20)
    car.disturb = lambda received: replace(
        received,
        state=received.state
        and received.state._replace(yaw_rate_radps=-received.state.yaw_rate_radps),
    )
    car.control = car.control._replace(steer_rad=TURNING_RAD)
    qualified = car.tick(2)
    assert qualified.rejection is StopCause.YAW_RATE_IMPLAUSIBLE
    assert qualified.state.yaw_rate_radps == pytest.approx(car.state.yaw_rate_radps)


def test_a_yaw_rate_that_drifts_below_the_threshold_of_a_jump_is_found_by_the_heading():
    car = WatchedCar(has_model=False, checks=WITHOUT_FROZEN)
    car.tick(20)
    car.disturb = shifted(yaw_rate_radps=0.03)
    causes = {car.tick().alarm for _ in range(40)}
    assert causes == {StopCause.NONE, StopCause.YAW_RATE_IMPLAUSIBLE}


def test_a_heading_that_drifts_is_found_by_the_lateral_error():
    car = WatchedCar(vx_mps=30.0)
    car.tick(5)
    car.disturb = growing("epsi_rad", 0.0008)
    causes = [car.tick().alarm for _ in range(60)]
    found = [cause for cause in causes if cause is not StopCause.NONE]
    assert found[0] is StopCause.HEADING_IMPLAUSIBLE


def test_a_progress_that_is_slightly_wrong_for_long_stops_the_car():
    car = WatchedCar()
    car.tick(20)
    car.disturb = shifted(ds_m=0.018)
    causes = [car.tick().alarm for _ in range(60)]
    assert StopCause.PROGRESS_IMPLAUSIBLE in causes
    assert causes[0] is StopCause.NONE


def test_a_slow_drift_of_the_lateral_error_is_found_above_its_rate():
    car = WatchedCar()
    car.tick(20)
    car.disturb = growing("ey_m", 0.3 / 40)
    assert StopCause.LATERAL_ERROR_IMPLAUSIBLE in {car.tick().alarm for _ in range(120)}


def test_a_car_that_does_not_turn_as_the_model_says_is_stopped_with_its_measured_state():
    car = WatchedCar()
    car.tick(20)
    car.control = car.control._replace(steer_rad=0.6)
    still = car.state
    car.disturb = lambda received: replace(received, state=still._replace(ds_m=0.5))
    alarms = [car.tick().alarm for _ in range(30)]
    assert any(alarm is not StopCause.NONE for alarm in alarms)


def frozen(car):
    kept = car.state
    car.disturb = lambda received: replace(received, state=kept)


@pytest.mark.parametrize(
    ("is_stopping", "alarm"), [(False, StopCause.YAW_RATE_IMPLAUSIBLE), (True, StopCause.NONE)]
)
def test_a_car_that_slides_stops_and_has_no_further_fault_in_the_stop(is_stopping, alarm):
    """It turns less than the model predicts for its wheel; its states fit together."""
    over_ten = [check for check in CHECKS if check.quantity is Quantity.YAW_RATE_TEN_RADPS]
    car = turning(is_stopping=is_stopping, checks=over_ten)
    car.tick(20)
    car.disturb = lambda received: replace(
        received, applied=car.control._replace(steer_rad=car.control.steer_rad + 1.2)
    )
    qualified = car.tick(30)
    assert car.supervisor.values[Quantity.YAW_RATE_TEN_RADPS] > over_ten[0].threshold
    assert qualified.alarm is alarm
    assert qualified.is_measured
    assert qualified.state == car.state


def test_a_state_that_is_frozen_in_a_turn_stops_the_car():
    car = WatchedCar(checks=[c for c in CHECKS if c.quantity is Quantity.FROZEN_TICKS])
    car.control = car.control._replace(steer_rad=TURNING_RAD)
    car.tick(20)
    frozen(car)
    alarms = [car.tick().alarm for _ in range(20)]
    assert alarms[5] is StopCause.NONE
    assert StopCause.STATE_FROZEN in alarms
    assert car.qualified[-1].speed_mps is None


def test_a_steady_car_on_a_straight_road_may_repeat_its_state():
    car = WatchedCar()
    car.tick(5)
    frozen(car)
    assert {car.tick().alarm for _ in range(200)} == {StopCause.NONE}


def test_a_standing_car_may_repeat_its_state():
    car = WatchedCar(vx_mps=0.0, epsi_rad=0.1)
    car.tick(5)
    frozen(car)
    assert {car.tick().alarm for _ in range(50)} == {StopCause.NONE}


def test_states_of_before_with_new_counters_are_replaced_by_an_estimate():
    car = turning()
    car.tick(20)
    seen_states = []
    for k in range(12):
        car.control = car.control._replace(steer_rad=0.6 + 0.02 * k)
        car.tick()
        seen_states.append(car.state)
    old = iter(seen_states[3:])
    car.disturb = lambda received: replace(received, state=next(old))
    qualified = [car.tick() for _ in range(6)]
    assert StopCause.STATE_OLD in [qualified.alarm for qualified in qualified]
    assert not qualified[-1].is_measured


def test_a_jump_in_the_second_tick_is_found_without_earlier_states():
    car = WatchedCar()
    car.tick()
    car.disturb = shifted(ey_m=1.0, epsi_rad=0.1, yaw_rate_radps=0.2)
    qualified = car.tick()
    assert not qualified.is_measured
    assert qualified.rejection is not StopCause.NONE


def test_with_no_checks_everything_is_accepted():
    car = WatchedCar(checks=())
    car.tick(5)
    car.disturb = replaced(vx_mps=0.0, ey_m=20.0)
    qualified = car.tick(5)
    assert qualified.is_measured
    assert qualified.state.ey_m == 20.0


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"steer_rad": 0.3}, StopCause.STEERING_MISMATCH),
        ({"throttle": 0.5}, StopCause.THROTTLE_MISMATCH),
        ({"brake_n": 40.0}, StopCause.BRAKE_MISMATCH),
    ],
)
def test_an_actuator_that_does_not_follow_its_commands_stops_the_car(change, cause):
    car = WatchedCar()
    car.feedback = car.control
    assert car.tick(20).alarm is StopCause.NONE
    car.feedback = car.control._replace(**change)
    assert [car.tick().alarm for _ in range(8)][-1] is cause


def test_an_actuator_that_is_150_ms_late_is_no_fault():
    car = WatchedCar()
    commands = [car.control._replace(steer_rad=0.05 * k) for k in range(8)]
    for k in range(30):
        car.control = commands[min(k, 7)]
        car.feedback = commands[min(max(k - 6, 0), 7)]
        assert car.tick().alarm not in (StopCause.STEERING_MISMATCH,)


@pytest.mark.parametrize(("ey_m", "epsi_rad"), [(1.5, 0.0), (0.0, 0.5), (-2.0, -0.3), (0.8, 0.1)])
def test_a_car_outside_of_the_engagement_window_is_refused(ey_m, epsi_rad):
    qualified = WatchedCar(ey_m=ey_m, epsi_rad=epsi_rad).tick()
    assert (qualified.rejection, qualified.is_measured) == (StopCause.NOT_ENGAGED, False)


def test_a_path_that_is_too_sharp_is_refused_at_the_start():
    car = WatchedCar(vx_mps=33.0, path=STRAIGHT._replace(c2_per_m=0.005))
    assert car.tick().rejection is StopCause.NOT_ENGAGED


def test_a_car_inside_of_the_window_is_taken_over():
    qualified = WatchedCar(ey_m=0.8, epsi_rad=-0.1).tick()
    assert (qualified.rejection, qualified.is_measured) == (StopCause.NONE, True)


@pytest.mark.parametrize(("vx_mps", "is_refused"), [(16.7, False), (33.3, True)])
def test_a_heading_that_leads_far_from_the_path_at_this_speed_is_refused(vx_mps, is_refused):
    qualified = WatchedCar(vx_mps=vx_mps, epsi_rad=0.1).tick()
    assert (qualified.rejection is StopCause.NOT_ENGAGED) == is_refused


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("away_mps", "is_refused"), [(-1.0, False), (1.0, True)])
def test_a_car_that_slides_away_from_the_path_is_refused(side, away_mps, is_refused):
    car = WatchedCar(ey_m=0.9 * side, disturb=replaced(vy_mps=away_mps * side))
    assert (car.tick().rejection is StopCause.NOT_ENGAGED) == is_refused
