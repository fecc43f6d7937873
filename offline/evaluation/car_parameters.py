"""`FITTED`: the numbers of a simulated car that recorded drives can tell, and how each is changed.

Each is one value with a unit that stands for one or several fields of the car file. Most are fitted
as the logarithm of their factor, so that no step makes them negative; values that may be zero are
fitted as they are, in units of `scale`.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import SteeringGeometry
from sim_bridge.plant.parameters import Parameters, with_mass_factor


@dataclass(frozen=True, slots=True)
class Fitted:
    """One number of the car."""

    name: str
    """with its unit; a number without one is dimensionless"""
    of: Callable[[Parameters], float]
    put: Callable[[Parameters, float], Parameters]
    """the car with that value"""
    low: float
    high: float
    """bounds; those of a factor of the base car's value where `scale` is 0"""
    scale: float = 0.0
    """step of a value that may be zero"""
    needs: str = ""
    """part of the car without which the number has no meaning"""

    def coordinate(self, base: Parameters, value: float) -> float:
        """The value as the solver sees it; 0 is that of the base car."""
        first = self.of(base)
        return (value - first) / self.scale if self.scale else log(value / first)

    def value(self, base: Parameters, coordinate: float) -> float:
        """The inverse of `coordinate`."""
        first = self.of(base)
        return first + self.scale * coordinate if self.scale else first * exp(coordinate)

    def bounds(self, base: Parameters) -> tuple[float, float]:
        """Lowest and highest coordinate."""
        factor = 1.0 if self.scale else self.of(base)
        low, high = (self.coordinate(base, factor * each) for each in (self.low, self.high))
        return low, high


def _field(
    part: str, name: str, low: float, high: float, scale: float = 0.0, needs: str = ""
) -> Fitted:
    """A field of the car file."""

    def put(car: Parameters, value: float) -> Parameters:
        return car._replace(**{part: getattr(car, part)._replace(**{name: value})})

    def of(car: Parameters) -> float:
        return float(getattr(getattr(car, part), name))

    return Fitted(f"{part}.{name}", of, put, low, high, scale, needs)


def _steering_lag_s(car: Parameters) -> float:
    return car.steering.damping_nms / car.steering.stiffness_nmprad


def _with_steering_lag(car: Parameters, lag_s: float) -> Parameters:
    """Damping and inertia together: the steps of the integration stay stable."""
    steering, factor = car.steering, lag_s / _steering_lag_s(car)
    steering = steering._replace(
        damping_nms=factor * steering.damping_nms, inertia_kgm2=factor * steering.inertia_kgm2
    )
    return car._replace(steering=steering)


def drive_part(car: Parameters) -> str:
    """Name of the part that drives the car."""
    return "motor" if car.motor.inertia_kgm2 > 0.0 else "engine"


def _map_nm(car: Parameters) -> Array:
    return np.array(getattr(car, drive_part(car)).map_nm)


def _with_map(car: Parameters, map_nm: Array) -> Parameters:
    part = drive_part(car)
    rows = tuple(tuple(row) for row in map_nm.tolist())
    return car._replace(**{part: getattr(car, part)._replace(map_nm=rows)})


def _torque(name: str, sign: float, low: float, high: float) -> Fitted:
    """Largest torque of the map that drives (sign 1) or brakes (-1); its others in proportion."""

    def of(car: Parameters) -> float:
        return float((sign * _map_nm(car)).max())

    def put(car: Parameters, torque_nm: float) -> Parameters:
        torques_nm, factor = _map_nm(car), torque_nm / of(car)
        return _with_map(car, np.where(sign * torques_nm > 0.0, factor * torques_nm, torques_nm))

    return Fitted(name, of, put, low, high)


def _pedal(
    name: str,
    value: float,
    warp: Callable[[Array, float], Array],
    low: float,
    high: float,
    scale: float = 0.0,
) -> Fitted:
    """A change of the pedal: it acts as the position `warp` of that of the base car."""

    def put(car: Parameters, value: float) -> Parameters:
        pedals = np.array(getattr(car, drive_part(car)).map_throttles)
        columns = [np.interp(warp(pedals, value), pedals, column) for column in _map_nm(car).T]
        return _with_map(car, np.transpose(columns))

    return Fitted(name, lambda car: value, put, low, high, scale)


