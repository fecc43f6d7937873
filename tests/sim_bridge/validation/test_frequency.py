"""Frequency responses: of a car that is changed, and the evaluation of the curves."""

from math import isnan

import numpy as np
import pytest

from sim_bridge.plant.parameters import Parameters, default_car
from sim_bridge.validation import frequency
from sim_bridge.validation.signal_metrics import FrequencyResponse

CAR = default_car()
SPEED_MPS, STEER_RAD = frequency.SLOW_MPS, frequency.SLOW_STEER_RAD
HZ = np.array((1.0, 1.8))


def responses(car: Parameters) -> frequency.Responses:
    return frequency.sweep(car, SPEED_MPS, STEER_RAD, HZ)


@pytest.fixture(scope="module")
def shipped() -> frequency.Responses:
    return responses(CAR)


def changed_suspension(**factors: float) -> Parameters:
    old = CAR.suspension._asdict()
    new = {name: factor * old[name] for name, factor in factors.items()}
    return CAR._replace(suspension=CAR.suspension._replace(**new))


def test_doubled_dampers_make_roll_smaller_and_later(shipped: frequency.Responses) -> None:
    dampers = [name for name in CAR.suspension._fields if name.startswith(("jounce", "rebound"))]
    stiff = responses(changed_suspension(**dict.fromkeys(dampers, 2.0)))
    assert np.all(stiff.roll.gain < 0.85 * shipped.roll.gain)
    assert stiff.roll.phase_deg[0] < shipped.roll.phase_deg[0] - 10.0


def test_a_larger_yaw_inertia_makes_the_yaw_rate_later(shipped: frequency.Responses) -> None:
    body = CAR.body._replace(yaw_inertia_kgm2=1.5 * CAR.body.yaw_inertia_kgm2)
    heavy = responses(CAR._replace(body=body))
    assert np.all(heavy.yaw_rate.phase_deg < shipped.yaw_rate.phase_deg - 3.0)


def test_lateral_acceleration_is_that_of_yaw_rate_and_sideslip(
    shipped: frequency.Responses,
) -> None:
    """a_y = v (r + d beta / dt) as complex amplitudes per degree of the steering wheel."""
    omega = 2.0 * np.pi * HZ
    turn = shipped.yaw_rate.gain * np.exp(1j * np.radians(shipped.yaw_rate.phase_deg))
    slip = shipped.sideslip.gain * np.exp(1j * np.radians(shipped.sideslip.phase_deg))
    expected_mps2 = SPEED_MPS * np.pi / 180.0 * (turn + 1j * omega * slip)
    lateral = shipped.lateral.gain * np.exp(1j * np.radians(shipped.lateral.phase_deg))
    np.testing.assert_allclose(lateral / 100.0 * 9.80665, expected_mps2, rtol=0.03)


def test_a_response_is_read_at_its_frequencies_only() -> None:
    response = FrequencyResponse(HZ, np.array((2.0, 3.0)), np.array((-10.0, -20.0)))
    assert frequency.at_hz(response, 1.8) == (3.0, -20.0)
    assert all(isnan(value) for value in frequency.at_hz(response, 1.4))
