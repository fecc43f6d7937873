"""The motion as the mapping declares it, compared with that of road vehicles.

A single log has no other log to compare with. But units fix how fast its car is, how hard it
accelerates, how long its wheelbase is. If one of these is unusual, and all would be usual with one
unit corrected, then this unit is probably wrong.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi
from typing import NamedTuple

import numpy as np

from offline.logs.checks.issue import Issue
from offline.logs.checks.pairs import slope
from offline.logs.checks.sideslip import fit_rear_axle
from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from rt_controller.contract.arrays import Array
from rt_controller.mapping.quantity import Quantity, si_unit_of_name
from rt_controller.mapping.units import find_unit

LEAST_SPEED_MPS = 3.0
SMALL_LATERAL_MPS2 = 4.0
"""below, the tyres are linear and the wheelbase is visible in the steering"""
LEAST_CORRELATION = 0.8
LARGEST_ERROR = 0.15
"""standard error of speed times steering over yaw rate, as a share of it"""
LEAST_CHARACTERISTIC_MPS = 15.0
"""speed at which understeer doubles the steering of a very understeering car"""
_SAMPLES_PER_INDEPENDENT = 40
"""neighbouring samples have the same disturbance"""
_SLOPE_S, _SIDESLIP_S = 0.5, 0.2
"""times over which derivatives are taken"""
_PEAK = 0.999
"""quantile that stands for the largest value"""
GEOMETRY_TOLERANCE = 0.3
"""of the wheelbase that is fitted, where [car] gives it"""


TURNING_NAME = "speed times steering over yaw rate"
TIME_SCALE_NAME = "time scale of the sideslip"


class Range(NamedTuple):
    """Values that are usual for a road vehicle."""

    low: float
    high: float


TOP_SPEED_MPS = Range(0.0, 85.0)
ACCELERATION_MPS2 = Range(0.02, 13.0)
LATERAL_MPS2 = Range(0.0, 14.0)
POWER_WPKG = Range(0.02, 350.0)
"""speed times acceleration: power over mass"""
MASS_KG = Range(200.0, 4e4)
ROAD_WHEEL_M = Range(1.3, 5.5)
"""wheelbase"""
STEERING_WHEEL_M = Range(18.0, 100.0)
"""wheelbase times steering ratio"""
REAR_AXLE_M = Range(0.3, 3.0)
TIME_SCALE = Range(0.65, 1.4)


@dataclass(frozen=True, slots=True)
class Measure:
    """A quantity of the motion that units fix."""

    name: str
    unit: str
    value: float
    low: float
    """of road vehicles"""
    high: float

    @property
    def is_usual(self) -> bool:
        """True within the range of road vehicles."""
        return self.low <= self.value <= self.high


@dataclass(frozen=True, slots=True)
class _Motion:
    """The signals of all episodes, or None."""

    dt_s: float
    speed: list[Array]
    side: list[Array] | None
    yaw_rate: list[Array] | None
    steer: list[Array] | None
    force: list[Array] | None
    """longitudinal, in N"""
    turning_m: Range
    """of speed times steering over yaw rate"""
    reach: int
    """samples to both sides for the slope of the speed"""
    sideslip_reach: int

    def scaled(self, **factors: float) -> "_Motion":
        """The motion with these signals, or the period, times a factor."""
        changed = {name: getattr(self, name) for name in self.__slots__}
        for name, factor in factors.items():
            own = changed[name]
            if isinstance(own, list):
                changed[name] = [factor * values for values in own]
            elif own is not None:
                changed[name] = factor * own
        return _Motion(**changed)


_DEGREE = pi / 180.0
_MISTAKES: dict[str, dict[str, float]] = {
    "speed in km/h taken for m/s": {"speed": 1 / 3.6},
    "both speeds in km/h taken for m/s": {"speed": 1 / 3.6, "side": 1 / 3.6},
    "speed in m/s taken for km/h": {"speed": 3.6},
    "both speeds in m/s taken for km/h": {"speed": 3.6, "side": 3.6},
    "both speeds in mph taken for m/s": {"speed": 0.44704, "side": 0.44704},
    "steering angle in degrees taken for radians": {"steer": _DEGREE},
    "steering angle in radians taken for degrees": {"steer": 1 / _DEGREE},
    "yaw rate in degrees taken for radians": {"yaw_rate": _DEGREE},
    "yaw rate in radians taken for degrees": {"yaw_rate": 1 / _DEGREE},
    "force in kN taken for N": {"force": 1e3},
    "force in N taken for kN": {"force": 1e-3},
    "times too long by a factor of 2": {"dt_s": 0.5},
    "times too short by a factor of 2": {"dt_s": 2.0},
    "times too long by a factor of 10": {"dt_s": 0.1},
    "times too short by a factor of 10": {"dt_s": 10.0},
    "times in ms taken for s": {"dt_s": 1e-3},
}
"""wrong units and periods, with the factors that correct them"""


def check_motion(
    episodes: Sequence[LogEpisode], mapping: LogMapping
) -> tuple[list[Measure], list[Issue], list[Issue]]:
    """The measures, units that are probably wrong, and unusual values without such a reason."""
    motion = _motion_of(episodes, mapping)
    if motion is None:
        return [], [], []
    measures = list(_measures(motion))
    unusual = [each for each in measures if not each.is_usual]
    if not unusual:
        return measures, [], []
    listed = "; ".join(
        f"{each.name} {each.value:.4g} {each.unit}, usual {each.low:g} to {each.high:g}"
        for each in unusual
    )
    reasons = [words for words, factors in _MISTAKES.items() if _explains(motion, factors)]
    subject = mapping.name_of(Quantity.SPEED) or ""
    if reasons:
        message = (
            f"the motion is not that of a road vehicle ({listed}), but would be with one unit "
            f"corrected: {', or '.join(reasons)}? Correct the mapping"
        )
        return measures, [Issue("units", subject, message)], []
    return measures, [], [Issue("motion", subject, f"unusual for a road vehicle: {listed}")]


def _explains(motion: _Motion, factors: dict[str, float]) -> bool:
    """True if all measures are usual with these corrections of signals that the log has."""
    if any(getattr(motion, name) is None for name in factors):
        return False
    return all(each.is_usual for each in _measures(motion.scaled(**factors)))


def _motion_of(episodes: Sequence[LogEpisode], mapping: LogMapping) -> _Motion | None:
    """The signals that the measures use; None without a speed, or if the car stands."""

    def signals(quantity: Quantity) -> list[Array] | None:
        name = mapping.name_of(quantity)
        return [e.signals[name].to_numpy() for e in episodes] if name else None

    speed = signals(Quantity.SPEED)
    if speed is None or not any(np.any(v >= LEAST_SPEED_MPS) for v in speed):
        return None
    drive, steer = mapping.name_of(Quantity.DRIVE), mapping.name_of(Quantity.STEERING)
    is_force = drive is not None and _unit_of(drive, mapping) == "N"
    return _Motion(
        mapping.period_s,
        speed,
        signals(Quantity.LATERAL_SPEED),
        signals(Quantity.YAW_RATE),
        signals(Quantity.STEERING),
        signals(Quantity.DRIVE) if is_force else None,
        _turning_range(mapping, steer),
        *(max(1, round(0.5 * each_s / mapping.period_s)) for each_s in (_SLOPE_S, _SIDESLIP_S)),
    )


def has_known_geometry(mapping: LogMapping) -> bool:
    """True if the mapping tells what speed times steering over yaw rate has to be."""
    steer = mapping.name_of(Quantity.STEERING)
    return steer == "road_wheel_rad" or (steer == "steer_rad" and mapping.car is not None)


def _turning_range(mapping: LogMapping, steer: str | None) -> Range:
    """Usual speed times steering over yaw rate, for the angle that the signal measures."""
    is_wheel, is_road_wheel = steer == "steer_rad", steer == "road_wheel_rad"
    if mapping.car and (is_wheel or is_road_wheel):
        ratio = mapping.car.steering_ratio if is_wheel else 1.0
        length_m, slack = ratio * mapping.car.wheelbase_m, 1.0 + GEOMETRY_TOLERANCE
        return Range(length_m / slack, length_m * slack)
    if is_road_wheel:
        return ROAD_WHEEL_M
    return STEERING_WHEEL_M if is_wheel else Range(ROAD_WHEEL_M.low, STEERING_WHEEL_M.high)


def _measures(motion: _Motion) -> Iterator[Measure]:
    """Everything that the signals determine."""
    speed = np.concatenate(motion.speed)
    gained = np.concatenate([slope(v, motion.dt_s, motion.reach) for v in motion.speed])
    yield Measure("top speed", "m/s", _peak(speed), *TOP_SPEED_MPS)
    yield Measure("acceleration", "m/s^2", _peak(np.abs(gained)), *ACCELERATION_MPS2)
    yield Measure("power over mass", "W/kg", _peak(speed * gained), *POWER_WPKG)
    if motion.force:
        force = np.concatenate(motion.force)
        if _correlation(force, gained) >= LEAST_CORRELATION:
            yield Measure("mass", "kg", float(force @ force / (force @ gained)), *MASS_KG)
    if not motion.yaw_rate:
        return
    yaw_rate = np.concatenate(motion.yaw_rate)
    lateral = speed * yaw_rate
    yield Measure("lateral acceleration", "m/s^2", _peak(np.abs(lateral)), *LATERAL_MPS2)
    if motion.steer:
        turning = _turning(speed, np.concatenate(motion.steer), yaw_rate, motion.turning_m)
        if turning:
            yield turning
    if motion.side:
        speed_and_side = (motion.speed, motion.side)
        rear = fit_rear_axle(*speed_and_side, motion.yaw_rate, motion.dt_s, motion.sideslip_reach)
        if rear:
            low, high = rear.time_scale_range
            yield Measure("centre of gravity to rear axle", "m", rear.distance_m, *REAR_AXLE_M)
            yield Measure(TIME_SCALE_NAME, "1", min(max(1.0, low), high), *TIME_SCALE)


def _turning(speed: Array, steer: Array, yaw_rate: Array, usual: Range) -> Measure | None:
    """Speed times steering over yaw rate at small lateral acceleration; None if they do not fit.

    It grows with the square of the speed if the car understeers. Where few speeds or few bends do
    not separate this part, it is included, and the usual range is wider.
    """
    is_linear = (speed >= LEAST_SPEED_MPS) & (np.abs(speed * yaw_rate) < SMALL_LATERAL_MPS2)
    v, turned, r = speed[is_linear], (speed * steer)[is_linear], yaw_rate[is_linear]
    if len(v) < len(speed) // 10:
        return None
    length_m = _fitted_length(turned, np.stack([r, v, v * v * r], axis=1), LARGEST_ERROR)
    if length_m is not None:
        return Measure(TURNING_NAME, "m", length_m, *usual)
    length_m = _fitted_length(turned, np.stack([r, v], axis=1), float("inf"))
    if length_m is None:
        return None
    understeer = 1.0 + float(np.mean(v * v)) / LEAST_CHARACTERISTIC_MPS**2
    name = f"{TURNING_NAME}, with understeer"
    return Measure(name, "m", length_m, usual.low, usual.high * understeer)


def _fitted_length(turned: Array, terms: Array, largest_error: float) -> float | None:
    """Factor of the first term; the second one is an offset of the angle. None if it is vague."""
    products = terms.T @ terms
    if np.linalg.matrix_rank(products) < len(products):
        return None
    factors = np.linalg.solve(products, terms.T @ turned)
    turning = terms @ factors - factors[1] * terms[:, 1]
    rest = turned - terms @ factors
    variance = _SAMPLES_PER_INDEPENDENT * float(rest @ rest) / len(rest)
    error_m = (variance * float(np.linalg.inv(products)[0, 0])) ** 0.5
    fits = _correlation(turned - factors[1] * terms[:, 1], turning) >= LEAST_CORRELATION
    length_m = float(factors[0])
    return length_m if fits and error_m <= largest_error * abs(length_m) else None


def _correlation(one: Array, other: Array) -> float:
    power = float(one @ one * (other @ other))
    return float(one @ other) / power**0.5 if power > 0.0 else 0.0


def _peak(values: Array) -> float:
    return float(np.quantile(values, _PEAK))


def _unit_of(name: str, mapping: LogMapping) -> str | None:
    """SI unit of a signal, as far as the mapping tells it."""
    given = mapping.signals[name].unit
    unit = find_unit(given) if given else None
    return unit.si if unit else si_unit_of_name(name)
