"""States that were not sampled at their regular time are moved to it, if their Δs agrees."""

from dataclasses import replace

import pytest
from kinematic_car import (
    BRAKE_TO_SPEED,
    STEER_TO_YAW,
    STRAIGHT,
    WatchedCar,
    driven,
    undisturbed,
)

from rt_controller.contract.kinematics import heading_change_rad, lateral_change_m
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.freshness import SampleTime

BRAKED = ControlInput(0.0, 20.0, 0.0)


def moving(**arguments: object) -> WatchedCar:
    """A car that turns against its road, and moves across it with a lateral speed of its own."""
    car = WatchedCar(curvature_per_m=0.002, epsi_rad=0.02, **arguments)
    car.state = car.state._replace(vy_mps=0.1)
    car.tick(20)
    return car


def sampled(late_s, longer_s, is_stamped=True, is_late=True):
    """A state that was sampled so much late, after an interval that was so much longer."""

    def change(received):
        state, share = received.state, late_s / PERIOD_S
        if is_late:
            turned = heading_change_rad(state, state, received.curvature_per_m, state.ds_m)
            state = state._replace(
                vx_mps=state.vx_mps + share * BRAKE_TO_SPEED * received.applied.brake_n,
                ds_m=state.ds_m + state.vx_mps * (longer_s or 0.0),
                ey_m=state.ey_m + share * lateral_change_m(state, state),
                epsi_rad=state.epsi_rad + share * turned,
            )
        time = SampleTime(late_s, longer_s) if is_stamped else SampleTime()
        return replace(received, state=state, sample_time=time)

    return change


def accepted(car, disturb):
    """The accepted state of the next tick, less the one at the regular time."""
    car.disturb = disturb
    found = car.tick().state
    car.disturb = undisturbed
    return [a - b for a, b in zip(found, car.state, strict=True)]


@pytest.mark.parametrize("late_s", [0.004, -0.004])
@pytest.mark.parametrize("control", [ControlInput(0.0, 0.0, 0.0), BRAKED])
def test_a_state_is_moved_to_its_regular_time(late_s, control):
    car = moving(control=control)
    as_received = sampled(late_s, late_s)
    assert accepted(car, as_received) == pytest.approx([0.0] * 6, abs=2e-4)
    assert car.tick().is_measured


def test_the_yaw_rate_is_moved_along_its_predicted_change():
    car = moving()
    car.control = ControlInput(0.0, 0.0, 0.04)
    car.tick(3)
    car.control = ControlInput(0.0, 0.0, 0.1)
    share = 0.004 / PERIOD_S
    difference = accepted(car, sampled(0.004, 0.004))
    # The car of this test turns at once with its wheel: the state has no later yaw rate.
    assert difference[2] == pytest.approx(-share * STEER_TO_YAW * 0.06, rel=1e-6)


def test_without_a_model_the_velocities_stay_as_they_are():
    car = moving(has_model=False, control=BRAKED)
    change_mps = 0.004 / PERIOD_S * BRAKE_TO_SPEED * BRAKED.brake_n
    assert accepted(car, sampled(0.004, 0.004))[0] == pytest.approx(change_mps)


@pytest.mark.parametrize("late_s", [0.004, -0.004])
def test_a_stamp_that_contradicts_the_progress_does_not_count(late_s):
    car = moving()
    assert accepted(car, sampled(late_s, late_s, is_late=False)) == pytest.approx([0.0] * 6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("jitter_s", [0.004, 0.002])
def test_after_a_lost_state_the_interval_is_that_of_the_progress_within_the_jitter(jitter_s, sign):
    """4 ms late or early, after a state of which only the size of the jitter is known."""
    car = moving()
    accepted(car, sampled(jitter_s, jitter_s))
    late = sampled(sign * 0.004, None)

    def after_a_lost_one(received):
        found = late(received)
        return replace(
            found, state=found.state._replace(ds_m=received.state.ds_m + sign * 20.0 * 0.003)
        )

    difference = accepted(car, after_a_lost_one)
    assert difference[3] == pytest.approx(0.0, abs=1e-3)
    moved = jitter_s / 0.004  # no state is moved by more than the jitter so far
    late_m = (1.0 - moved) * sign * 0.004 / PERIOD_S * lateral_change_m(car.state, car.state)
    assert difference[4] == pytest.approx(late_m, abs=3e-5)


def test_before_any_jitter_a_state_after_a_lost_one_stays_as_it_is():
    car = moving()
    assert accepted(car, sampled(0.004, None, is_late=False)) == pytest.approx([0.0] * 6)


@pytest.mark.parametrize("late_s", [0.004, -0.004])
def test_a_path_is_moved_with_its_state(late_s):
    """The received path begins at the car of the sample, which is 80 mm before or behind."""
    car = driven(20, (), path=STRAIGHT._replace(c1=0.05), epsi_rad=0.05)
    on_time = car.tick().path
    car.disturb = sampled(late_s, late_s)
    assert car.tick().path.c0_m - on_time.c0_m == pytest.approx(-0.05 * 20.0 * late_s, rel=0.02)
