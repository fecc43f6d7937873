"""Test 2: a slowly increasing steer, and what it says of the car in everyday driving."""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from sim_bridge.plant.parameters import GRAVITY_MPS2, Parameters
from sim_bridge.validation.drivers import OpenLoopDriver, SpeedHold
from sim_bridge.validation.measures import crossing, slope
from sim_bridge.validation.run import Array, Run, cruising_throttle, drive, replay

SPEED_MPS = 80.0 / 3.6
RATE_RADPS = radians(2.0)
_DURATION_S = 55.0
_PERIOD_S = 0.025
_LINEAR_G = (0.02, 0.3)


@dataclass(frozen=True, slots=True)
class Cornering:
    """The run and the numbers of test 2."""

    run: Run
    wheel_angle_deg: float
    """at 0.3 g"""
    effort_degpg: float
    understeer_degpg: float
    """at the road wheel"""
    compliant_understeer_degpg: float
    """at the steering wheel, over the ratio: compliance counts as understeer"""
    yaw_gain_ps: float
    roll_degpg: float
    sideslip_degpg: float


def measure(parameters: Parameters) -> Cornering:
    """2 deg/s at the steering wheel at 80 km/h, far into the limit."""
    foot = SpeedHold(SPEED_MPS, cruising_throttle(parameters, SPEED_MPS), _PERIOD_S)
    driver = OpenLoopDriver(lambda time_s: RATE_RADPS * time_s, foot)
    run = drive(parameters, SPEED_MPS, driver, _DURATION_S, _PERIOD_S)
    body = parameters.body
    bend_degpg = np.degrees((body.front_axle_m + body.rear_axle_m) * GRAVITY_MPS2 / SPEED_MPS**2)
    effort_degpg = _per_g(run, run.steer_deg)
    return Cornering(
        run=run,
        wheel_angle_deg=crossing(run.steer_deg, run.lateral_g, 0.3),
        effort_degpg=effort_degpg,
        understeer_degpg=_per_g(run, np.degrees(run.seen("road_wheel_rad"))) - bend_degpg,
        compliant_understeer_degpg=effort_degpg / parameters.steering.ratio - bend_degpg,
        yaw_gain_ps=slope(run.steer_deg, run.yaw_rate_degps, is_linear(run)),
        roll_degpg=_per_g(run, run.roll_deg),
        sideslip_degpg=_per_g(run, run.sideslip_deg),
    )


def is_linear(run: Run) -> NDArray[np.bool_]:
    """(K + 1,) where the lateral acceleration is that of everyday driving."""
    least_g, largest_g = _LINEAR_G
    return (run.lateral_g > least_g) & (run.lateral_g < largest_g)


def steer_per_mps2(parameters: Parameters, speed_mps: float) -> float:
    """Steering wheel angle per lateral acceleration, rad s^2/m, as a driver has it in his hands:
    from a small steady angle at the throttle that holds the speed."""
    steer_rad = radians(8.0)
    held = (cruising_throttle(parameters, speed_mps), 0.0, steer_rad)
    run = replay(parameters, speed_mps, np.tile(held, (300, 1)), 0.01)
    return float(steer_rad / run.seen("ay_mps2")[-1])


def _per_g(run: Run, angle_deg: Array) -> float:
    return slope(run.lateral_g, angle_deg, is_linear(run))
