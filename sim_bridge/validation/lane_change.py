"""Test 3: a lane change at the limit, 120 km/h on a road of friction 0.85."""

from dataclasses import dataclass

import numpy as np

from sim_bridge.plant.parameters import Parameters, with_road_friction
from sim_bridge.validation.measures import peak
from sim_bridge.validation.preview import PERIOD_S, PreviewDriver, get_familiar
from sim_bridge.validation.run import Array, Run, drive

SPEED_MPS = 120.0 / 3.6
FRICTION = 0.85
PREVIEW_S = 0.55
CORNERS_M = np.array(((70.0, 0.0), (95.0, 3.5), (120.0, 3.5), (145.0, 0.0)))
"""of the path, x and y: over to the left and back along straight pieces"""
_DURATION_S = 7.0


@dataclass(frozen=True, slots=True)
class LaneChange:
    """The run and the peaks of test 3."""

    run: Run
    lateral_g: float
    yaw_rate_degps: float
    sideslip_deg: float
    roll_deg: float
    rightmost_deg: float
    """steering wheel angle, negative"""
    leftmost_deg: float


def measure(parameters: Parameters) -> LaneChange:
    """Over and back with a preview driver who holds the speed."""
    car = with_road_friction(parameters, FRICTION)
    driver = PreviewDriver(path_m, PREVIEW_S, get_familiar(car, SPEED_MPS))
    run = drive(car, SPEED_MPS, driver, _DURATION_S, PERIOD_S)
    return LaneChange(
        run=run,
        lateral_g=peak(run.lateral_g),
        yaw_rate_degps=peak(run.yaw_rate_degps),
        sideslip_deg=peak(run.sideslip_deg),
        roll_deg=peak(run.roll_deg),
        rightmost_deg=float(run.steer_deg.min()),
        leftmost_deg=float(run.steer_deg.max()),
    )


def path_m(x_m: Array) -> Array:
    """The path's way to the left at ways ahead `x_m`, same shape."""
    way_m: Array = np.interp(x_m, CORNERS_M[:, 0], CORNERS_M[:, 1])
    return way_m
