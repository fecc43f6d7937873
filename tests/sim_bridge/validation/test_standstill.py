"""Standstill, walking pace and friction ellipse: wrong cars are seen."""

import pytest

from sim_bridge.plant.parameters import Parameters, default_car
from sim_bridge.plant.shipped_cars import DEFAULT_CAR
from sim_bridge.validation import standstill
from sim_bridge.validation.acceptance import check

CAR = default_car()


def missed(car: Parameters) -> set[str]:
    _, values = standstill.measure(car)
    return {line.name for line in check(11, values, DEFAULT_CAR) if line.ok is False}


def test_the_shipped_car_passes_every_judged_line() -> None:
    assert missed(CAR) == set()


def test_a_soft_column_turns_too_little_at_walking_pace() -> None:
    soft = CAR.steering._replace(stiffness_nmprad=8000.0)
    assert "smallest yaw rate at walking pace" in missed(CAR._replace(steering=soft))


def test_an_undamped_tyre_springs_back_after_a_locked_stop() -> None:
    tyre = CAR.tyre._replace(longitudinal_damping_s=1e-4, longitudinal_relaxation_m=0.4)
    assert "speed backwards after a locked stop" in missed(CAR._replace(tyre=tyre))


def test_without_weights_the_force_is_still_within_the_ellipse_of_its_pure_forces() -> None:
    """The ellipse is a property of the force law, not of numbers of the car file."""
    tyre = CAR.tyre._replace(lateral_weight=0.0, longitudinal_weight=0.0)
    assert standstill.ellipse_share(CAR._replace(tyre=tyre)) == pytest.approx(1.0, abs=1e-6)
