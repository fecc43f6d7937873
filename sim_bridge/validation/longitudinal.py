"""Manoeuvres with the pedals, and at walking pace: each drives a car and returns values by line."""

from math import atan, isfinite, nan, radians, tan

import numpy as np

from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from sim_bridge.plant.parameters import Parameters, with_road_friction
from sim_bridge.scenario.metrics import peak
from sim_bridge.validation.driver_model import SpeedControl
from sim_bridge.validation.run import (
    PER_KMH,
    Measured,
    Observation,
    Run,
    cruising_throttle,
    input_table,
    replay,
    run_driver,
)
from sim_bridge.validation.signal_metrics import (
    crossing,
    mean_deceleration,
    rear_locked_first,
    reversals,
    slope,
)

_PEDALS_N = np.linspace(0.0, 200.0, 21)
_FULL_PEDAL_N = 400.0
_STEADY_S = 15.0


def braking(car: Parameters) -> Measured:
    """150 N at the pedal and a full braking from 100 km/h; full brakings on six frictions."""
    v0_mps = 100.0 * PER_KMH
    run = _held(car, v0_mps, 6.0, brake_n=150.0)
    full = _held(car, v0_mps, 8.0, brake_n=_FULL_PEDAL_N)
    locked = rear_first = 0
    for friction in (0.2, 0.35, 0.5, 0.7, 0.85, 1.0):
        for pedal_n in (50.0, 80.0, 110.0, 150.0, _FULL_PEDAL_N):
            one = _held(with_road_friction(car, friction), v0_mps, 4.0, brake_n=pedal_n)
            rims_mps = one.spins_radps * v0_mps / np.mean(one.spins_radps[0])
            fast = one.speed_mps > 15.0 * PER_KMH
            locked += bool((rims_mps[fast] < 0.05 * one.speed_mps[fast, None]).any())
            rear_first += rear_locked_first(rims_mps, one.speed_mps)
    has_anti_lock = car.anti_lock.slip > 0.0
    return {
        "deceleration with 150 N": mean_deceleration(run, v0_mps) / GRAVITY_MPS2,
        "stopping distance from 100 km/h, 150 N": _stop_m(run),
        "stopping distance from 100 km/h, full pedal": _stop_m(full),
        "brakings in which a wheel locks above 15 km/h": locked if has_anti_lock else nan,
        # Anti-lock with brake-force distribution decides it by construction.
        "brakings in which a rear wheel locks first": nan if has_anti_lock else rear_first,
    }


def acceleration(car: Parameters) -> Measured:
    """Full throttle from rest; five constant throttles for a minute each; the released pedal."""
    run = _held(car, 0.0, 30.0, throttle=1.0)
    gears = (
        _held(car, 0.0, 60.0, throttle=share, period_s=0.05).column("gear")
        for share in (0.1, 0.2, 0.35, 0.6, 1.0)
    )
    released = _held(car, 80.0 * PER_KMH, 2.0)
    return {
        "0-100 km/h": crossing(run.time_s, 3.6 * run.speed_mps, 100.0),
        "shift reversals at a constant pedal": float(sum(map(reversals, gears))),
        "deceleration with the pedals released, 80 km/h": -_mean_g(released, slice(50, 150)),
    }


def part_throttle(car: Parameters) -> Measured:
    """A launch whose pedal opens to 0.2 within 5 s, cruising at 120 km/h, and coasting from it."""
    opening = 0.2 * np.clip(0.01 * np.arange(1500) / 5.0, 0.0, 1.0)
    run = replay(car, 0.0, input_table(1500, opening), 0.01)
    v0_mps = 120.0 * PER_KMH
    throttle = cruising_throttle(car, v0_mps)
    cruise = _held(car, v0_mps, 2.0, throttle=throttle)
    coast = _held(car, v0_mps, 40.0)
    # From 100 km/h the engine passes this speed in the highest gear, with the throttle open.
    open_ = _held(car, 100.0 * PER_KMH, 30.0, throttle=0.2)
    torque_s = crossing(open_.time_s, open_.column("engine_rpm"), 2390.0)
    torque_nm = float(np.interp(torque_s, open_.time_s, open_.column("engine_nm")))
    # Before 3 s the car rises from its brakes, after 10 s it changes gear at a constant pedal.
    among = (run.time_s >= 3.0) & (run.time_s < 10.0)
    forward_g, pitch_deg = run.column("ax_mps2") / GRAVITY_MPS2, np.degrees(run.column("pitch_rad"))
    values = {
        f"0-{kmh:.0f} km/h in the launch": crossing(run.time_s, 3.6 * run.speed_mps, kmh)
        for kmh in (20.0, 40.0, 60.0)
    }
    values |= {
        "pitch in the launch": -slope(forward_g, pitch_deg, among),
        "torque at 2390 rpm, throttle 0.2": torque_nm,
        "throttle at 120 km/h": throttle,
        "engine torque at 120 km/h": float(cruise.column("engine_nm")[-1]),
        "engine speed at 120 km/h": float(cruise.column("engine_rpm")[-1]),
        "coast-down from 120 to 80 km/h": crossing(coast.time_s, -3.6 * coast.speed_mps, -80.0),
    }
    return values


