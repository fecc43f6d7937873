"""Test 11: a stop, a standing car, walking pace, and the friction ellipse of the tyre."""

from collections.abc import Callable
from math import atan, hypot, nan, radians, tan

import numpy as np
from scipy.optimize import minimize_scalar

from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import tyre_force
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.run import Run, input_table, replay

STOP_MPS = 60.0 / 3.6
LOCKING_N = 400.0
WALKING_MPS = 1.5
TURN_DEG = (60.0, 200.0, 400.0)
PARKING_DEG = 180.0
GRADE = 0.2
HOLDING_N = 100.0
_PERIOD_S = 0.025
_LOADS_N = (1500.0, 3000.0, 4500.0, 6500.0)
_FRICTIONS = (0.3, 0.85, 1.0)
_SLIPS = np.concatenate((-np.geomspace(1.0, 0.005, 24), np.geomspace(0.005, 1.0, 24)))
_PEAK_SLIPS = (0.01, 1.0)


def measure(parameters: Parameters) -> tuple[Run, dict[str, float]]:
    """A stop with locked wheels, parking, turns at walking pace, and a car held on a grade."""
    stop = replay(parameters, STOP_MPS, input_table(_periods(6.0), brake_n=LOCKING_N), _PERIOD_S)
    yaw_rates = [100.0 * _kinematic_share(parameters, angle_deg) for angle_deg in TURN_DEG]
    return stop, {
        "speed backwards after a locked stop": float(np.maximum(0.0, -1e3 * stop.speed_mps.min())),
        "smallest yaw rate at walking pace": float(np.min(yaw_rates)),
        "largest yaw rate at walking pace": float(np.max(yaw_rates)),
        "torque about the kingpins at standstill": _parking_nm(parameters),
        "creep in 10 s with the brake on a grade of 20 %": 1e3 * _creep_m(parameters),
        "force beyond the friction ellipse": 100.0 * (ellipse_share(parameters) - 1.0),
    }


def ellipse_share(parameters: Parameters) -> float:
    """Largest force of a tyre over the ellipse of its largest pure forces, over pairs of slips.

    NaN for a tyre that has no force.
    """
    largest, record = 0.0, car_record(parameters)
    for load_n in _LOADS_N:
        for friction in _FRICTIONS:

            def left_n(slip: float, n: float = load_n, mu: float = friction) -> float:
                return abs(tyre_force(slip, 0.0, 0.0, n, mu, record)[1])

            def forward_n(slip: float, n: float = load_n, mu: float = friction) -> float:
                return abs(tyre_force(0.0, slip, 0.0, n, mu, record)[0])

            largest_left_n, largest_forward_n = _peak(left_n), _peak(forward_n)
            if not (largest_left_n > 0.0 and largest_forward_n > 0.0):
                return nan
            for sideways in _SLIPS.tolist():
                for along in _SLIPS.tolist():
                    force_n = tyre_force(sideways, along, 0.0, load_n, friction, record)
                    share = hypot(force_n[1] / largest_left_n, force_n[0] / largest_forward_n)
                    largest = max(largest, share)
    return largest


def _peak(force_n: Callable[[float], float]) -> float:
    """Largest value over slips of both signs."""
    positive = minimize_scalar(lambda slip: -force_n(slip), bounds=_PEAK_SLIPS)
    negative = minimize_scalar(lambda slip: -force_n(-slip), bounds=_PEAK_SLIPS)
    return -float(min(positive.fun, negative.fun))


def _kinematic_share(parameters: Parameters, angle_deg: float) -> float:
    """Yaw rate at walking pace, over that of a car whose wheels do not slip."""
    steer_rad = radians(angle_deg) * np.minimum(1.0, np.arange(_periods(6.0)) / _periods(1.5))
    inputs = input_table(len(steer_rad), steer_rad=steer_rad)
    run = replay(parameters, WALKING_MPS, inputs, _PERIOD_S)
    wheelbase_m = parameters.body.front_axle_m + parameters.body.rear_axle_m
    curvature_per_m = tan(radians(angle_deg) / parameters.steering.ratio) / wheelbase_m
    speed_mps, _, yaw_rate_radps = run.motion[-1].tolist()
    return float(yaw_rate_radps / (speed_mps * curvature_per_m)) if speed_mps > 0.0 else nan


def _parking_nm(parameters: Parameters) -> float:
    """Torque about both kingpins while the steering of a standing car turns, without friction."""
    steer_rad = radians(PARKING_DEG) * np.linspace(0.0, 1.0, _periods(2.0))
    inputs = input_table(len(steer_rad), brake_n=LOCKING_N, steer_rad=steer_rad)
    hand_nm = replay(parameters, 0.0, inputs, _PERIOD_S).column("steering_wheel_nm")[-1]
    return float(hand_nm) * parameters.steering.ratio - parameters.steering.friction_nm


def _creep_m(parameters: Parameters) -> float:
    """Way of a braked car within the last 10 s of 20 s on a grade."""
    slope = parameters._replace(road=parameters.road._replace(grade_rad=atan(GRADE)))
    run = replay(slope, 0.0, input_table(_periods(20.0), brake_n=HOLDING_N), _PERIOD_S)
    return float(np.ptp(run.x_m[-_periods(10.0) :]))


def _periods(duration_s: float) -> int:
    return round(duration_s / _PERIOD_S)
