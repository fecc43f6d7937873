"""Test 3: a lane change at the limit, 120 km/h on a road of friction 0.85."""

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant.parameters import Parameters, with_road_friction
from sim_bridge.validation.driver_model import DRIVER_PERIOD_S, PreviewDriver, fit_driver_model
from sim_bridge.validation.run import Run, run_driver
from sim_bridge.validation.signal_metrics import peak

SPEED_MPS = 120.0 / 3.6
FRICTION = 0.85
PREVIEW_S = 0.46
LEAD_S = 0.32
CORNERS_M = np.array(((70.0, 0.0), (95.0, 3.5), (120.0, 3.5), (145.0, 0.0)))
"""corners of the path, x and y: to the left and back in straight sections"""
_DURATION_S = 7.0


def measure(parameters: Parameters) -> tuple[Run, dict[str, float]]:
    """To the left and back with a preview driver at constant speed."""
    car = with_road_friction(parameters, FRICTION)
    driver = PreviewDriver(path_m, PREVIEW_S, fit_driver_model(car, SPEED_MPS), LEAD_S)
    run = run_driver(car, SPEED_MPS, driver, _DURATION_S, DRIVER_PERIOD_S)
    return run, {
        "peak lateral acceleration": peak(run.lateral_g),
        "peak yaw rate": peak(run.yaw_rate_degps),
        "peak sideslip": peak(run.sideslip_deg),
        "peak roll": peak(run.roll_deg),
        "largest steering wheel angle to the right": float(run.steer_deg.min()),
        "largest steering wheel angle to the left": float(run.steer_deg.max()),
    }


def path_m(x_m: Array) -> Array:
    """Lateral position of the path at distances ahead `x_m`, same shape."""
    y_m: Array = np.interp(x_m, CORNERS_M[:, 0], CORNERS_M[:, 1])
    return y_m
