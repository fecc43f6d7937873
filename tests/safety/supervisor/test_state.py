"""Signals that contradict each other, the model, the commands or a takeover."""

from dataclasses import replace

import pytest
from kinematic_car import (
    STRAIGHT,
    TURNING_RAD,
    WITHOUT_FROZEN,
    WatchedCar,
    driven,
    growing,
    replaced,
    shifted,
    turning,
    undisturbed,
)

from rt_controller.contract.faults import StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.safety.checks import CHECKS
from rt_controller.safety.stop import ALONG_PATH, LOST


def test_a_car_whose_states_fit_together_is_accepted():
    car = turning()
    car.tick(100)
    assert all(qualified.is_measured for qualified in car.qualified)
    assert {qualified.alarm for qualified in car.qualified} == {StopCause.NONE}
    assert {qualified.rejection for qualified in car.qualified} == {StopCause.NONE}
    assert car.qualified[-1].state == car.state


@pytest.mark.parametrize(
    ("disturb", "cause"),
    [
        (replaced(vx_mps=0.0), StopCause.SPEED_IMPLAUSIBLE),
        (replaced(ds_m=0.0), StopCause.PROGRESS_IMPLAUSIBLE),
        (shifted(vy_mps=1.0), StopCause.LATERAL_SPEED_IMPLAUSIBLE),
        (shifted(yaw_rate_radps=0.3), StopCause.YAW_RATE_IMPLAUSIBLE),
        (shifted(epsi_rad=0.1), StopCause.HEADING_IMPLAUSIBLE),
        (shifted(ey_m=1.0), StopCause.LATERAL_ERROR_IMPLAUSIBLE),
    ],
)
def test_a_signal_that_jumps_is_rejected_at_once_named_and_forgotten(disturb, cause):
    car = driven(20)
    car.disturb = disturb
    qualified = car.tick()
    assert (qualified.rejection, qualified.is_measured) == (cause, False)
    assert qualified.state.vx_mps == pytest.approx(20.0, abs=0.1)
    assert qualified.state.ey_m == pytest.approx(0.0, abs=0.05)
    car.disturb = undisturbed
    assert car.tick().is_measured


def mirrored(received):
    """The whole lateral motion with the other sign."""
    names = ("vy_mps", "yaw_rate_radps", "ey_m", "epsi_rad")
    other = {name: -getattr(received.state, name) for name in names}
    return replace(received, state=received.state._replace(**other))


def test_several_signals_that_jump_together_are_all_replaced_until_the_car_stands():
    """In the second tick the jump is no longer new: it stays one while it is there."""
    car = turning(epsi_rad=0.05, ey_m=1.0)
    car.tick(20)
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


def test_a_signal_that_is_rejected_again_and_again_stops_the_car():
    car = driven(20)
    wrong = shifted(ey_m=1.0)
    alarms = []
    for k in range(16):
        car.disturb = wrong if k % 2 else undisturbed
        alarms.append(car.tick().alarm)
    assert StopCause.LATERAL_ERROR_IMPLAUSIBLE in alarms


def test_a_yaw_rate_of_the_wrong_sign_is_replaced_by_that_of_the_model():
    car = driven(20)
    car.disturb = lambda received: replace(
        received, state=received.state._replace(yaw_rate_radps=-received.state.yaw_rate_radps)
    )
    car.control = car.control._replace(steer_rad=TURNING_RAD)
    qualified = car.tick(2)
    assert qualified.rejection is StopCause.YAW_RATE_IMPLAUSIBLE
    assert qualified.state.yaw_rate_radps == pytest.approx(car.state.yaw_rate_radps)


WITHOUT_MODEL = {"has_model": False, "checks": WITHOUT_FROZEN}


