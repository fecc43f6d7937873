"""The choice of the law: stops and starts by the reference, speeds with hysteresis, no chatter."""

from itertools import pairwise
from math import inf, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.contract.signals import Mode, PathReference
from rt_controller.control.low_speed import (
    ARRIVE,
    AT_REST_MPS,
    STAY,
    SpeedRange,
    next_law,
    stop_distance_m,
    wants_rest,
)

SPEEDS = SpeedRange(leave_mps=3.0, resume_mps=4.0)
REST = PathReference(0.0, 0.0, 0.0, 0.0, v_mps=0.0, a_mps2=0.0)
CRUISE = REST._replace(v_mps=15.0)
LAWS = [Mode.NOMINAL, Mode.LOW_SPEED, Mode.STANDSTILL]
seeds = st.integers(0, 2**31)


def stop_in(distance_m: float, braking_mps2: float = 2.0) -> PathReference:
    return REST._replace(v_mps=sqrt(2.0 * braking_mps2 * distance_m), a_mps2=-braking_mps2)


@pytest.mark.parametrize("braking_mps2", [0.5, 1.5, 4.0])
@pytest.mark.parametrize("distance_m", [0.0, 0.1, 3.0, 50.0])
def test_speed_and_deceleration_carry_the_distance_to_the_stop(
    distance_m: float, braking_mps2: float
) -> None:
    assert stop_distance_m(stop_in(distance_m, braking_mps2)) == pytest.approx(distance_m)
    assert stop_distance_m(CRUISE) == inf


def test_a_start_is_wanted_as_soon_as_the_reference_accelerates() -> None:
    assert wants_rest(REST, is_resting=True)
    assert not wants_rest(REST._replace(a_mps2=1.5), is_resting=True)
    assert not wants_rest(REST._replace(v_mps=0.3), is_resting=True)


def test_a_car_that_stands_just_before_its_stop_has_arrived_and_stays() -> None:
    assert next_law(Mode.LOW_SPEED, 0.05, stop_in(0.9 * ARRIVE.stop_m), SPEEDS) is Mode.STANDSTILL
    assert next_law(Mode.STANDSTILL, 0.0, stop_in(0.9 * STAY.stop_m), SPEEDS) is Mode.STANDSTILL


def test_a_car_that_stands_far_before_its_stop_drives_on() -> None:
    assert next_law(Mode.LOW_SPEED, 0.0, stop_in(1.0), SPEEDS) is Mode.LOW_SPEED
    assert next_law(Mode.STANDSTILL, 0.0, stop_in(1.0), SPEEDS) is Mode.LOW_SPEED


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("vx_mps", [-0.2, -3.0])
def test_a_car_that_rolls_back_is_braked_unless_it_is_to_start(law: Mode, vx_mps: float) -> None:
    assert next_law(law, vx_mps, REST, SPEEDS) is Mode.STANDSTILL
    assert next_law(law, vx_mps, REST._replace(v_mps=0.5, a_mps2=1.0), SPEEDS) is Mode.LOW_SPEED


@pytest.mark.parametrize("law", LAWS)
def test_a_fast_car_is_driven_by_the_model_whatever_the_reference(law: Mode) -> None:
    for path in (REST, CRUISE, stop_in(1.0)):
        assert next_law(law, 20.0, path, SPEEDS) is Mode.NOMINAL


def test_the_model_drives_again_only_well_above_the_speed_at_which_it_stopped() -> None:
    assert next_law(Mode.NOMINAL, 2.99, CRUISE, SPEEDS) is Mode.LOW_SPEED
    assert next_law(Mode.LOW_SPEED, 3.99, CRUISE, SPEEDS) is Mode.LOW_SPEED
    assert next_law(Mode.LOW_SPEED, 4.0, CRUISE, SPEEDS) is Mode.NOMINAL
    assert next_law(Mode.NOMINAL, 3.01, CRUISE, SPEEDS) is Mode.NOMINAL


def test_a_held_car_that_rolls_forwards_is_braked_up_to_the_speed_of_the_model() -> None:
    assert next_law(Mode.STANDSTILL, 3.9, REST, SPEEDS) is Mode.STANDSTILL
    assert next_law(Mode.STANDSTILL, 4.0, REST, SPEEDS) is Mode.NOMINAL
    assert next_law(Mode.STANDSTILL, 2.0, CRUISE, SPEEDS) is Mode.LOW_SPEED


@given(
    st.floats(-1.0, 1.0), st.floats(0.0, 0.5), st.floats(-1.0, 1.0), st.sampled_from(LAWS), seeds
)
def test_noise_across_the_limits_of_rest_changes_the_law_twice_at_most(
    speed_mps: float, reference_mps: float, reference_mps2: float, law: Mode, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    laws = [law]
    for _ in range(200):
        v_mps = max(reference_mps + 0.02 * rng.uniform(-1.0, 1.0), 0.0)
        a_mps2 = reference_mps2 + 0.03 * rng.uniform(-1.0, 1.0)
        path = REST._replace(v_mps=v_mps, a_mps2=a_mps2)
        laws.append(next_law(laws[-1], speed_mps, path, SPEEDS))
    assert sum(a is not b for a, b in pairwise(laws)) <= 2


@given(st.floats(-1.0, 8.0), st.floats(0.0, 8.0), seeds)
def test_noise_of_speed_and_reference_changes_the_law_twice_at_most(
    speed_mps: float, reference_mps: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    law, changes = Mode.NOMINAL, 0
    for _ in range(200):
        path = REST._replace(
            v_mps=max(reference_mps + 0.4 * AT_REST_MPS * rng.uniform(-1.0, 1.0), 0.0),
            a_mps2=0.09 * rng.uniform(-1.0, 1.0),
        )
        following = next_law(law, speed_mps + 0.15 * rng.uniform(-1.0, 1.0), path, SPEEDS)
        changes += following is not law
        law = following
    assert changes <= 2
