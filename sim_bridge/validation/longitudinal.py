"""Test 7: braking, driving off, and the gearbox."""

from dataclasses import dataclass

import numpy as np

from sim_bridge.plant.parameters import GRAVITY_MPS2, Parameters, with_road_friction
from sim_bridge.validation.measures import (
    crossing,
    distance,
    mean_deceleration,
    rear_locked_first,
    reversals,
)
from sim_bridge.validation.run import Array, Run, replay

HUNDRED_MPS = 100.0 / 3.6
FULL_BRAKE_N = 150.0
FRICTIONS = (0.2, 0.35, 0.5, 0.7, 0.85, 1.0)
PEDALS_N = (50.0, 80.0, 110.0, 150.0)
THROTTLES = (0.1, 0.2, 0.35, 0.6, 1.0)
_PERIOD_S = 0.01


@dataclass(frozen=True, slots=True)
class Longitudinal:
    """The runs and numbers of test 7."""

    braking: Run
    driving_off: Run
    """full throttle"""
    deceleration_g: float
    stopping_m: float
    rear_first: int
    """brakings, over frictions and pedal forces, in which a rear wheel locked first"""
    hundred_s: float
    top_gear: int
    """over all steady pedals"""
    reversals: int
    """of the shifts' direction, over all steady pedals"""


def measure(parameters: Parameters) -> Longitudinal:
    """Brakings from 100 km/h, and steady pedals from rest."""
    braking = _held(parameters, HUNDRED_MPS, 6.0, brake_n=FULL_BRAKE_N)
    driving_off = _held(parameters, 0.0, 30.0, throttle=1.0)
    gears = [
        _held(parameters, 0.0, 60.0, throttle=throttle, period_s=0.05).seen("gear")
        for throttle in THROTTLES
    ]
    return Longitudinal(
        braking=braking,
        driving_off=driving_off,
        deceleration_g=mean_deceleration(braking.time_s, braking.speed_mps, HUNDRED_MPS)
        / GRAVITY_MPS2,
        stopping_m=float(distance(braking.time_s, braking.speed_mps)[-1]),
        rear_first=sum(
            _rear_locks_first(with_road_friction(parameters, friction), pedal_n)
            for friction in FRICTIONS
            for pedal_n in PEDALS_N
        ),
        hundred_s=crossing(driving_off.time_s, driving_off.speed_mps, HUNDRED_MPS),
        top_gear=int(max(gear.max() for gear in gears)),
        reversals=sum(reversals(gear) for gear in gears),
    )


def rim_mps(run: Run) -> Array:
    """(K + 1, 4) speeds of the wheels' rims; they roll without slip at the start."""
    radius_m = float(run.speed_mps[0] / np.mean(run.spins_radps[0]))
    return radius_m * run.spins_radps


def _rear_locks_first(parameters: Parameters, pedal_n: float) -> bool:
    run = _held(parameters, HUNDRED_MPS, 4.0, brake_n=pedal_n)
    return rear_locked_first(rim_mps(run), run.speed_mps)


def _held(
    parameters: Parameters,
    v0_mps: float,
    duration_s: float,
    throttle: float = 0.0,
    brake_n: float = 0.0,
    period_s: float = _PERIOD_S,
) -> Run:
    inputs = np.tile((throttle, brake_n, 0.0), (round(duration_s / period_s), 1))
    return replay(parameters, v0_mps, inputs, period_s)
