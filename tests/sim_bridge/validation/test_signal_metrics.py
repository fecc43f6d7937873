"""The definitions behind the acceptance table, on signals with known results."""

from cmath import phase
from math import isnan, log

import numpy as np
import pytest

from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.validation.run import Run
from sim_bridge.validation.signal_metrics import (
    crossing,
    mean_deceleration,
    rear_locked_first,
    reversals,
    sine_in,
    slope,
    step_response,
)

TIME_S = np.arange(0.0, 4.0, 0.002)
LAG_S = 0.2


def test_a_crossing_lies_between_its_samples() -> None:
    assert crossing(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 5.0]), 3.0) == 1.5
    assert crossing(np.array([3.0, 4.0]), np.array([7.0, 8.0]), 5.0) == 3.0


def test_a_value_that_the_signal_does_not_contain_is_nan() -> None:
    assert isnan(crossing(TIME_S, np.sin(TIME_S), 2.0))
    assert isnan(slope(TIME_S, TIME_S, TIME_S < -1.0))
    assert isnan(step_response(TIME_S, 0.0 * TIME_S, 1.0).overshoot)


def test_a_known_understeer_slope_is_found_in_noise_and_beside_an_offset() -> None:
    rng = np.random.default_rng(1)
    lateral_g = np.linspace(0.0, 0.8, 400)
    angle_deg = 1.3 + 88.0 * lateral_g + 60.0 * np.maximum(0.0, lateral_g - 0.4) ** 2
    linear = lateral_g < 0.3
    noisy_deg = angle_deg + rng.normal(0.0, 0.05, 400)
    assert slope(lateral_g, noisy_deg, linear) == pytest.approx(88.0, abs=0.3)


def test_a_first_order_lag_reaches_90_percent_after_ln_10_time_constants() -> None:
    response = 8.0 * (1.0 - np.exp(-np.maximum(0.0, TIME_S - 0.5) / LAG_S))
    found = step_response(TIME_S, response, 0.5)
    assert found.steady == pytest.approx(8.0, rel=1e-6)
    assert found.t90_s == pytest.approx(LAG_S * log(10.0), abs=1e-4)
    assert found.overshoot < 1e-6


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_overshoot_of_an_oscillator_follows_from_its_damping(sign: float) -> None:
    """exp(-pi zeta / sqrt(1 - zeta^2)), for both signs."""
    damping, natural_radps = 0.5, 12.0
    root = np.sqrt(1.0 - damping**2)
    envelope = np.exp(-damping * natural_radps * TIME_S) / root
    response = 1.0 - envelope * np.sin(natural_radps * root * TIME_S + np.arccos(damping))
    found = step_response(TIME_S, sign * 3.0 * response, 0.0)
    assert found.overshoot == pytest.approx(np.exp(-np.pi * damping / root), abs=1e-3)


def test_a_sine_is_found_under_an_offset_a_drift_and_a_harmonic() -> None:
    angle = 2.0 * np.pi * 1.5 * TIME_S
    signal = 0.7 * np.sin(angle - 0.6) + 2.0 - 0.3 * TIME_S + 0.1 * np.sin(3.0 * angle)
    found = sine_in(TIME_S, signal, 1.5)
    assert abs(found) == pytest.approx(0.7, rel=1e-3)
    assert phase(found) == pytest.approx(-0.6, abs=1e-3)


def run_at(speed_mps: np.ndarray) -> Run:
    """A drive straight ahead with this speed every 2 ms."""
    zeros = np.zeros((len(speed_mps), 3))
    along = np.zeros_like(zeros)
    along[:, 0] = np.cumsum(speed_mps) * 0.002
    motion = np.column_stack((speed_mps, zeros[:, :2]))
    return Run(0.002, zeros, motion, along, np.zeros((len(speed_mps), len(PlantOutputs._fields))))


def test_the_mean_of_a_constant_deceleration_ignores_the_time_before() -> None:
    speed_mps = np.clip(28.0 - 7.5 * (np.arange(0.0, 5.0, 0.002) - 0.4), 0.0, 28.0)
    assert mean_deceleration(run_at(speed_mps), 28.0) == pytest.approx(7.5, rel=1e-3)
    assert isnan(mean_deceleration(run_at(np.full(100, 28.0)), 28.0))


@pytest.mark.parametrize(
    ("locks_at", "rear_first"),
    [
        ((40, 40, 60, 60), False),
        ((40, 40, 100, 100), False),
        ((100, 100, 100, 100), False),
        ((60, 60, 40, 60), True),
        ((60, 60, 60, 40), True),
        ((100, 100, 100, 90), True),
    ],
)
def test_a_rear_wheel_locks_first_if_it_does_on_either_side(
    locks_at: tuple[int, int, int, int], rear_first: bool
) -> None:
    speed_mps = np.linspace(27.0, 5.0, 100)
    rim_mps = np.tile(0.95 * speed_mps[:, None], (1, 4))
    for wheel, sample in enumerate(locks_at):
        rim_mps[sample:, wheel] = 0.0
    assert rear_locked_first(rim_mps, speed_mps) is rear_first


def test_locking_at_walking_pace_is_ignored() -> None:
    rim_mps = np.zeros((10, 4))
    rim_mps[:, :2] = 2.0
    assert not rear_locked_first(rim_mps, np.full(10, 2.0))


def test_shifts_in_one_direction_are_no_reversals() -> None:
    assert reversals(np.array([1.0, 1.0, 2.0, 3.0, 3.0, 4.0])) == 0
    assert reversals(np.array([2.0, 3.0, 2.0, 2.0, 3.0, 4.0])) == 2
