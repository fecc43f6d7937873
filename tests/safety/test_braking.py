"""How hard a safe stop brakes."""

from math import radians

import pytest

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.safety.coast_model import Cornering
from rt_controller.safety.fallback import (
    ALONG_PATH,
    COUNTER_STEERING,
    FULL,
    LOST,
    Braking,
    braking_for,
    input_for,
    stand_by,
)


@pytest.mark.parametrize(
    ("cause", "is_known", "counter_steering_deg", "lateral_mps2", "braking"),
    [
        (StopCause.STATE_LOST, True, 0.0, 0.0, ALONG_PATH),
        (StopCause.NONE, True, -10.0, 1.0, ALONG_PATH),
        (StopCause.NONE, True, 10.0, -3.0, Braking(40.0, 150.0)),
        (StopCause.NONE, True, 10.1, 3.0, COUNTER_STEERING),
        (StopCause.NONE, True, -10.1, 0.0, COUNTER_STEERING),
        (StopCause.REFERENCE_LOST, False, 0.0, 0.0, LOST),
        (StopCause.REFERENCE_LOST, False, 10.1, -3.0, Braking(40.0, 300.0)),
        (StopCause.STATE_FROZEN, False, 0.0, 5.0, Braking(25.0, 300.0)),
        (StopCause.STEERING_MISMATCH, True, 40.0, 5.0, FULL),
    ],
)
def test_a_stop_is_as_short_as_its_cause_demands_and_the_grip_allows(
    cause: StopCause,
    is_known: bool,
    counter_steering_deg: float,
    lateral_mps2: float,
    braking: Braking,
) -> None:
    cornering = Cornering(radians(counter_steering_deg), lateral_mps2, lateral_mps2)
    assert braking_for(cause, is_known, cornering) == pytest.approx(braking)


def test_a_slow_car_has_a_least_force() -> None:
    found = braking_for(StopCause.NONE, True, Cornering(0.0, 4.0, 4.0, least_brake_n=60.0))
    assert found.most_n == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("open_throttle", "lateral_mps2", "most_n"),
    [(0.05, 0.0, 81.0), (0.05, 3.0, 46.0), (1.0, 0.0, 150.0)],
)
def test_a_throttle_that_stays_open_is_braked_beside_the_turn_of_the_car(
    open_throttle: float, lateral_mps2: float, most_n: float
) -> None:
    turning = Cornering(0.0, lateral_mps2, lateral_mps2)
    found = braking_for(StopCause.THROTTLE_MISMATCH, True, turning, open_throttle)
    assert found.most_n == pytest.approx(most_n)


@pytest.mark.parametrize("braking", [ALONG_PATH, LOST, FULL, COUNTER_STEERING])
def test_the_brake_is_ramped_to_the_force_of_the_stop(braking: Braking) -> None:
    first = input_for(Mode.SAFE_STOP, None, NEUTRAL_INPUT, False, braking)
    assert first.brake_n == pytest.approx(0.025 * braking.rate_n_per_s)
    pressed = NEUTRAL_INPUT._replace(brake_n=braking.most_n)
    assert input_for(Mode.SAFE_STOP, None, pressed, False, braking).brake_n == braking.most_n


def test_standby_and_plans_are_not_braked() -> None:
    assert input_for(Mode.STANDBY, None, NEUTRAL_INPUT, False) == stand_by(NEUTRAL_INPUT)
    planned = NEUTRAL_INPUT._replace(throttle=0.2)
    assert input_for(Mode.NOMINAL, planned, NEUTRAL_INPUT, False) == planned


@pytest.mark.parametrize(
    ("braking", "most_n", "rate_n_per_s"),
    [
        (ALONG_PATH, 75.0, 150.0),
        (LOST, 100.0, 300.0),
        (FULL, 150.0, 500.0),
        (COUNTER_STEERING, 20.0, 150.0),
    ],
)
def test_forces_and_rates_are_the_documented_ones(
    braking: Braking, most_n: float, rate_n_per_s: float
) -> None:
    assert braking == (most_n, rate_n_per_s)


@pytest.mark.parametrize("planned", [None, NEUTRAL_INPUT])
def test_a_held_car_is_braked_as_along_the_path(planned: ControlInput | None) -> None:
    held = braking_for(StopCause.STEERING_MISMATCH, True, Cornering(), is_held=True)
    assert input_for(Mode.SAFE_STOP, planned, NEUTRAL_INPUT, True, held).brake_n == 3.75
