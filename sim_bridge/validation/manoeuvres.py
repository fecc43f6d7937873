"""The manoeuvres of the acceptance table: each drives a car and returns values by line name.

A value that the drive does not contain is NaN; the table shows it as not judged.
"""

from collections.abc import Callable
from math import atan, isfinite, nan, pi, radians, tan
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.parameters import Parameters, with_road_friction
from sim_bridge.scenario import load_scenario
from sim_bridge.validation.driver_model import (
    DRIVER_PERIOD_S,
    PreviewDriver,
    SpeedControl,
    fit_driver_model,
    steer_open_loop,
)
from sim_bridge.validation.run import (
    Observation,
    Run,
    cruising_throttle,
    input_table,
    replay,
    run_driver,
)
from sim_bridge.validation.signal_metrics import (
    crossing,
    largest_gain,
    mean_deceleration,
    peak,
    rear_locked_first,
    reversals,
    sine_in,
    slope,
    step_response,
)

_PER_KMH = 1.0 / 3.6
_SLOW_STEER_RADPS = radians(2.0)
CORNERS_M = np.array(((70.0, 0.0), (95.0, 3.5), (120.0, 3.5), (145.0, 0.0)))
"""of the path of the lane change at the limit, x and y"""
_PREVIEW_S, _LEAD_S = 0.46, 0.32
_SINES_HZ = (0.2, 0.5, 1.0, 1.4, 1.8)
_DWELL_HZ, _DWELL_S, _DWELL_FROM_S = 0.7, 0.5, 0.5
_PEDALS_N = np.linspace(0.0, 200.0, 21)
_FULL_PEDAL_N = 400.0
_STEADY_S = 15.0


class Curve(NamedTuple):
    """A curve of the page; curves with the same axes share a panel."""

    x_title: str
    y_title: str
    x: Array
    y: Array
    name: str = "car"


class Measured(NamedTuple):
    """The result of a manoeuvre."""

    values: dict[str, float]
    """by the name of the line"""
    curves: tuple[Curve, ...] = ()


def equations(car: Parameters) -> Measured:
    """A mirrored slalom, a lane change with half the step, and energy while coasting in a turn."""
    time_s = np.arange(0.0, 5.0, DRIVER_PERIOD_S)
    inputs = input_table(
        len(time_s),
        throttle=np.where(time_s < 2.5, 0.6, 0.0),
        brake_n=np.where(time_s >= 3.0, 60.0, 0.0),
        steer_rad=radians(90.0) * np.sin(pi * time_s),
    )
    left = replay(car, 80.0 * _PER_KMH, inputs, DRIVER_PERIOD_S)
    right = replay(car, 80.0 * _PER_KMH, inputs * (1.0, 1.0, -1.0), DRIVER_PERIOD_S)
    mirrored = np.hstack((right.motion, right.pose)) * (1.0, -1.0, -1.0, 1.0, -1.0, -1.0)
    scenario = load_scenario("double_lane_change")
    v0_mps = scenario.start.speed_mps
    driver = PreviewDriver(scenario.ey_m, 0.8, fit_driver_model(car, v0_mps))
    driven = run_driver(car, v0_mps, driver, scenario.duration_s, DRIVER_PERIOD_S).inputs[1:]
    coarse, fine = (
        replay(car, v0_mps, driven, DRIVER_PERIOD_S, step_s) for step_s in (STEP_S, 0.5 * STEP_S)
    )
    turn = input_table(800, steer_rad=radians(20.0))
    coasting = replay(car, 100.0 * _PER_KMH, turn, DRIVER_PERIOD_S)
    # The drive fades within the first half second.
    energy_j = _energy_j(coasting, car)[round(0.5 / DRIVER_PERIOD_S) :]
    values = {
        "largest difference of the mirrored run": peak(
            np.hstack((left.motion, left.pose)) - mirrored
        ),
        "yaw rate change with half the step": peak(coarse.yaw_rate_degps - fine.yaw_rate_degps),
        "lateral position change with half the step": 1e3 * peak(coarse.y_m - fine.y_m),
        "energy gain while coasting in a turn": 100.0 * largest_gain(energy_j),
    }
    return Measured(values)