def _with_motor_speeds(car: Parameters, factor: float) -> Parameters:
    speeds_rpm = tuple(factor * each for each in car.motor.map_speeds_rpm)
    return car._replace(motor=car.motor._replace(map_speeds_rpm=speeds_rpm))


FITTED: tuple[Fitted, ...] = (
    _field("steering", "ratio", 0.4, 2.5),
    Fitted("steering_lag_s", _steering_lag_s, _with_steering_lag, 0.004, 0.25, scale=0.02),
    _field("tyre", "cornering_stiffness_npr", 0.3, 4.0),
    _field("suspension", "lateral_steer_front_radpn", -8e-6, 8e-6, scale=1e-6),
    _field("suspension", "roll_steer_rear", -0.6, 0.6, scale=0.1),
    _field("tyre", "lateral_friction", 0.5, 2.0),
    _field("tyre", "lateral_relaxation_m", 0.06, 2.5, scale=0.3),
    _field("body", "yaw_inertia_kgm2", 0.5, 2.0),
    _field("aero", "drag", 0.2, 5.0),
    _field("tyre", "rolling_resistance", 0.1, 8.0),
    _torque("drive_torque_nm", 1.0, 0.2, 5.0),
    _pedal("pedal_start", 0.0, lambda pedals, v: v + (1.0 - v) * pedals, -0.25, 0.25, scale=0.1),
    _pedal("pedal_exponent", 1.0, lambda pedals, v: pedals**v, 0.4, 2.5),
    Fitted("motor_speed_factor", lambda car: 1.0, _with_motor_speeds, 0.3, 3.0, needs="motor"),
    _torque("released_torque_nm", -1.0, 0.1, 5.0),
    _field("engine", "throttle_lag_s", 0.01, 0.8, scale=0.05, needs="engine"),
    _field("motor", "lag_s", 0.01, 0.8, scale=0.05, needs="motor"),
    _field("brakes", "pedal_mpa_per_n", 0.2, 5.0),
    _field("brakes", "knee_mpa", 0.1, 8.0),
    _field("brakes", "lag_s", 0.01, 0.8, scale=0.05),
)
"""order in which they are put into the base car: the pedal before the torques"""


def fitted_of(base: Parameters) -> tuple[Fitted, ...]:
    """Those that this car has."""
    return tuple(each for each in FITTED if each.needs in ("", drive_part(base)))


def car_with(
    base: Parameters, parameters: Sequence[Fitted], coordinates: Iterable[float]
) -> Parameters:
    """The base car with these values."""
    car = base
    for each, coordinate in zip(parameters, coordinates, strict=True):
        if coordinate != 0.0:
            car = each.put(car, each.value(base, coordinate))
    return car


def with_stated(
    base: Parameters, mass_kg: float | None, geometry: SteeringGeometry | None
) -> Parameters:
    """The base car with the mass and the axles that are known; its sprung mass follows.

    The steering ratio of the geometry is where the fit begins.
    """
    car = base if mass_kg is None else with_mass_factor(base, mass_kg / base.body.mass_kg)
    if geometry is None:
        return car
    body, wheelbase_m = car.body, geometry.wheelbase_m
    front_m = wheelbase_m - geometry.rear_axle_m
    sprung_front_m = (
        body.mass_kg * front_m - body.unsprung_rear_kg * wheelbase_m
    ) / body.sprung_mass_kg
    body = body._replace(
        front_axle_m=front_m,
        rear_axle_m=geometry.rear_axle_m,
        sprung_front_axle_m=sprung_front_m,
        sprung_rear_axle_m=wheelbase_m - sprung_front_m,
    )
    return car._replace(body=body, steering=car.steering._replace(ratio=geometry.steering_ratio))
