"""Heave, roll and pitch: decrements of known swings, and a car with other dampers."""

from math import isnan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_bridge.plant.parameters import default_car
from sim_bridge.validation import ride

CAR = default_car()


@given(
    ratio=st.floats(0.02, 0.6),
    natural_hz=st.floats(0.7, 2.5),
    start=st.floats(-50.0, 50.0).filter(lambda x: abs(x) > 1.0),
)
def test_ratio_and_frequency_of_a_linear_swing_are_found(
    ratio: float, natural_hz: float, start: float
) -> None:
    time_s = np.arange(0.0, 6.0, 0.002)
    omega = 2.0 * np.pi * natural_hz
    damped = omega * np.sqrt(1.0 - ratio**2)
    wave = np.cos(damped * time_s) + ratio * omega / damped * np.sin(damped * time_s)
    swing = ride.Swing(time_s, start * np.exp(-ratio * omega * time_s) * wave)
    found, found_hz = ride.damping(swing)
    assert found == pytest.approx(ratio, abs=0.005)
    assert found_hz == pytest.approx(natural_hz, rel=0.01)
    assert ride.half_swing_damping(swing) == pytest.approx(ratio, abs=0.005)


def test_a_body_that_does_not_swing_has_no_damping_ratio() -> None:
    time_s = np.arange(0.0, 3.0, 0.002)
    swing = ride.Swing(time_s, 50.0 * np.exp(-3.0 * time_s))
    assert all(isnan(value) for value in ride.damping(swing))
    assert isnan(ride.half_swing_damping(swing))


def test_doubled_dampers_leave_the_range_of_road_cars() -> None:
    old = CAR.suspension._asdict()
    doubled = {k: 2.0 * v for k, v in old.items() if k.startswith(("jounce", "rebound"))}
    stiff = CAR._replace(suspension=CAR.suspension._replace(**doubled))
    shipped = ride.half_swing_damping(ride.released_heave(CAR, ride.HEAVE_M))
    changed = ride.half_swing_damping(ride.released_heave(stiff, ride.HEAVE_M))
    assert 0.2 < shipped < 0.4
    assert not 0.2 < changed < 0.4


def test_stiffer_springs_raise_the_frequency_of_heave() -> None:
    springs = CAR.suspension._replace(
        spring_front_npm=1.5 * CAR.suspension.spring_front_npm,
        spring_rear_npm=1.5 * CAR.suspension.spring_rear_npm,
    )
    _, shipped_hz = ride.damping(ride.released_heave(CAR, ride.SMALL_HEAVE_M))
    stiff = CAR._replace(suspension=springs)
    _, stiff_hz = ride.damping(ride.released_heave(stiff, ride.SMALL_HEAVE_M))
    assert stiff_hz == pytest.approx(1.2 * shipped_hz, rel=0.06)
