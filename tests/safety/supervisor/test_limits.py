"""The supervisor at its limits: which tick, which of several findings, which window."""

from dataclasses import replace

import numpy as np
import pytest
from kinematic_car import (
    STRAIGHT,
    WatchedCar,
    driven,
    growing,
    nothing,
    only,
    replaced,
    shifted,
    undisturbed,
)

from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.faults import NO_FAULT, Fault, StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.model.validity import TrainedRange, Validity
from rt_controller.safety import supervisor
from rt_controller.safety.checks import CHECKS, Reaction, checks_of
from rt_controller.safety.tick import Estimate

JUMPED = STRAIGHT._replace(c0_m=0.6)


def rejections(car, ticks):
    """Alarms of so many ticks in which the path jumps."""
    car.path = JUMPED
    alarms = [car.tick().alarm for _ in range(ticks)]
    assert {qualified.rejection for qualified in car.qualified[-ticks:]} == {StopCause.PATH_JUMP}
    car.path = STRAIGHT
    return alarms


@pytest.mark.parametrize(
    ("before", "good_ticks", "allowed"),
    # without earlier rejections the fifth one in a row stops the car; each fades in ten good ticks
    [(0, 5, 4), (0, 100, 4), (4, 0, 0), (4, 5, 0), (4, 7, 1), (4, 14, 1), (4, 16, 2), (4, 60, 4)],
)
def test_more_than_four_recent_rejections_stop_the_car(before, good_ticks, allowed):
    car = driven(5, only(Quantity.PATH_STEP_M))
    if before:
        rejections(car, before)
    if good_ticks:
        car.tick(good_ticks)
    expected = [StopCause.NONE] * allowed + [StopCause.PATH_JUMP]
    assert rejections(car, allowed + 1) == expected


def test_a_sum_of_exactly_four_rejections_does_not_stop_the_car():
    car = driven(5, only(Quantity.PATH_STEP_M))
    rejections(car, 1)
    car.tick(6)
    assert rejections(car, 4) == [StopCause.NONE] * 4
    assert car.supervisor._rejections == 4.0


def test_a_new_drive_clears_rejections_and_windows():
    car = WatchedCar(checks=only(Quantity.PATH_STEP_M, Quantity.TRACKING_M))
    for _ in range(3):
        car.is_driven = False
        car.tick(2)
        assert set(rejections(car, 4)) == {StopCause.NONE}
        car.is_driven = False
        car.path = STRAIGHT._replace(c0_m=1.2)
        assert car.tick(8).alarm is StopCause.NONE
        assert car.tick().alarm is StopCause.TRACKING_LOST


@pytest.mark.parametrize(
    ("of_state", "of_path", "alarm", "rejection"),
    [
        (Reaction.STOP, Reaction.STOP, StopCause.PROGRESS_IMPLAUSIBLE, StopCause.PATH_JUMP),
        (Reaction.REJECT_STATE, None, StopCause.NONE, StopCause.PROGRESS_IMPLAUSIBLE),
        (Reaction.REJECT_STATE, Reaction.STOP, StopCause.PATH_JUMP, StopCause.PROGRESS_IMPLAUSIBLE),
    ],
)
def test_alarm_and_rejection_name_the_state_before_the_path(of_state, of_path, alarm, rejection):
    state, path = only(Quantity.PROGRESS_STEP_M, Quantity.PATH_STEP_M)
    path = path if of_path is None else path._replace(reaction=of_path)
    car = driven(5, [state._replace(reaction=of_state), path])
    car.path, car.disturb = JUMPED, shifted(ds_m=0.1)
    qualified = car.tick()
    assert (qualified.alarm, qualified.rejection) == (alarm, rejection)


