"""Manoeuvres with the steering wheel: each drives a car and returns values by line name.

A value that the drive does not contain is NaN; the table shows it as not judged.
"""

from math import nan, pi, radians

import numpy as np

from rt_controller.contract.signals import GRAVITY_MPS2
from sim_bridge.plant.parameters import Parameters, with_road_friction
from sim_bridge.scenario.metrics import peak
from sim_bridge.validation.driver_model import (
    DRIVER_PERIOD_S,
    PreviewDriver,
    fit_driver_model,
    steer_open_loop,
)
from sim_bridge.validation.run import (
    PER_KMH,
    Measured,
    cruising_throttle,
    input_table,
    replay,
    run_driver,
)
from sim_bridge.validation.signal_metrics import crossing, sine_in, slope, step_response

_PATH_X_M, _PATH_Y_M = np.array(((70.0, 95.0, 120.0, 145.0), (0.0, 3.5, 3.5, 0.0)))
"""corners of the path of the lane change at the limit"""
_PREVIEW_S, _LEAD_S = 0.46, 0.32
_SINES_HZ = (0.2, 0.5, 1.0, 1.4, 1.8)


def slow_steer(car: Parameters) -> Measured:
    """Steering wheel at 2 deg/s at 80 km/h, up to the limit; slopes between 0.02 and 0.3 g."""
    v0_mps = 80.0 * PER_KMH
    run = steer_open_loop(car, v0_mps, lambda time_s: radians(2.0) * time_s, 55.0, 0.025)
    linear = (run.lateral_g > 0.02) & (run.lateral_g < 0.3)
    turn_degpg = np.degrees(car.body.wheelbase_m * GRAVITY_MPS2 / v0_mps**2)
    effort_degpg = slope(run.lateral_g, run.steer_deg, linear)
    road_wheel_deg = np.degrees(run.column("road_wheel_rad"))
    left, right = run.loads_n[:, ::2], run.loads_n[:, 1::2]
    front, rear = (slope(run.lateral_g, n, linear) for n in (right - left).T)
    return {
        "steering wheel angle at 0.3 g": crossing(run.steer_deg, run.lateral_g, 0.3),
        "steering effort": effort_degpg,
        "understeer, road wheel": slope(run.lateral_g, road_wheel_deg, linear) - turn_degpg,
        "understeer with compliance": effort_degpg / car.steering.ratio - turn_degpg,
        "yaw gain": slope(run.steer_deg, run.yaw_rate_degps, linear),
        "roll": slope(run.lateral_g, run.roll_deg, linear),
        "sideslip": slope(run.lateral_g, run.sideslip_deg, linear),
        "load transfer, front axle": front,
        "load transfer, rear axle": rear,
    }


def lane_change(car: Parameters) -> Measured:
    """3.5 m to the left and back at 120 km/h with a preview driver, friction 0.85."""
    car, v0_mps = with_road_friction(car, 0.85), 120.0 * PER_KMH
    model = fit_driver_model(car, v0_mps)
    driver = PreviewDriver(lambda x: np.interp(x, _PATH_X_M, _PATH_Y_M), _PREVIEW_S, model, _LEAD_S)
    run = run_driver(car, v0_mps, driver, 7.0, DRIVER_PERIOD_S)
    return {
        "peak lateral acceleration": peak(run.lateral_g),
        "peak yaw rate": peak(run.yaw_rate_degps),
        "peak sideslip": peak(run.sideslip_deg),
        "peak roll": peak(run.roll_deg),
        "largest steering wheel angle to the right": float(run.steer_deg.min()),
        "largest steering wheel angle to the left": float(run.steer_deg.max()),
    }


def ramps(car: Parameters) -> Measured:
    """Ramps of the road wheel at 0.4 rad/s and 22.2 m/s."""
    values: dict[str, float] = {}
    for angle_rad in (0.01, 0.02, 0.03):

        def steer_rad(time_s: float, angle_rad: float = angle_rad) -> float:
            return car.steering.ratio * min(angle_rad, 0.4 * (time_s + 0.0025))

        run = steer_open_loop(car, 22.2, steer_rad, 3.0, 0.005)
        yaw_rate = step_response(run.time_s, run.yaw_rate_degps, 0.0)
        values |= {
            f"yaw rate at {angle_rad} rad": yaw_rate.steady,
            f"roll at {angle_rad} rad": step_response(run.time_s, run.roll_deg, 0.0).steady,
            f"rise time at {angle_rad} rad": yaw_rate.t90_s,
        }
    return values