@pytest.mark.parametrize(
    ("car", "disturb", "ticks", "cause"),
    [
        (WITHOUT_MODEL, shifted(yaw_rate_radps=0.03), 40, StopCause.YAW_RATE_IMPLAUSIBLE),
        ({"vx_mps": 30.0}, growing("epsi_rad", 0.0008), 60, StopCause.HEADING_IMPLAUSIBLE),
        ({}, shifted(ds_m=0.018), 60, StopCause.PROGRESS_IMPLAUSIBLE),
        ({}, growing("ey_m", 0.3 / 40), 120, StopCause.LATERAL_ERROR_IMPLAUSIBLE),
    ],
    ids=["yaw rate, by the heading", "heading, by the lateral error", "progress", "lateral error"],
)
def test_a_drift_below_the_threshold_of_a_jump_stops_the_car(car, disturb, ticks, cause):
    watched = driven(20, **car)
    watched.disturb = disturb
    alarms = [watched.tick().alarm for _ in range(ticks)]
    assert alarms[0] is StopCause.NONE
    assert next(alarm for alarm in alarms if alarm is not StopCause.NONE) is cause


def test_a_car_that_does_not_turn_as_the_model_says_is_stopped_with_its_measured_state():
    car = driven(20)
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


@pytest.mark.parametrize("car", [{}, {"vx_mps": 0.0, "epsi_rad": 0.1}], ids=["steady", "standing"])
def test_a_car_whose_state_does_not_change_may_repeat_it(car):
    watched = driven(5, **car)
    frozen(watched)
    assert {watched.tick().alarm for _ in range(200)} == {StopCause.NONE}


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
    car = driven(1)
    car.disturb = shifted(ey_m=1.0, epsi_rad=0.1, yaw_rate_radps=0.2)
    qualified = car.tick()
    assert not qualified.is_measured
    assert qualified.rejection is not StopCause.NONE


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


@pytest.mark.parametrize(
    ("car", "is_refused"),
    [
        ({"ey_m": -2.0, "epsi_rad": -0.3}, True),
        ({"ey_m": 0.8, "epsi_rad": 0.1}, True),
        ({"ey_m": 0.8, "epsi_rad": -0.1}, False),
        ({"vx_mps": 16.7, "epsi_rad": 0.1}, False),
        ({"vx_mps": 33.3, "epsi_rad": 0.1}, True),
        ({"vx_mps": 33.0, "path": STRAIGHT._replace(c2_per_m=0.005)}, True),
    ],
)
def test_only_a_car_inside_of_the_engagement_window_is_taken_over(car, is_refused):
    qualified = WatchedCar(**car).tick()
    assert (qualified.rejection is StopCause.NOT_ENGAGED) is is_refused
    assert qualified.is_measured is not is_refused


@pytest.mark.parametrize(
    ("epsi_rad", "vy_mps", "is_refused"),
    [(-0.19, 0.5, False), (0.19, -0.5, False), (-0.12, -0.5, True), (0.12, 0.5, True)],
)
def test_the_course_of_a_car_in_a_bend_counts_and_not_its_heading(epsi_rad, vy_mps, is_refused):
    """The course is heading plus side slip, here 0.05 rad; 0.15 rad from the path are accepted."""
    car = WatchedCar(vx_mps=10.0, epsi_rad=epsi_rad, disturb=replaced(vy_mps=vy_mps))
    assert (car.tick().rejection is StopCause.NOT_ENGAGED) is is_refused


@pytest.mark.parametrize(
    ("signals", "braking"),
    [({}, ALONG_PATH), ({"state": None}, LOST), ({"path": None}, LOST)],
)
def test_a_stop_brakes_hard_if_state_or_path_is_lost(signals, braking):
    car = driven(5)
    car.disturb = lambda received: replace(received, **signals)
    estimate = car.tick()
    assert car.supervisor.braking(estimate, 0.0, False, 1.0) == braking
    beside = car.supervisor.braking(estimate, 1.5, False, 1.0)  # a turn takes its share of the grip
    assert beside.most_n < braking.most_n


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("away_mps", "is_refused"), [(-1.0, False), (1.0, True)])
def test_a_car_that_slides_away_from_the_path_is_refused(side, away_mps, is_refused):
    car = WatchedCar(ey_m=0.9 * side, disturb=replaced(vy_mps=away_mps * side))
    assert (car.tick().rejection is StopCause.NOT_ENGAGED) == is_refused
