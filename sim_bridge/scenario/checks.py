"""Checks of several fields of a scenario together: whether it can be driven.

The scenario is driven once as a point that follows the reference exactly.
"""

from collections.abc import Iterator
from itertools import pairwise
from math import inf, sqrt

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.preview import REACH_S
from rt_controller.contract.signals import GRAVITY_MPS2
from sim_bridge.faults.fault import late_faults
from sim_bridge.scenario.limits import KMH_PER_MPS
from sim_bridge.scenario.nominal_drive import NominalDrive, drive_nominally
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.scenario import PREVIEW_MIN_M, Scenario
from sim_bridge.scenario.speed import STOP_WINDOW_M

MAX_SLOPE = 0.5
"""of the path against the road; limited by the value range of the frames, with a margin"""
LARGEST_C2_PER_M, LARGEST_C3_PER_M2 = 0.030, 0.006
"""of the cubic of the path: value ranges of the frames, with a margin"""
LEAST_GAP = 0.5
"""of 1 - curvature * e_y: the car stays on the outer half of the way to the centre of a bend"""
LEAST_GAP_M = 2.0 * STOP_WINDOW_M
"""between two stops: a car cannot stand at both"""
_TOLERANCE_MPS2 = 1e-6
_FIT_EVERY = 4


def problems(scenario: Scenario) -> list[str]:
    """A line for each reason why the scenario cannot be driven; empty if it can."""
    if scenario.start.s_m >= scenario.road.length_m:
        return [
            f"initial.s_m: expected less than the length of the road, "
            f"{scenario.road.length_m:g} m, found {scenario.start.s_m:g}."
        ]
    drive = drive_nominally(scenario)
    return [
        *late_faults(scenario.faults, scenario.duration_s),
        *_path_problems(scenario, drive),
        *_speed_problems(scenario, drive),
        *_stop_problems(scenario, drive),
    ]


def _path_problems(scenario: Scenario, drive: NominalDrive) -> Iterator[str]:
    s_m, ey_m, slope = drive.s_m, drive.ey_m, drive.slope
    curvature, width = scenario.road.curvature_per_m(s_m), scenario.road.width_m
    if width is not None:
        out_m = np.abs(ey_m) + 0.5 * scenario.course.body.width_m - 0.5 * width(s_m)
        i = int(np.argmax(out_m))
        if out_m[i] > 0.0:
            yield (
                f"reference.ey_m: expected a car that stays on its road of road.width_m, found "
                f"{out_m[i]:.2f} m beside it at s = {s_m[i]:.1f} m. Widen the road or reduce the "
                f"move."
            )
    i, k = int(np.argmax(np.abs(slope))), int(np.argmax(curvature * ey_m))
    if abs(slope[i]) > MAX_SLOPE:
        yield (
            f"reference.ey_m: expected a slope of at most {MAX_SLOPE}, found {abs(slope[i]):.2f} "
            f"at s = {s_m[i]:.1f} m. Increase length_m or the distance of the knots; where the car "
            f"is slow, give ey_m over s_m and not over t_s."
        )
    elif 1.0 - curvature[k] * ey_m[k] < LEAST_GAP:
        yield (
            f"reference.ey_m: expected at most half of the radius of the bend, found "
            f"{ey_m[k]:.2f} m with a curvature of {curvature[k]:.3g} 1/m at s = {s_m[k]:.1f} m."
        )
    else:
        yield from _grip_problems(scenario, drive)
        yield from _fit_problems(scenario, drive)


def _fit_problems(scenario: Scenario, drive: NominalDrive) -> Iterator[str]:
    """Cubics that do not fit into the frames, or that the controller refuses."""
    s_m, time_s, speed_mps = (part[::_FIT_EVERY] for part in drive[:3])
    signed = scenario.cubics_ahead(s_m, time_s, speed_mps, speed_mps)
    cubics = np.abs(signed)
    for k, largest, unit in ((2, LARGEST_C2_PER_M, "1/m"), (3, LARGEST_C3_PER_M2, "1/m^2")):
        i = int(np.argmax(cubics[:, k]))
        if cubics[i, k] > largest:
            yield (
                f"reference.ey_m: expected a path whose cubic over the next "
                f"{REACH_S:g} s or {PREVIEW_MIN_M:g} m fits the frames, c{k} of at most "
                f"{largest:g} {unit}, found {cubics[i, k]:.3g} at s = {s_m[i]:.1f} m. "
                f"Lengthen the move."
            )