@pytest.mark.parametrize("is_stopping", [False, True])
def test_a_rejected_signal_is_faulty_for_good_only_in_a_stop(is_stopping):
    car = driven(5, checks=only(Quantity.PROGRESS_STEP_M))
    car.disturb, car.is_stopping = shifted(ds_m=0.1), is_stopping
    assert not car.tick().is_measured
    car.disturb = undisturbed
    assert car.tick().is_measured is not is_stopping


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("share", "is_refused"), [(0.99, False), (1.01, True)])
def test_the_engagement_window_lies_around_the_path(side, share, is_refused):
    path = STRAIGHT._replace(c0_m=3.0, c1=0.2)
    heading_rad = 0.19739555984988078  # atan(0.2)
    for vx_mps, ey_m, epsi_rad in (
        (20.0, 3.0 + side * share, heading_rad),
        (5.0, 3.0, heading_rad + side * share * 0.15),
    ):
        qualified = WatchedCar(vx_mps=vx_mps, ey_m=ey_m, epsi_rad=epsi_rad, path=path).tick()
        assert (qualified.rejection is StopCause.NOT_ENGAGED) is is_refused
        assert qualified.is_measured is not is_refused
        assert qualified.is_path_received
        assert qualified.speed_mps == vx_mps


def test_nothing_is_known_without_any_state():
    car = WatchedCar()
    car.disturb = lambda received: replace(received, state=None)
    assert car.tick() == Estimate(None, 0.0, STRAIGHT, None, False, True, None)
    assert car.tick(2).state is None  # nor in a drive


def test_a_path_that_arrived_in_standby_is_the_last_known_one():
    car = driven(1)
    car.disturb = nothing
    assert car.tick().path == STRAIGHT


@pytest.mark.parametrize(("vx_mps", "is_compared"), [(7.0, True), (7.01, False)])
def test_up_to_7_m_per_s_the_speed_is_compared_with_the_pedals(vx_mps, is_compared):
    car = WatchedCar(checks=(), vx_mps=vx_mps)
    car.control = car.control._replace(throttle=0.8)
    car.tick(12)
    assert (car.supervisor.values[Quantity.PEDAL_SPEED_MPS] > 0.0) is is_compared


def test_a_state_that_is_frozen_in_a_turn_stops_the_car_in_the_eighth_tick():
    car = WatchedCar(checks=only(Quantity.FROZEN_TICKS))
    car.control = car.control._replace(steer_rad=0.2)
    car.tick(20)
    kept = car.state
    car.disturb = lambda received: replace(received, state=kept)
    alarms = [car.tick().alarm for _ in range(8)]
    assert alarms == [StopCause.NONE] * 7 + [StopCause.STATE_FROZEN]
    car.tick(12)
    assert car.qualified[-1].speed_mps is None


@pytest.mark.parametrize("follow_commands", [True, False])
def test_only_actuators_that_follow_their_commands_show_that_a_state_is_frozen(follow_commands):
    car = WatchedCar(checks=only(Quantity.FROZEN_TICKS))
    car.feedback = car.control
    car.tick(5)
    car.feedback = car.control._replace(throttle=0.2)
    if follow_commands:
        car.control = car.feedback
    assert (car.tick(8).alarm is StopCause.STATE_FROZEN) is follow_commands


@pytest.mark.parametrize(("brake_mps2_per_n", "brake_n"), [(0.1, 5.0), (0.05, 10.0), (0.04, 10.0)])
def test_a_stronger_brake_may_differ_by_less_and_a_weaker_one_by_no_more(brake_mps2_per_n, brake_n):
    checks = checks_of(replace(DEFAULT_CAR, brake_mps2_per_n=brake_mps2_per_n))
    (found,) = (each.threshold for each in checks if each.quantity is Quantity.BRAKE_N)
    assert found == pytest.approx(brake_n)
    assert checks_of(DEFAULT_CAR) == CHECKS


def test_each_quantity_is_judged_once_in_a_tick():
    driven = [i for group in supervisor._GROUPS[:4] for i in group]
    assert driven == list(range(Quantity.ENGAGE_EY_M))
    at_start = [*Quantity][Quantity.PATH_LATERAL_MPS2 :]
    assert list(supervisor._OF_ENGAGEMENT) == at_start


@pytest.mark.parametrize("signal", ["ey_m", "epsi_rad"])
def test_a_place_that_drifts_stops_the_car_in_the_tick_in_which_it_is_found(signal):
    car = driven(5, checks=only(Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M))
    car.disturb = growing(signal, 0.0075 if signal == "ey_m" else 0.0008)
    qualified = [car.tick() for _ in range(120)]
    assert next(each for each in qualified if not each.is_measured).alarm is not StopCause.NONE


