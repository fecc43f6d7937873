"""All tests driven and measured, with the lines of the acceptance table."""

from dataclasses import dataclass

import numpy as np

from sim_bridge.plant.parameters import DEFAULT_CAR, load_parameters
from sim_bridge.validation import (
    cornering,
    cross_check,
    dwell,
    lane_change,
    longitudinal,
    numerics,
    transients,
)
from sim_bridge.validation.acceptance import LineResult, check
from sim_bridge.validation.run import Run

# The cars that the targets of tests 3 and 4 belong to; the others belong to the default car.
FRONT_WHEEL = "c_class_125kw_fwd"
COMMONROAD = "commonroad_vehicle_2"
_FREQUENCIES_HZ = np.linspace(0.2, 2.0, 19)
_QUICK_FROM = 4
"""slow sines take long: the quick sweep begins at 0.6 Hz"""


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


def measure_all(car: str | None = None, quick: bool = False) -> Measurements:
    """Drive all tests with `car`, or each with the car that its targets belong to.

    Only its own car can drive test 4. `quick` leaves out the slowest sines; all lines remain.

    Raises:
        ConfigError: there is no such car.
        MissingExtraError: the reference model of test 4 is not installed.
    """
    main_car, lane_change_car = car or DEFAULT_CAR, car or FRONT_WHEEL
    cars = [main_car, lane_change_car]
    turns: tuple[tuple[cross_check.Turn, cross_check.Turn], ...] = ()
    if car in (None, COMMONROAD):
        cars.append(COMMONROAD)
        turns, turn_values, reference_values = cross_check.measure(load_parameters(COMMONROAD))
    main = load_parameters(main_car)
    cornered, cornering_values = cornering.measure(main)
    changed, change_values = lane_change.measure(load_parameters(lane_change_car))
    frequency_hz = _FREQUENCIES_HZ[_QUICK_FROM if quick else 0 :]
    transient, transient_values = transients.measure(main, frequency_hz)
    dwelt, dwell_values = dwell.measure(main, cornering_values[cornering.WHEEL_ANGLE])
    braking, full_throttle, longitudinal_values = longitudinal.measure(main)
    results: list[LineResult] = []
    for one in dict.fromkeys(cars):
        results += check(1, numerics.measure(load_parameters(one)), one, is_main=one == main_car)
    results += check(2, cornering_values, main_car)
    results += check(3, change_values, lane_change_car)
    if turns:
        results += check(4, turn_values, COMMONROAD, reference_values)
    results += check(5, transient_values, main_car)
    results += check(6, dwell_values, main_car)
    results += check(7, longitudinal_values, main_car)
    return Measurements(results, cornered, changed, turns, transient, dwelt, braking, full_throttle)
