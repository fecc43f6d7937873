"""All tests driven and measured, with the lines of the acceptance table."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim_bridge.plant.parameters import load_parameters
from sim_bridge.validation import (
    cornering,
    cross_check,
    dwell,
    lane_change,
    longitudinal,
    numerics,
    transients,
)
from sim_bridge.validation.acceptance import (
    ALL_WHEEL,
    COMMONROAD,
    FRONT_WHEEL,
    Line,
    LineResult,
    check,
)
from sim_bridge.validation.run import Run

_FREQUENCIES_HZ = np.linspace(0.2, 2.0, 19)
_QUICK_FROM = 4
"""slow sines take long: the quick sweep begins at 0.6 Hz"""


class CarsOfTests(NamedTuple):
    """The car for each group of tests, by name; None leaves the group out."""

    main: str
    lane_change: str
    cross_check: str | None

    @property
    def names(self) -> tuple[str, ...]:
        """Each car once."""
        return tuple(dict.fromkeys(name for name in self if name is not None))


def cars_of_tests(car: str | None) -> CarsOfTests:
    """The cars that the targets belong to, or one car for all tests that it can drive."""
    if car is None:
        return CarsOfTests(ALL_WHEEL, FRONT_WHEEL, COMMONROAD)
    return CarsOfTests(car, car, car if car == COMMONROAD else None)


@dataclass(frozen=True, slots=True)
class Measurements:
    """The runs that are drawn, and every line of the table, in its order."""

    results: list[LineResult]
    cornering: Run
    lane_change: Run
    turns: tuple[tuple[cross_check.Turn, cross_check.Turn], ...]
    """of the plant and of the reference model; empty without test 4"""
    transients: transients.Transients
    dwell: tuple[dwell.Dwell, ...]
    braking: Run
    full_throttle: Run
    """from rest"""


def measure_all(cars: CarsOfTests, quick: bool = False) -> Measurements:
    """Drive all tests; `quick` leaves out the slowest sines, all lines of the table remain.

    Raises:
        ConfigError: there is no such car.
        MissingExtraError: the reference model of test 4 is not installed.
    """
    main = load_parameters(cars.main)
    turns: tuple[tuple[cross_check.Turn, cross_check.Turn], ...] = ()
    turn_lines: tuple[Line, ...] = ()
    if cars.cross_check is not None:
        turns, turn_lines = cross_check.measure(load_parameters(cars.cross_check))
    cornered, cornering_lines = cornering.measure(main)
    changed, change_lines = lane_change.measure(load_parameters(cars.lane_change))
    transient = transients.measure(main, _FREQUENCIES_HZ[_QUICK_FROM if quick else 0 :])
    angle_deg = next(line.reached for line in cornering_lines if line.name == cornering.WHEEL_ANGLE)
    dwelt, dwell_lines = dwell.measure(main, angle_deg)
    braking, full_throttle, longitudinal_lines = longitudinal.measure(main)
    results: list[LineResult] = []
    for car in cars.names:
        lines = numerics.measure(load_parameters(car))
        of_car = [line for line in lines if line.car is None or car == cars.main]
        results += check(1, of_car, car)
    results += check(2, cornering_lines, cars.main)
    results += check(3, change_lines, cars.lane_change)
    results += check(4, turn_lines, cars.cross_check or "")
    results += check(5, transients.lines_of(transient), cars.main)
    results += check(6, dwell_lines, cars.main)
    results += check(7, longitudinal_lines, cars.main)
    return Measurements(results, cornered, changed, turns, transient, dwelt, braking, full_throttle)