def step_steer(car: Parameters) -> Measured:
    """A step at 500 deg/s to 4 m/s^2 at 100 km/h; the angle is found by iteration."""
    v0_mps, at_s, period_s, rate_radps = 100.0 * PER_KMH, 0.5, 0.005, radians(500.0)
    throttle, angle_rad = cruising_throttle(car, v0_mps), radians(30.0)
    time_s = period_s * np.arange(0.5, 800)
    for _ in range(7):
        steer_rad = np.clip(rate_radps * (time_s - at_s), 0.0, angle_rad)
        run = replay(car, v0_mps, input_table(len(time_s), throttle, steer_rad=steer_rad), period_s)
        step_s = at_s + 0.5 * angle_rad / rate_radps
        lateral = step_response(run.time_s, run.column("ay_mps2"), step_s)
        # A car that does not turn has no such angle.
        angle_rad *= 4.0 / lateral.steady if lateral.steady > 0.0 else nan
    yaw_rate = step_response(run.time_s, run.yaw_rate_degps, step_s)
    return {
        "t90 of yaw rate": yaw_rate.t90_s,
        "overshoot of yaw rate": 100.0 * yaw_rate.overshoot,
        "t90 of lateral acceleration": lateral.t90_s,
    }


def sines(car: Parameters) -> Measured:
    """Frequency response at small angles of the steering wheel: 80 and 50 km/h."""
    values: dict[str, float] = {}
    for kmh, steer_deg in ((80, 15.0), (50, 20.0)):
        for hz in _SINES_HZ:
            yaw, lateral, roll = _response(car, kmh, steer_deg, hz)
            at, yaw_deg = f"at {hz} Hz, {kmh} km/h", float(np.degrees(np.angle(yaw)))
            values |= {
                f"yaw gain {at}": abs(yaw),
                f"yaw phase {at}": yaw_deg,
                f"yaw phase {at}, against a single-track model": yaw_deg,
                f"lateral gain {at}": 100.0 * abs(lateral),
                f"roll {at}": abs(roll),
            }
    return values


def _response(car: Parameters, kmh: float, steer_deg: float, hz: float) -> tuple[complex, ...]:
    """Yaw rate and lateral acceleration over steering wheel, roll over lateral acceleration.

    Over three whole periods, after two periods and at least 2 s.
    """
    settling_s, v0_mps = max(2.0, np.ceil(2.0 * hz)) / hz, kmh * PER_KMH
    time_s = 0.005 * np.arange(0.5, round((settling_s + 3.0 / hz) / 0.005))
    wheel_rad = radians(steer_deg) * np.sin(2.0 * pi * hz * time_s)
    inputs = input_table(len(time_s), cruising_throttle(car, v0_mps), steer_rad=wheel_rad)
    run = replay(car, v0_mps, inputs, 0.005)
    among = run.time_s >= settling_s
    t = run.time_s[among]
    # An input belongs to the middle of its period, the response to its end.
    steer = sine_in(t - 0.0025, run.steer_deg[among], hz)
    signals = run.yaw_rate_degps, run.lateral_g, run.roll_deg
    yaw, lateral, roll = (sine_in(t, y[among], hz) for y in signals)
    return yaw / steer, lateral / steer, roll / lateral


def cross_wind(car: Parameters) -> Measured:
    """After ISO 12021: 20 m/s from the left at 100 km/h, from one moment on, hands fixed."""
    v0_mps = 100.0 * PER_KMH
    windy = np.tile(car.road._replace(wind_left_mps=-20.0), (200, 1))
    inputs = input_table(200, cruising_throttle(car, v0_mps))
    run = replay(car, v0_mps, inputs, 0.01, roads=windy)
    return {
        "lateral deviation after 2 s": float(run.y_m[-1]),
        "peak yaw rate": peak(run.yaw_rate_degps),
    }


LATERAL = (slow_steer, lane_change, ramps, step_steer, sines, cross_wind)