def _grip_problems(scenario: Scenario, drive: NominalDrive) -> Iterator[str]:
    """The place whose lateral acceleration exceeds the grip most."""
    s_m, bend = drive.s_m, drive.bend_per_m
    grip = _grip_mps2(scenario.road, s_m)
    gravity_mps2 = GRAVITY_MPS2 * np.sin(scenario.road.bank_rad(s_m))
    wanted_mps2 = drive.turn_per_m * drive.speed_mps**2 + gravity_mps2
    i = int(np.argmax(np.abs(wanted_mps2) - grip))
    if abs(wanted_mps2[i]) < grip[i]:
        return
    turn = float(drive.turn_per_m[i]) or 1e-9
    able_mps2 = grip[i] - np.sign(turn) * gravity_mps2[i]
    possible_kmh = KMH_PER_MPS * sqrt(max(able_mps2, 0.0) / abs(turn))
    field, remedy = "reference.ey_m", "lengthen the moves, or interpolate with pchip or spline"
    if abs(scenario.road.curvature_per_m.at(s_m[i])) >= abs(bend[i]):
        field, remedy = "reference.speed_kmh", "or choose a wider bend in road.curvature_per_m"
    yield (
        f"{field}: expected a lateral acceleration below the grip of {grip[i]:.1f} m/s^2, found "
        f"{abs(wanted_mps2[i]):.1f} m/s^2 at {KMH_PER_MPS * drive.speed_mps[i]:.0f} km/h, s = "
        f"{s_m[i]:.1f} m, the bank included. The radius there is {1.0 / abs(turn):.0f} m, on which "
        f"less than {possible_kmh:.0f} km/h is possible. Lower reference.speed_kmh, {remedy}."
    )


def _speed_problems(scenario: Scenario, drive: NominalDrive) -> Iterator[str]:
    """The acceleration along the road that exceeds its friction most."""
    motion, road = drive.motion, scenario.road
    grip, grade = _grip_mps2(road, motion.s_m), road.grade(motion.s_m)
    excess = np.abs(motion.acceleration_mps2 + GRAVITY_MPS2 * grade) - grip
    i = int(np.argmax(excess))
    if excess[i] > _TOLERANCE_MPS2:
        part = "deceleration_mps2" if motion.acceleration_mps2[i] < 0.0 else "acceleration_mps2"
        name = f"stops.{part}" if motion.is_for_stop[i] else "reference.speed_kmh"
        slope = "" if grade[i] == 0.0 else f" on a slope of {100.0 * grade[i]:+.1f} %"
        yield (
            f"{name}: expected an acceleration below the grip of {grip[i]:.1f} m/s^2, found "
            f"{motion.acceleration_mps2[i]:.1f} m/s^2{slope} at s = {motion.s_m[i]:.1f} m, t = "
            f"{motion.time_s[i]:.2f} s. Lower it, or move the knots apart."
        )


def _stop_problems(scenario: Scenario, drive: NominalDrive) -> Iterator[str]:
    """A line for a stop that cannot be made or is not reached."""
    stops, start = scenario.all_stops, scenario.start
    if not stops:
        return
    for stop, following in pairwise(stops):
        if following.at_s_m - stop.at_s_m < LEAST_GAP_M or stop.hold_s == inf:
            yield (
                f"stops: expected stops {LEAST_GAP_M:g} m apart or more, each but the last with a "
                f"hold_s, found one at {following.at_s_m:g} m after that at {stop.at_s_m:g} m with "
                f"hold_s = {stop.hold_s:g}."
            )
            return
    distance_m = stops[0].at_s_m - start.s_m
    # With less grip than the deceleration needs, the acceleration is refused, or this.
    able_mps2 = min(stops[0].deceleration_mps2, float(_grip_mps2(scenario.road, drive.s_m).max()))
    need_m = 0.5 * start.speed_mps**2 / able_mps2
    if distance_m <= 0.0 or (distance_m < need_m and scenario.speed.highest_mps > 0.0):
        yield (
            f"stops: expected at least the braking distance of {need_m:.1f} m between the start "
            f"and the first stop, found {distance_m:.1f} m. Move it, or increase "
            f"deceleration_mps2 where the friction allows it."
        )
    elif drive.stops_reached < len(stops):
        yield (
            f"stops: expected places that the drive reaches within duration_s = "
            f"{scenario.duration_s:g} and the end of the road, found "
            f"{stops[drive.stops_reached].at_s_m:g}. Increase duration_s."
        )


def _grip_mps2(road: Road, s_m: Array) -> Array:
    """The acceleration that the friction at arc lengths `s_m` can give, same shape."""
    return 0.5 * GRAVITY_MPS2 * (road.friction_left(s_m) + road.friction_right(s_m))