def _energy_j(run: Run, car: Parameters) -> Array:
    """Kinetic energy of body, wheels and engine; energy in springs and shafts is small."""
    energy_j: Array = 0.5 * (
        run.motion**2 @ (car.body.mass_kg, car.body.mass_kg, car.body.yaw_inertia_kgm2)
        + car.tyre.spin_inertia_kgm2 * np.sum(run.spins_radps**2, axis=1)
        + (car.engine.inertia_kgm2 + car.motor.inertia_kgm2)
        * (run.column("engine_rpm") * pi / 30.0) ** 2
    )
    return energy_j


def _slow_steer(car: Parameters) -> Run:
    """Steering wheel at 2 deg/s at 80 km/h, up to the limit of adhesion."""
    return steer_open_loop(car, 80.0 * _PER_KMH, lambda t: _SLOW_STEER_RADPS * t, 55.0, 0.025)


def slow_steer(car: Parameters) -> Measured:
    """Slowly increasing steer; slopes between 0.02 and 0.3 g."""
    run = _slow_steer(car)
    linear = (run.lateral_g > 0.02) & (run.lateral_g < 0.3)
    turn_degpg = np.degrees(_wheelbase_m(car) * GRAVITY_MPS2 / (80.0 * _PER_KMH) ** 2)
    effort_degpg = slope(run.lateral_g, run.steer_deg, linear)
    road_wheel_deg = np.degrees(run.column("road_wheel_rad"))
    left, right = run.loads_n[:, ::2], run.loads_n[:, 1::2]
    front, rear = (slope(run.lateral_g, n, linear) for n in (right - left).T)
    values = {
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
    title = "lateral acceleration / g"
    curves = (
        Curve(title, "steering wheel / deg", run.lateral_g, run.steer_deg),
        Curve(title, "roll / deg", run.lateral_g, run.roll_deg),
        Curve(title, "sideslip / deg", run.lateral_g, run.sideslip_deg),
    )
    return Measured(values, curves)


def lane_change(car: Parameters) -> Measured:
    """3.5 m to the left and back at 120 km/h with a preview driver, friction 0.85."""
    car = with_road_friction(car, 0.85)
    model = fit_driver_model(car, 120.0 * _PER_KMH)
    path_x_m, path_y_m = CORNERS_M.T
    driver = PreviewDriver(lambda x: np.interp(x, path_x_m, path_y_m), _PREVIEW_S, model, _LEAD_S)
    run = run_driver(car, 120.0 * _PER_KMH, driver, 7.0, DRIVER_PERIOD_S)
    values = {
        "peak lateral acceleration": peak(run.lateral_g),
        "peak yaw rate": peak(run.yaw_rate_degps),
        "peak sideslip": peak(run.sideslip_deg),
        "peak roll": peak(run.roll_deg),
        "largest steering wheel angle to the right": float(run.steer_deg.min()),
        "largest steering wheel angle to the left": float(run.steer_deg.max()),
    }
    curves = (
        Curve("distance ahead / m", "lateral position / m", path_x_m, path_y_m, "path"),
        Curve("distance ahead / m", "lateral position / m", run.x_m, run.y_m),
        Curve("time / s", "steering wheel / deg", run.time_s, run.steer_deg),
        Curve("time / s", "yaw rate / (deg/s)", run.time_s, run.yaw_rate_degps),
    )
    return Measured(values, curves)


def ramps(car: Parameters) -> Measured:
    """Ramps of the road wheel at 0.4 rad/s and 22.2 m/s."""
    values: dict[str, float] = {}
    for angle_rad in (0.01, 0.02, 0.03):

        def steer_rad(time_s: float, angle_rad: float = angle_rad) -> float:
            return car.steering.ratio * min(angle_rad, 0.4 * (time_s + 0.0025))

        run = steer_open_loop(car, 22.2, steer_rad, 3.0, 0.005)
        yaw_rate = step_response(run.time_s, run.yaw_rate_degps, 0.0)
        roll = step_response(run.time_s, run.roll_deg, 0.0)
        values |= {
            f"yaw rate at {angle_rad} rad": yaw_rate.steady,
            f"roll at {angle_rad} rad": roll.steady,
            f"rise time at {angle_rad} rad": yaw_rate.t90_s,
        }
    return Measured(values)


def step_steer(car: Parameters) -> Measured:
    """A step at 500 deg/s to 4 m/s^2 at 100 km/h; the angle is found by iteration."""
    v0_mps, at_s, period_s, rate_radps = 100.0 * _PER_KMH, 0.5, 0.005, radians(500.0)
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
    values = {
        "t90 of yaw rate": yaw_rate.t90_s,
        "overshoot of yaw rate": 100.0 * yaw_rate.overshoot,
        "t90 of lateral acceleration": lateral.t90_s,
    }
    return Measured(values)


def sine_with_dwell(car: Parameters) -> Measured:
    """FMVSS 126: amplitudes of 1.5 to 6.5 times the angle at 0.3 g, and 270 deg, throttle closed.

    The worst of the series.
    """
    slow = _slow_steer(car)
    base_deg = crossing(slow.steer_deg, slow.lateral_g, 0.3)
    amplitudes_deg = [a for a in base_deg * np.arange(1.5, 7.0) if a < 270.0] + [270.0]
    time_s = 0.005 * np.arange(0.5, 1000)
    end_s = _DWELL_FROM_S + 1.0 / _DWELL_HZ + _DWELL_S
    shares, displaced_m = [], []
    for amplitude_deg in amplitudes_deg if base_deg > 0.0 else ():
        wave = radians(amplitude_deg) * dwell_wave(time_s - _DWELL_FROM_S)
        run = replay(car, 80.0 * _PER_KMH, input_table(1000, steer_rad=wave), 0.005)
        reversed_s = _DWELL_FROM_S + 0.5 / _DWELL_HZ
        second_peak_degps = peak(run.yaw_rate_degps[run.time_s > reversed_s])
        after_s = (end_s + 1.0, end_s + 1.75)
        left = np.interp(after_s, run.time_s, np.abs(run.yaw_rate_degps)) / second_peak_degps
        shares.append(100.0 * left)
        # The requirement on the displacement holds from five times the angle at 0.3 g on.
        if amplitude_deg >= 5.0 * base_deg:
            displaced_m.append(abs(float(np.interp(_DWELL_FROM_S + 1.07, run.time_s, run.y_m))))
    worst = np.max(shares, axis=0) if shares else (nan, nan)
    values = {
        "yaw rate 1.00 s after the steering": float(worst[0]),
        "yaw rate 1.75 s after the steering": float(worst[1]),
        "lateral displacement after 1.07 s": float(min(displaced_m, default=nan)),
    }
    return Measured(values)


def dwell_wave(time_s: Array) -> Array:
    """One period of a sine of amplitude 1 with a dwell in its second peak, else zero."""
    dwell_from_s = 0.75 / _DWELL_HZ
    sine_s = np.where(time_s < dwell_from_s, time_s, np.maximum(dwell_from_s, time_s - _DWELL_S))
    inside = (time_s >= 0.0) & (sine_s <= 1.0 / _DWELL_HZ)
    return np.where(inside, np.sin(2.0 * pi * _DWELL_HZ * sine_s), 0.0)


def braking(car: Parameters) -> Measured:
    """150 N at the pedal and a full braking from 100 km/h; full brakings on six frictions."""
    v0_mps = 100.0 * _PER_KMH
    run = _held(car, v0_mps, 6.0, brake_n=150.0)
    full = _held(car, v0_mps, 8.0, brake_n=_FULL_PEDAL_N)
    locked = rear_first = 0
    for friction in (0.2, 0.35, 0.5, 0.7, 0.85, 1.0):
        for pedal_n in (50.0, 80.0, 110.0, 150.0, _FULL_PEDAL_N):
            one = _held(with_road_friction(car, friction), v0_mps, 4.0, brake_n=pedal_n)
            rims_mps = one.spins_radps * v0_mps / np.mean(one.spins_radps[0])
            fast = one.speed_mps > 15.0 * _PER_KMH
            locked += bool((rims_mps[fast] < 0.05 * one.speed_mps[fast, None]).any())
            rear_first += rear_locked_first(rims_mps, one.speed_mps)
    has_anti_lock = car.anti_lock.slip > 0.0
    values = {
        "deceleration with 150 N": mean_deceleration(run, v0_mps) / GRAVITY_MPS2,
        "stopping distance from 100 km/h, 150 N": _stop_m(run),
        "stopping distance from 100 km/h, full pedal": _stop_m(full),
        "brakings in which a wheel locks above 15 km/h": locked if has_anti_lock else nan,
        # Anti-lock with brake-force distribution decides it by construction.
        "brakings in which a rear wheel locks first": nan if has_anti_lock else rear_first,
    }
    return Measured(values)


def acceleration(car: Parameters) -> Measured:
    """Full throttle from rest; five constant throttles for a minute each; the released pedal."""
    run = _held(car, 0.0, 30.0, throttle=1.0)
    gears = [
        _held(car, 0.0, 60.0, throttle=share, period_s=0.05).column("gear")
        for share in (0.1, 0.2, 0.35, 0.6, 1.0)
    ]
    released = _held(car, 80.0 * _PER_KMH, 2.0)
    values = {
        "0-100 km/h": crossing(run.time_s, 3.6 * run.speed_mps, 100.0),
        "shift reversals at a constant pedal": float(sum(reversals(gear) for gear in gears)),
        "deceleration with the pedals released, 80 km/h": -_mean_g(released, slice(50, 150)),
    }
    curves = (
        Curve("time / s", "speed / (km/h)", run.time_s, 3.6 * run.speed_mps),
        Curve("time / s", "engine or motor / rpm", run.time_s, run.column("engine_rpm")),
    )
    return Measured(values, curves)


def part_throttle(car: Parameters) -> Measured:
    """A launch whose pedal opens to 0.2 within 5 s, cruising at 120 km/h, and coasting from it."""
    time_s = 0.01 * np.arange(1500)
    opening = 0.2 * np.clip(time_s / 5.0, 0.0, 1.0)
    run = replay(car, 0.0, input_table(len(time_s), opening), 0.01)
    v0_mps = 120.0 * _PER_KMH
    throttle = cruising_throttle(car, v0_mps)
    cruise = _held(car, v0_mps, 2.0, throttle=throttle)
    coast = _held(car, v0_mps, 40.0)
    # From 100 km/h the engine passes this speed in the highest gear, with the throttle open.
    open_ = _held(car, 100.0 * _PER_KMH, 30.0, throttle=0.2)
    torque_s = crossing(open_.time_s, open_.column("engine_rpm"), 2390.0)
    # Before 3 s the car rises from its brakes, after 10 s it changes gear at a constant pedal.
    among = (run.time_s >= 3.0) & (run.time_s < 10.0)
    values = {
        f"0-{kmh:.0f} km/h in the launch": crossing(run.time_s, 3.6 * run.speed_mps, kmh)
        for kmh in (20.0, 40.0, 60.0)
    } | {
        "pitch in the launch": -slope(
            run.column("ax_mps2") / GRAVITY_MPS2, np.degrees(run.column("pitch_rad")), among
        ),
        "torque at 2390 rpm, throttle 0.2": float(
            np.interp(torque_s, open_.time_s, open_.column("engine_nm"))
        ),
        "throttle at 120 km/h": throttle,
        "engine torque at 120 km/h": float(cruise.column("engine_nm")[-1]),
        "engine speed at 120 km/h": float(cruise.column("engine_rpm")[-1]),
        "coast-down from 120 to 80 km/h": crossing(coast.time_s, -3.6 * coast.speed_mps, -80.0),
    }
    return Measured(values)


def sines(car: Parameters) -> Measured:
    """Frequency response at small angles of the steering wheel: 80 and 50 km/h."""
    values: dict[str, float] = {}
    for kmh, steer_deg in ((80, 15.0), (50, 20.0)):
        yaw, lateral, roll = np.array([_response(car, kmh, steer_deg, f) for f in _SINES_HZ]).T
        for hz, y, a, r in zip(_SINES_HZ, yaw, lateral, roll, strict=True):
            at = f"at {hz} Hz, {kmh} km/h"
            values |= {
                f"yaw gain {at}": abs(y),
                f"yaw phase {at}": float(np.degrees(np.angle(y))),
                f"yaw phase {at}, against a single-track model": float(np.degrees(np.angle(y))),
                f"lateral gain {at}": 100.0 * abs(a),
                f"roll {at}": abs(r),
            }
    return Measured(values)


def _response(car: Parameters, kmh: float, steer_deg: float, hz: float) -> tuple[complex, ...]:
    """Yaw rate and lateral acceleration over steering wheel, roll over lateral acceleration.

    Over three whole periods, after two periods and at least 2 s.
    """
    settling_s = max(2.0, np.ceil(2.0 * hz)) / hz
    time_s = 0.005 * np.arange(0.5, round((settling_s + 3.0 / hz) / 0.005))
    wheel_rad = radians(steer_deg) * np.sin(2.0 * pi * hz * time_s)
    v0_mps = kmh * _PER_KMH
    inputs = input_table(len(time_s), cruising_throttle(car, v0_mps), steer_rad=wheel_rad)
    run = replay(car, v0_mps, inputs, 0.005)
    among = run.time_s >= settling_s
    t = run.time_s[among]
    # An input belongs to the middle of its period, the response to its end.
    steer = sine_in(t - 0.0025, run.steer_deg[among], hz)
    signals = run.yaw_rate_degps, run.lateral_g, run.roll_deg
    yaw, lateral, roll = (sine_in(t, y[among], hz) for y in signals)
    return yaw / steer, lateral / steer, roll / lateral


def braking_in_a_turn(car: Parameters) -> Measured:
    """After ISO 7975: R = 100 m at 80 km/h, steering held; pedals released, 0.3 g and 0.5 g."""
    pedals_n = {
        "pedals released": 0.0,
        "0.3 g": _pedal_n(car, 0.3),
        "0.5 g": _pedal_n(car, 0.5),
    }
    values: dict[str, float] = {}
    curves = []
    for name, brake_n in pedals_n.items():
        run = _turn(car, brake_n)
        begin = round(_STEADY_S / run.period_s)
        yaw_rate = run.yaw_rate_degps[begin:]
        one_s_later = round(1.0 / run.period_s)
        is_moving = run.speed_mps[begin:] > 5.0
        values |= {
            f"yaw rate after 1 s over that before, {name}": yaw_rate[one_s_later] / yaw_rate[0],
            f"largest sideslip, {name}": peak(run.sideslip_deg[begin:][is_moving]),
        }
        time_s = run.time_s[begin:] - _STEADY_S
        curves.append(Curve("time / s", "yaw rate / (deg/s)", time_s, yaw_rate, name))
        curves.append(Curve("time / s", "sideslip / deg", time_s, run.sideslip_deg[begin:], name))
    return Measured(values, tuple(curves))


def _turn(car: Parameters, brake_n: float) -> Run:
    """15 s for a steady turn, then 4 s with steering and brake held and the throttle closed."""
    v0_mps, period_s = 80.0 * _PER_KMH, 0.025
    speed = SpeedControl(v0_mps, cruising_throttle(car, v0_mps), period_s)
    steer_rad = car.steering.ratio * _wheelbase_m(car) / 100.0

    def driver(now: Observation) -> ControlInput:
        nonlocal steer_rad
        if now.time_s >= _STEADY_S - 0.5 * period_s:
            return ControlInput(0.0, brake_n, steer_rad)
        steer_rad += 10.0 * period_s * (v0_mps / 100.0 - now.yaw_rate_radps)
        return ControlInput(speed.throttle(now.vx_mps), 0.0, steer_rad)

    return run_driver(car, v0_mps, driver, _STEADY_S + 4.0, period_s)


def split_friction(car: Parameters) -> Measured:
    """Braking with 3.8 m/s^2 and with the full pedal from 80 km/h, hands fixed.

    Friction 0.85 under the left wheels and 0.3 under the right ones.
    """
    split = with_road_friction(car, 0.85, 0.3)
    run, full = (
        _held(split, 80.0 * _PER_KMH, 2.0, brake_n=pedal_n)
        for pedal_n in (_pedal_n(split, 3.8 / GRAVITY_MPS2), _FULL_PEDAL_N)
    )
    values = {
        "yaw rate after 1 s": float(run.yaw_rate_degps[100]),
        "lateral offset after 1 s": float(run.y_m[100]),
        "largest sideslip within 2 s": peak(run.sideslip_deg),
        "largest sideslip within 2 s, full pedal": peak(full.sideslip_deg),
    }
    return Measured(values)


def cross_wind(car: Parameters) -> Measured:
    """After ISO 12021: 20 m/s from the left at 100 km/h, from one moment on, hands fixed."""
    v0_mps = 100.0 * _PER_KMH
    throttle = cruising_throttle(car, v0_mps)
    windy = np.tile(car.road._replace(wind_left_mps=-20.0), (200, 1))
    run = replay(car, v0_mps, input_table(200, throttle), 0.01, roads=windy)
    values = {
        "lateral deviation after 2 s": float(run.y_m[-1]),
        "peak yaw rate": peak(run.yaw_rate_degps),
    }
    return Measured(values)


def standstill(car: Parameters) -> Measured:
    """Loads, a stop from 60 km/h, walking pace, a standing car, and a grade of 20 %."""
    at_rest = _held(car, 0.0, 2.0, brake_n=150.0)
    stop = _held(car, 60.0 * _PER_KMH, 6.0, brake_n=_FULL_PEDAL_N)
    walking = [_walking_share(car, angle_deg) for angle_deg in (60.0, 200.0, 400.0)]
    turning_rad = radians(180.0) * np.linspace(0.0, 1.0, 80)
    parking = replay(car, 0.0, input_table(80, brake_n=_FULL_PEDAL_N, steer_rad=turning_rad), 0.025)
    slope_ = car._replace(road=car.road._replace(grade_rad=atan(0.2)))
    held = _held(slope_, 0.0, 20.0, brake_n=100.0)
    values = {
        "front wheel load at rest": float(np.mean(at_rest.loads_n[-1, :2])),
        "rear wheel load at rest": float(np.mean(at_rest.loads_n[-1, 2:])),
        "speed backwards after a stop": float(np.maximum(0.0, -1e3 * stop.speed_mps.min())),
        "smallest yaw rate at walking pace": float(np.min(walking)),
        "largest yaw rate at walking pace": float(np.max(walking)),
        "torque about the kingpins at standstill": float(
            parking.column("steering_wheel_nm")[-1] * car.steering.ratio - car.steering.friction_nm
        ),
        "creep in 10 s with the brake on a grade of 20 %": 1e3 * float(np.ptp(held.x_m[-1000:])),
    }
    return Measured(values)


def _walking_share(car: Parameters, angle_deg: float) -> float:
    """Yaw rate at 1.5 m/s in % of that of a car whose wheels do not slip."""
    steer_rad = radians(angle_deg) * np.minimum(1.0, np.arange(240) / 60)
    run = replay(car, 1.5, input_table(240, steer_rad=steer_rad), 0.025)
    curvature_per_m = tan(radians(angle_deg) / car.steering.ratio) / _wheelbase_m(car)
    speed_mps, _, yaw_rate_radps = run.motion[-1].tolist()
    return 100.0 * yaw_rate_radps / (speed_mps * curvature_per_m) if speed_mps > 0.0 else nan


def _held(
    car: Parameters,
    v0_mps: float,
    duration_s: float,
    throttle: float = 0.0,
    brake_n: float = 0.0,
    period_s: float = 0.01,
) -> Run:
    """Straight ahead with constant pedals."""
    return replay(
        car, v0_mps, input_table(round(duration_s / period_s), throttle, brake_n), period_s
    )


def _pedal_n(car: Parameters, deceleration_g: float) -> float:
    """Pedal force that brakes from 80 km/h so after about 1.2 s, else that which brakes hardest."""
    runs = [_held(car, 80.0 * _PER_KMH, 1.5, brake_n=n) for n in _PEDALS_N.tolist()]
    reached_g = np.array([-_mean_g(run, slice(100, None)) for run in runs])
    pedal_n = crossing(_PEDALS_N, reached_g, deceleration_g)
    return pedal_n if isfinite(pedal_n) else float(_PEDALS_N[np.argmax(reached_g)])


def _mean_g(run: Run, among: slice) -> float:
    return float(np.mean(run.column("ax_mps2")[among])) / GRAVITY_MPS2


def _stop_m(run: Run) -> float:
    """Way to a stop; NaN if the car still moves at the end."""
    return float(run.x_m.max()) if run.speed_mps[-1] < 0.1 else nan


def _wheelbase_m(car: Parameters) -> float:
    return car.body.front_axle_m + car.body.rear_axle_m


Manoeuvre = Callable[[Parameters], Measured]
MANOEUVRES: dict[str, Manoeuvre] = {
    one.__name__: one
    for one in (
        equations,
        slow_steer,
        lane_change,
        ramps,
        step_steer,
        sine_with_dwell,
        braking,
        acceleration,
        sines,
        part_throttle,
        braking_in_a_turn,
        split_friction,
        cross_wind,
        standstill,
    )
}
"""by the name that the table uses"""
