"""All tests driven and measured, with the lines of the acceptance table."""

from dataclasses import dataclass

import numpy as np

from sim_bridge.plant.parameters import load_parameters
from sim_bridge.plant.shipped_cars import DEFAULT_CAR
from sim_bridge.plant.tyre_file import NO_TYRE_FILE
from sim_bridge.validation import (
    cornering,
    cross_check,
    dwell,
    frequency,
    lane_change,
    longitudinal,
    numerics,
    part_throttle,
    ride,
    standstill,
    transients,
)
from sim_bridge.validation.acceptance import LineResult, check
from sim_bridge.validation.run import Run

# The cars that the targets of tests 3, 4, 9 and 10 belong to; the others are for the default car.
FRONT_WHEEL = "c_class_125kw_fwd"
COMMONROAD = "commonroad_vehicle_2"
_FREQUENCIES_HZ = np.linspace(0.2, 2.0, 19)
_QUICK_HZ = np.delete(_FREQUENCIES_HZ, (1, 2, 3))
"""slow sines take long: of those below 0.6 Hz one is left"""


@dataclass(frozen=True, slots=True)
class Measurements:
    """The runs that are drawn, and every line of the table, in its order."""

    results: list[LineResult]
    cornering: Run
    lane_change: Run
    turns: tuple[tuple[cross_check.Turn, cross_check.Turn], ...]
    """of the plant and of the reference model; empty without test 4"""
    steps: tuple[transients.Step, ...]
    dwell: tuple[dwell.Dwell, ...]
    braking: Run
    full_throttle: Run
    """from rest"""
    responses: tuple[frequency.Responses, frequency.Responses]
    """at 80 and 50 km/h"""
    launch: Run
    coasting: Run
    swings: tuple[ride.Swing, ride.Swing]
    """heave and roll"""
    stop: Run
    """with locked wheels"""


def measure_all(car: str | None = None, quick: bool = False) -> Measurements:
    """Drive all tests with `car`, or each with the car that its targets belong to.

    Only its own car can drive test 4. `quick` leaves out the slowest sines; all lines remain.

    Raises:
        ConfigError: there is no such car.
        MissingExtraError: the reference model of test 4 is not installed.
    """
    main_car, front_car = car or DEFAULT_CAR, car or FRONT_WHEEL
    cars = [main_car, front_car]
    turns: tuple[tuple[cross_check.Turn, cross_check.Turn], ...] = ()
    if car in (None, COMMONROAD):
        cars.append(COMMONROAD)
        turns, turn_values, reference_values = cross_check.measure(load_parameters(COMMONROAD))
    main = load_parameters(main_car)
    cornered, cornering_values = cornering.measure(main)
    front = load_parameters(front_car)
    changed, change_values = lane_change.measure(front)
    steps, step_values = transients.measure(main)
    dwelt, dwell_values = dwell.measure(main, cornering_values[cornering.WHEEL_ANGLE])
    braking, full_throttle, longitudinal_values = longitudinal.measure(main)
    responses, frequency_values = frequency.measure(main, _QUICK_HZ if quick else _FREQUENCIES_HZ)
    launch, coasting, throttle_values = part_throttle.measure(front)
    front_cornered = cornered if main_car == front_car else cornering.measure(front)[0]
    swings, ride_values = ride.measure(front, front_cornered)
    stop, standstill_values = standstill.measure(main)
    results: list[LineResult] = []
    for one in dict.fromkeys(cars):
        results += check(1, numerics.measure(load_parameters(one)), one, is_main=one == main_car)
    results += check(2, cornering_values, main_car)
    results += check(3, change_values, front_car)
    if turns:
        results += check(4, turn_values, COMMONROAD, reference_values)
    results += check(5, step_values, main_car)
    results += check(6, dwell_values, main_car)
    results += check(7, longitudinal_values, main_car)
    results += check(8, frequency_values, main_car)
    results += check(9, throttle_values, front_car)
    results += check(10, ride_values, front_car)
    has_tyre_file = main.tyre_file != NO_TYRE_FILE
    results += check(11, standstill_values, main_car, has_tyre_file=has_tyre_file)
    return Measurements(
        results,
        cornered,
        changed,
        turns,
        steps,
        dwelt,
        braking,
        full_throttle,
        responses,
        launch,
        coasting,
        swings,
        stop,
    )