def test_an_old_state_stops_the_car_in_the_tick_in_which_it_is_found():
    car = driven(5, checks=only(Quantity.YAW_RATE_STEP_RADPS))
    seen_states = []
    for k in range(4):
        car.control = car.control._replace(steer_rad=0.6 + 0.1 * k)
        car.tick()
        seen_states.append(car.state)
    car.control = car.control._replace(steer_rad=0.0)
    old = iter(seen_states[:2])
    car.disturb = lambda received: replace(received, state=next(old))
    car.tick()
    assert car.tick().alarm is StopCause.STATE_OLD


@pytest.mark.parametrize(("vx_mps", "is_far"), [(22.1, True), (22.0, False), (17.9, True)])
def test_a_speed_far_from_the_wanted_one_for_three_seconds_is_reported_and_stops_nothing(
    vx_mps, is_far
):
    def without_path(received):
        return replace(replaced(vx_mps=vx_mps)(received), path=None)

    reported = Fault.SPEED_NOT_FOLLOWED if is_far else NO_FAULT
    car = driven(5, only(Quantity.SPEED_MPS), disturb=replaced(vx_mps=20.0))
    for _ in range(2):  # it counts anew after a tick at the wanted speed
        car.disturb = replaced(vx_mps=vx_mps)
        assert {car.tick().report for _ in range(119)} == {NO_FAULT}
        car.disturb = without_path  # one that is lost is known still
        estimate = car.tick()
        assert (estimate.report, estimate.alarm) == (reported, StopCause.NONE)
        car.disturb = replaced(vx_mps=20.0)
        assert car.tick().report == NO_FAULT
    car.disturb, car.is_stopping = replaced(vx_mps=vx_mps), True
    assert {car.tick().report for _ in range(125)} == {NO_FAULT}


NARROW = Validity(
    speed_mps=np.array([10.0, 30.0]),
    lateral_mps2=np.array([2.0, 6.0]),
    steer_rad=np.array([1.0, 0.6]),
    curvature_per_m=np.array([0.02, 0.01]),
    conditions=np.zeros((0, 2)),
)


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        ((20.0, -3.9, 0.7, 0.014), None),
        ((10.0, 2.0, -1.0, -0.02), None),
        ((20.0, -4.4, 0.7, 0.0), "lateral acceleration 4.4 of 4 m/s²"),
        ((20.0, 4.4, -1.2, 0.0), "steering wheel 69 of 46 deg"),
        ((25.0, 0.0, 0.0, -0.02), "curvature 0.02 of 0.013 1/m"),
        ((33.0, 6.1, 0.0, 0.0), "speed 119 of 108 km/h"),
        ((9.0, 0.0, 0.0, 0.0), "speed 32 below 36 km/h"),
        ((35.0, 12.0, 0.0, 0.0), "lateral acceleration 12 of 6 m/s²"),
    ],
)
def test_what_is_furthest_outside_of_the_training_is_found(motion, expected):
    found = TrainedRange(NARROW, is_path_exact=False).excess(*motion)
    assert (found and found.text) == expected
    if "curvature" in str(expected):
        assert TrainedRange(NARROW, is_path_exact=True).excess(*motion) is None


def test_a_motion_outside_of_the_training_is_reported_after_100_ms_and_stops_nothing():
    known = {"trained": TrainedRange(NARROW, is_path_exact=False), "vx_mps": 31.0}
    fast = STRAIGHT._replace(v_mps=31.0)
    car = WatchedCar(path=fast, **known)
    car.tick(4)
    assert {(each.report, each.excess) for each in car.qualified} == {(NO_FAULT, None)}
    estimate = car.tick()
    assert (estimate.report, estimate.alarm) == (Fault.OUTSIDE_TRAINING, StopCause.NONE)
    assert estimate.excess.text == "speed 112 of 108 km/h"
    car.path = fast._replace(v_mps=34.0)
    assert car.tick(300).report == Fault.OUTSIDE_TRAINING | Fault.SPEED_NOT_FOLLOWED
    for inside in ({"trained": None}, {"vx_mps": 6.0}, {"vx_mps": 20.0}):
        car = WatchedCar(**{"path": None, **known, **inside})
        assert car.tick(10).report == NO_FAULT
