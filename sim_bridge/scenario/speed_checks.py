"""Can the wanted speed of a scenario be driven? Grip along the road, and the stops."""

from collections.abc import Iterator
from itertools import pairwise
from math import inf

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.scenario.limits import LONGEST_ROAD_M
from sim_bridge.scenario.nominal_drive import GRID_M, NominalDrive
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.scenario import Scenario
from sim_bridge.scenario.speed import STOP_WINDOW_M, Stop

_TOLERANCE_MPS2 = 1e-6
_LEAST_BRAKING_MPS2 = 0.1
LEAST_GAP_M = 2.0 * STOP_WINDOW_M
"""between two stops: a car cannot stand at both"""


def grip_mps2(road: Road, s_m: Array) -> Array:
    """The acceleration that the friction at arc lengths `s_m` can give, same shape."""
    return 0.5 * GRAVITY_MPS2 * (road.friction_left(s_m) + road.friction_right(s_m))


def speed_problems(scenario: Scenario, drive: NominalDrive) -> Iterator[str]:
    """A line for each acceleration along the road that its friction cannot give."""
    steep_mps2 = GRAVITY_MPS2 * np.abs(scenario.road.grade(drive.s_m))
    grip = grip_mps2(scenario.road, drive.s_m)
    i = int(np.argmax(steep_mps2 - grip))
    if steep_mps2[i] > grip[i]:
        yield (
            f"road.grade_percent: expected a slope on which the friction holds the car, at most "
            f"{100.0 * grip[i] / GRAVITY_MPS2:.1f} %, found "
            f"{100.0 * steep_mps2[i] / GRAVITY_MPS2:.1f} % at s = {drive.s_m[i]:.1f} m."
        )
        return
    motion = drive.motion
    grip = grip_mps2(scenario.road, motion.s_m)
    grade = scenario.road.grade(motion.s_m)
    excess = np.abs(motion.acceleration_mps2 + GRAVITY_MPS2 * grade) - grip
    worst: dict[str, int] = {}
    for i in np.flatnonzero(excess > _TOLERANCE_MPS2).tolist():
        stop, is_braking = int(motion.stop[i]), motion.acceleration_mps2[i] < 0.0
        part = "deceleration_mps2" if is_braking else "acceleration_mps2"
        name = "reference.speed_kmh" if stop < 0 else scenario.stops[stop].field(part)
        if name not in worst or excess[i] > excess[worst[name]]:
            worst[name] = i
    for name, i in worst.items():
        slope = "" if grade[i] == 0.0 else f" on a slope of {100.0 * grade[i]:+.1f} %"
        yield (
            f"{name}: expected an acceleration below the grip of {grip[i]:.1f} m/s^2, found "
            f"{motion.acceleration_mps2[i]:.1f} m/s^2{slope} at s = {motion.s_m[i]:.1f} m, t = "
            f"{motion.time_s[i]:.2f} s. Lower it, or move the knots apart."
        )
    if (
        scenario.speed.is_over_distance
        and scenario.speed.at(scenario.start.s_m, 0.0) == 0.0
        and scenario.speed.highest_mps > 0.0
    ):
        yield (
            "reference.speed_kmh: expected a speed above 0 at initial.s_m, because a speed over "
            "s_m cannot leave a standstill, found 0. Give it over t_s."
        )


def stop_problems(scenario: Scenario, drive: NominalDrive) -> Iterator[str]:
    """A line for a stop that cannot be made or is not reached."""
    stops, start = scenario.stops, scenario.start
    if not stops:
        return
    if stops[0].at_s_m <= start.s_m:
        yield (
            f"{stops[0].field('at_s_m')}: expected a stop beyond the start at "
            f"{start.s_m:g} m, found {stops[0].at_s_m:g}."
        )
        return
    for stop, following in pairwise(stops):
        name = stop.entry or "reference.speed_kmh"
        if following.at_s_m - stop.at_s_m < LEAST_GAP_M:
            yield (
                f"{following.field('at_s_m')}: expected stops {LEAST_GAP_M:g} m apart, "
                f"because a car within {STOP_WINDOW_M:g} m of its target has stopped there, found "
                f"{following.at_s_m:g} after {stop.at_s_m:g} m. Move it, or lengthen a hold_s."
            )
            return
        if stop.hold_s == inf:
            yield (
                f"{stop.field('hold_s')}: expected a time, because a stop at "
                f"{following.at_s_m:g} m follows, found none: {name} has no hold_s and holds to "
                f"the end of the drive."
            )
            return
    distance_m = stops[0].at_s_m - start.s_m
    need_m = _braking_distance_m(scenario, stops[0])
    if distance_m < need_m and scenario.speed.highest_mps > 0.0:
        yield (
            f"{stops[0].field('at_s_m')}: expected at least the braking distance of "
            f"{need_m:.1f} m after the start, found {distance_m:.1f} m. Move it, or increase "
            f"deceleration_mps2 where the friction allows it."
        )
    elif drive.stops_reached < len(stops):
        stop = stops[drive.stops_reached]
        yield (
            f"{stop.field('at_s_m')}: expected a place that the drive reaches within "
            f"duration_s = {scenario.duration_s:g} and the end of the road, found "
            f"{stop.at_s_m:g}. Increase duration_s."
        )


def _braking_distance_m(scenario: Scenario, stop: Stop) -> float:
    """From the start, with the deceleration of a stop, or as much as friction and slope allow."""
    start, road = scenario.start, scenario.road
    distance_m = min(stop.at_s_m - start.s_m, LONGEST_ROAD_M)
    s_m = np.linspace(start.s_m, start.s_m + distance_m, int(distance_m / GRID_M) + 2)
    able_mps2 = np.clip(
        grip_mps2(road, s_m) + GRAVITY_MPS2 * road.grade(s_m),
        _LEAST_BRAKING_MPS2,
        stop.deceleration_mps2,
    )
    lost = np.cumsum(0.5 * (able_mps2[1:] + able_mps2[:-1]) * np.diff(s_m))
    energy = 0.5 * start.speed_mps**2
    missing = energy - float(lost[-1])
    if missing > 0.0:
        return distance_m + missing / float(able_mps2[-1])
    return float(np.interp(energy, [0.0, *lost], s_m - start.s_m))
