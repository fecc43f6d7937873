"""A payload against the rules for rigid bodies."""

import pytest

from sim_bridge.plant.parameters import default_car, with_payload
from sim_bridge.plant.parts import NO_PAYLOAD, Payload

CAR = default_car()

LOAD = Payload(300.0, -1.2, 0.7)


def test_without_mass_the_car_is_unchanged() -> None:
    assert with_payload(CAR, NO_PAYLOAD) is CAR


def test_axle_loads_are_those_of_both_masses() -> None:
    before, after = CAR.body, with_payload(CAR, LOAD).body
    wheelbase_m = before.front_axle_m + before.rear_axle_m
    rear_kg = before.mass_kg * before.front_axle_m / wheelbase_m
    added_kg = LOAD.mass_kg * (before.front_axle_m - LOAD.ahead_m) / wheelbase_m
    assert after.mass_kg * after.front_axle_m / wheelbase_m == pytest.approx(rear_kg + added_kg)
    assert after.front_axle_m + after.rear_axle_m == pytest.approx(wheelbase_m)
    sprung_m = after.sprung_front_axle_m + after.sprung_rear_axle_m
    assert sprung_m == pytest.approx(before.sprung_front_axle_m + before.sprung_rear_axle_m)


def test_a_load_at_the_centre_of_gravity_does_not_change_the_yaw_inertia() -> None:
    loaded = with_payload(CAR, Payload(300.0, 0.0, 0.7)).body
    assert loaded.yaw_inertia_kgm2 == pytest.approx(CAR.body.yaw_inertia_kgm2)
    assert loaded.front_axle_m == CAR.body.front_axle_m


def test_two_loads_are_one_at_their_common_place() -> None:
    """The second is given from the centre of gravity that the first has moved."""
    half = LOAD._replace(mass_kg=150.0)
    once = with_payload(CAR, half)
    moved_m = once.body.front_axle_m - CAR.body.front_axle_m
    twice = with_payload(once, half._replace(ahead_m=half.ahead_m + moved_m))
    assert twice.body == pytest.approx(with_payload(CAR, LOAD).body)
