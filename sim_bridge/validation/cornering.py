"""Test 2: slowly increasing steer, and the linear-range quantities measured in it."""

from math import radians

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.driver_model import steer_open_loop
from sim_bridge.validation.run import Run, cruising_throttle, input_table, replay
from sim_bridge.validation.signal_metrics import crossing, slope

WHEEL_ANGLE = "steering wheel angle at 0.3 g"
SPEED_MPS = 80.0 / 3.6
RATE_RADPS = radians(2.0)
_DURATION_S = 55.0
_DRIVER_PERIOD_S = 0.025
_LINEAR_G = (0.02, 0.3)


def measure(parameters: Parameters) -> tuple[Run, dict[str, float]]:
    """2 deg/s at the steering wheel at 80 km/h, up to the limit of adhesion."""
    run = steer_open_loop(
        parameters, SPEED_MPS, lambda time_s: RATE_RADPS * time_s, _DURATION_S, _DRIVER_PERIOD_S
    )
    body = parameters.body
    bend_degpg = np.degrees((body.front_axle_m + body.rear_axle_m) * GRAVITY_MPS2 / SPEED_MPS**2)
    effort_degpg = _per_g(run, run.steer_deg)
    road_wheel_degpg = _per_g(run, np.degrees(run.column("road_wheel_rad")))
    return run, {
        WHEEL_ANGLE: crossing(run.steer_deg, run.lateral_g, 0.3),
        "steering effort": effort_degpg,
        "understeer, road wheel": road_wheel_degpg - bend_degpg,
        "understeer with compliance": effort_degpg / parameters.steering.ratio - bend_degpg,
        "yaw gain": slope(run.steer_deg, run.yaw_rate_degps, is_linear(run)),
        "roll": _per_g(run, run.roll_deg),
        "sideslip": _per_g(run, run.sideslip_deg),
    }


def is_linear(run: Run) -> NDArray[np.bool_]:
    """(K + 1,) True where the lateral acceleration is within the linear range."""
    least_g, largest_g = _LINEAR_G
    return (run.lateral_g > least_g) & (run.lateral_g < largest_g)


def steer_per_mps2(parameters: Parameters, speed_mps: float) -> float:
    """Steering wheel angle per lateral acceleration, rad s^2/m.

    Measured with a small constant angle at the throttle that keeps the speed.
    """
    steer_rad = radians(8.0)
    inputs = input_table(300, cruising_throttle(parameters, speed_mps), steer_rad=steer_rad)
    run = replay(parameters, speed_mps, inputs, 0.01)
    return float(steer_rad / run.column("ay_mps2")[-1])


def _per_g(run: Run, angle_deg: Array) -> float:
    return slope(run.lateral_g, angle_deg, is_linear(run))
