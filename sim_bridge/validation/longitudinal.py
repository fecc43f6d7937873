"""Test 7: braking, acceleration from rest, and the gearbox."""

from math import nan

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant.parameters import Parameters, with_road_friction
from sim_bridge.validation.run import Run, input_table, replay
from sim_bridge.validation.signal_metrics import (
    crossing,
    distance,
    mean_deceleration,
    rear_locked_first,
    reversals,
)

HUNDRED_MPS = 100.0 / 3.6
FULL_BRAKE_N = 150.0
FRICTIONS = (0.2, 0.35, 0.5, 0.7, 0.85, 1.0)
PEDALS_N = (50.0, 80.0, 110.0, 150.0)
THROTTLES = (0.1, 0.2, 0.35, 0.6, 1.0)
_INPUT_PERIOD_S = 0.01


def measure(parameters: Parameters) -> tuple[Run, Run, dict[str, float]]:
    """Brakings from 100 km/h, and constant throttles from rest.

    Returns:
        the full braking, the run with full throttle, and the values of the table by line.
    """
    braking = _constant_inputs(parameters, HUNDRED_MPS, 6.0, brake_n=FULL_BRAKE_N)
    full_throttle = _constant_inputs(parameters, 0.0, 30.0, throttle=1.0)
    runs = [
        _constant_inputs(parameters, 0.0, 60.0, throttle=throttle, period_s=0.05)
        for throttle in THROTTLES
    ]
    gears = [run.column("gear") for run in runs if run.is_finite]
    has_gears = len(gears) == len(runs)
    rear_first = sum(
        _rear_locks_first(with_road_friction(parameters, friction), pedal_n)
        for friction in FRICTIONS
        for pedal_n in PEDALS_N
    )
    deceleration_mps2 = mean_deceleration(braking.time_s, braking.speed_mps, HUNDRED_MPS)
    return (
        braking,
        full_throttle,
        {
            "deceleration with 150 N": deceleration_mps2 / GRAVITY_MPS2,
            "stopping distance from 100 km/h": distance(braking.time_s, braking.speed_mps)[-1],
            "brakings in which a rear wheel locks first": rear_first,
            "pitch while braking with 150 N": _pitch_deg_per_g(braking),
            "pitch at full throttle": _pitch_deg_per_g(full_throttle),
            "0-100 km/h": crossing(full_throttle.time_s, full_throttle.speed_mps, HUNDRED_MPS),
            "highest gear reached": max(gear.max() for gear in gears) if has_gears else nan,
            "shift reversals at a constant pedal": (
                sum(reversals(gear) for gear in gears) if has_gears else nan
            ),
        },
    )


def rim_mps(run: Run) -> Array:
    """(K + 1, 4) wheel speeds times rolling radius; the wheels have no slip at the start."""
    radius_m = float(run.speed_mps[0] / np.mean(run.spins_radps[0]))
    return radius_m * run.spins_radps


def _pitch_deg_per_g(run: Run) -> float:
    """Pitch over deceleration, means over the second second."""
    second = (run.time_s >= 1.0) & (run.time_s < 2.0)
    pitch_deg = np.degrees(run.column("pitch_rad")[second].mean())
    return float(-pitch_deg * GRAVITY_MPS2 / run.column("ax_mps2")[second].mean())


def _rear_locks_first(parameters: Parameters, pedal_n: float) -> float:
    """1 if a rear wheel locks first, else 0; NaN if the car failed."""
    run = _constant_inputs(parameters, HUNDRED_MPS, 4.0, brake_n=pedal_n)
    return float(rear_locked_first(rim_mps(run), run.speed_mps)) if run.is_finite else nan


def _constant_inputs(
    parameters: Parameters,
    v0_mps: float,
    duration_s: float,
    throttle: float = 0.0,
    brake_n: float = 0.0,
    period_s: float = _INPUT_PERIOD_S,
) -> Run:
    inputs = input_table(round(duration_s / period_s), throttle, brake_n)
    return replay(parameters, v0_mps, inputs, period_s)