def braking_in_a_turn(car: Parameters) -> Measured:
    """After ISO 7975: R = 100 m at 80 km/h, steering held; pedals released, 0.3 g and 0.5 g."""
    pedals_n = {"pedals released": 0.0} | {f"{g} g": _pedal_n(car, g) for g in (0.3, 0.5)}
    values: dict[str, float] = {}
    for name, brake_n in pedals_n.items():
        run = _turn(car, brake_n)
        begin, one_s_later = round(_STEADY_S / run.period_s), round(1.0 / run.period_s)
        yaw_rate = run.yaw_rate_degps[begin:]
        sideslip_deg = run.sideslip_deg[begin:]
        values |= {
            f"yaw rate after 1 s over that before, {name}": yaw_rate[one_s_later] / yaw_rate[0],
            f"largest sideslip, {name}": peak(sideslip_deg[run.speed_mps[begin:] > 5.0]),
        }
    return values


def _turn(car: Parameters, brake_n: float) -> Run:
    """15 s for a steady turn, then 4 s with steering and brake held and the throttle closed."""
    v0_mps, period_s = 80.0 * PER_KMH, 0.025
    speed = SpeedControl(v0_mps, cruising_throttle(car, v0_mps), period_s)
    steer_rad = car.steering.ratio * car.body.wheelbase_m / 100.0

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
        _held(split, 80.0 * PER_KMH, 2.0, brake_n=pedal_n)
        for pedal_n in (_pedal_n(split, 3.8 / GRAVITY_MPS2), _FULL_PEDAL_N)
    )
    return {
        "yaw rate after 1 s": float(run.yaw_rate_degps[100]),
        "lateral offset after 1 s": float(run.y_m[100]),
        "largest sideslip within 2 s": peak(run.sideslip_deg),
        "largest sideslip within 2 s, full pedal": peak(full.sideslip_deg),
    }


def standstill(car: Parameters) -> Measured:
    """Loads, a stop from 60 km/h, walking pace, a standing car, and a grade of 20 %."""
    at_rest = _held(car, 0.0, 2.0, brake_n=150.0)
    stop = _held(car, 60.0 * PER_KMH, 6.0, brake_n=_FULL_PEDAL_N)
    walking = [_walking_share(car, angle_deg) for angle_deg in (60.0, 200.0, 400.0)]
    turning_rad = radians(180.0) * np.linspace(0.0, 1.0, 80)
    parking = replay(car, 0.0, input_table(80, brake_n=_FULL_PEDAL_N, steer_rad=turning_rad), 0.025)
    wheel_nm = parking.column("steering_wheel_nm")[-1]
    uphill = car._replace(road=car.road._replace(grade_rad=atan(0.2)))
    held = _held(uphill, 0.0, 20.0, brake_n=100.0)
    creep_mm = 1e3 * float(np.ptp(held.x_m[-1000:]))
    kingpins_nm = wheel_nm * car.steering.ratio - car.steering.friction_nm
    return {
        "front wheel load at rest": float(np.mean(at_rest.loads_n[-1, :2])),
        "rear wheel load at rest": float(np.mean(at_rest.loads_n[-1, 2:])),
        "speed backwards after a stop": float(np.maximum(0.0, -1e3 * stop.speed_mps.min())),
        "smallest yaw rate at walking pace": float(np.min(walking)),
        "largest yaw rate at walking pace": float(np.max(walking)),
        "torque about the kingpins at standstill": float(kingpins_nm),
        "creep in 10 s with the brake on a grade of 20 %": creep_mm,
    }


def _walking_share(car: Parameters, angle_deg: float) -> float:
    """Yaw rate at 1.5 m/s in % of that of a car whose wheels do not slip."""
    steer_rad = radians(angle_deg) * np.minimum(1.0, np.arange(240) / 60)
    run = replay(car, 1.5, input_table(240, steer_rad=steer_rad), 0.025)
    curvature_per_m = tan(radians(angle_deg) / car.steering.ratio) / car.body.wheelbase_m
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
    inputs = input_table(round(duration_s / period_s), throttle, brake_n)
    return replay(car, v0_mps, inputs, period_s)


def _pedal_n(car: Parameters, deceleration_g: float) -> float:
    """Pedal force that brakes from 80 km/h so after about 1.2 s, else that which brakes hardest."""
    runs = [_held(car, 80.0 * PER_KMH, 1.5, brake_n=n) for n in _PEDALS_N.tolist()]
    reached_g = np.array([-_mean_g(run, slice(100, None)) for run in runs])
    pedal_n = crossing(_PEDALS_N, reached_g, deceleration_g)
    return pedal_n if isfinite(pedal_n) else float(_PEDALS_N[np.argmax(reached_g)])


def _mean_g(run: Run, among: slice) -> float:
    return float(np.mean(run.column("ax_mps2")[among])) / GRAVITY_MPS2


def _stop_m(run: Run) -> float:
    """Way to a stop; NaN if the car still moves at the end."""
    return float(run.x_m.max()) if run.speed_mps[-1] < 0.1 else nan


LONGITUDINAL = (braking, acceleration, part_throttle, braking_in_a_turn, split_friction, standstill)
