"""Test 7: braking, acceleration from rest, and the gearbox."""

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant.car_parts import GRAVITY_MPS2
from sim_bridge.plant.parameters import Parameters, with_road_friction
from sim_bridge.validation.acceptance import ALL_WHEEL, Line, at_least, at_most, near, within
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


def measure(parameters: Parameters) -> tuple[Run, Run, tuple[Line, ...]]:
    """Brakings from 100 km/h, and constant throttles from rest.

    Returns:
        the full braking, the run with full throttle, and the lines of the table.
    """
    braking = _constant_inputs(parameters, HUNDRED_MPS, 6.0, brake_n=FULL_BRAKE_N)
    full_throttle = _constant_inputs(parameters, 0.0, 30.0, throttle=1.0)
    gears = [
        _constant_inputs(parameters, 0.0, 60.0, throttle=throttle, period_s=0.05).column("gear")
        for throttle in THROTTLES
    ]
    rear_first = sum(
        _rear_locks_first(with_road_friction(parameters, friction), pedal_n)
        for friction in FRICTIONS
        for pedal_n in PEDALS_N
    )
    deceleration_mps2 = mean_deceleration(braking.time_s, braking.speed_mps, HUNDRED_MPS)
    lines = (
        Line("deceleration with 150 N", "g", deceleration_mps2 / GRAVITY_MPS2,
             within(0.8, 0.05), ALL_WHEEL),
        Line("stopping distance from 100 km/h", "m",
             float(distance(braking.time_s, braking.speed_mps)[-1])),
        Line("brakings in which a rear wheel locks first", "", rear_first, at_most(0.0)),
        Line("0-100 km/h", "s",
             crossing(full_throttle.time_s, full_throttle.speed_mps, HUNDRED_MPS),
             near(8.5, 0.5, "s"), ALL_WHEEL),
        Line("highest gear reached", "", float(max(gear.max() for gear in gears)),
             at_least(6.0), ALL_WHEEL),
        Line("shift reversals at a constant pedal", "", sum(reversals(gear) for gear in gears),
             at_most(0.0)),
    )  # fmt: skip
    return braking, full_throttle, lines


def rim_mps(run: Run) -> Array:
    """(K + 1, 4) wheel speeds times rolling radius; the wheels have no slip at the start."""
    radius_m = float(run.speed_mps[0] / np.mean(run.spins_radps[0]))
    return radius_m * run.spins_radps


def _rear_locks_first(parameters: Parameters, pedal_n: float) -> bool:
    run = _constant_inputs(parameters, HUNDRED_MPS, 4.0, brake_n=pedal_n)
    return rear_locked_first(rim_mps(run), run.speed_mps)


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
