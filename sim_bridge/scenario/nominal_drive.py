"""The drive that a scenario asks for: a point that follows its reference exactly."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.scenario.lateral import NEAREST_KNOTS_M, Lateral
from sim_bridge.scenario.limits import LONGEST_ROAD_M
from sim_bridge.scenario.scenario import Scenario
from sim_bridge.scenario.speed import braking_speed, next_progress

GRID_M = NEAREST_KNOTS_M
APPROACH_MPS2 = 2.0
"""assumed change of the difference between an initial speed and the wanted one"""
_NEAR = 1.0 - 1e-9


class Motion(NamedTuple):
    """The motion along the road, (n,) each; usually one row a control period."""

    s_m: Array
    time_s: Array
    speed_mps: Array
    acceleration_mps2: Array
    """of the wanted speed, from this row to the next one"""
    is_for_stop: Array
    """1 where the car brakes for a stop or drives off from one, else 0"""


class NominalDrive(NamedTuple):
    """The reference, driven exactly; all but the last two are (n,) on a grid of arc length."""

    s_m: Array
    time_s: Array
    speed_mps: Array
    ey_m: Array
    slope: Array
    """of the path against the road"""
    bend_per_m: Array
    """curvature of the path against the road"""
    turn_per_m: Array
    """curvature of road and path together"""
    motion: Motion
    stops_reached: int


@lru_cache(maxsize=2)
def drive_nominally(scenario: Scenario) -> NominalDrive:
    """The scenario as a point that takes on the wanted speed from its initial one.

    A drive of more than `LONGEST_ROAD_M` is followed so far. The last ones are kept, since the
    checks and the notes of a start look at the same one.
    """
    start, speed = scenario.start, scenario.speed
    reached = 0
    if speed.is_constant and not scenario.all_stops and start.speed_mps == speed.highest_mps:
        motion = _at_constant_speed(scenario)
    else:
        motion, reached = _period_by_period(scenario)
    first_m = float(motion.s_m[0])
    last_m = min(max(float(motion.s_m[-1]), first_m + GRID_M), first_m + LONGEST_ROAD_M)
    grid_m = np.linspace(first_m, last_m, int((last_m - first_m) / GRID_M) + 2)
    moving = np.concatenate(([True], np.diff(motion.s_m) > 0.0))
    place = motion.s_m[moving]
    time_s = np.interp(grid_m, place, motion.time_s[moving])
    speed_mps = np.interp(grid_m, place, motion.speed_mps[moving])
    ey_m = scenario.ey_m(grid_m, time_s)
    slope = np.gradient(ey_m, grid_m)
    bend = np.gradient(slope, grid_m)
    turn = bend + scenario.road.curvature_per_m(grid_m)
    return NominalDrive(grid_m, time_s, speed_mps, ey_m, slope, bend, turn, motion, reached)


def fix_path(scenario: Scenario) -> Scenario:
    """The scenario with a path that depends on the place only, at the times of the nominal drive.

    A car that is slower, in a stop for example, can follow it, too. Beyond the end of the drive
    the path continues with the last speed.
    """
    over_time = scenario.lateral
    if not over_time.is_over_time:
        return scenario
    drive = drive_nominally(scenario)
    beyond_m = max(drive.speed_mps[-1], 1.0) * scenario.duration_s
    s_m = np.append(drive.s_m, drive.s_m[-1] + beyond_m)
    time_s = np.append(drive.time_s, drive.time_s[-1] + scenario.duration_s)
    lateral = Lateral(partial(_at_nominal_time, over_time.law, s_m, time_s))
    reference = scenario.reference.model_copy(update={"ey_m": lateral})
    return replace(scenario, reference=reference)


def _at_nominal_time(
    law: Callable[[Array], Array], s_m: Array, time_s: Array, place_m: Array
) -> Array:
    """Lateral position at this place: that of the law at the time of the nominal drive."""
    return law(np.interp(place_m, s_m, time_s))


def _at_constant_speed(scenario: Scenario) -> Motion:
    start, duration_s = scenario.start, scenario.duration_s
    if start.speed_mps > 0.0:
        duration_s = min(duration_s, (scenario.end_m - start.s_m) / start.speed_mps)
    time_s = np.array([0.0, duration_s])
    speed_mps = np.full(2, start.speed_mps)
    return Motion(start.s_m + speed_mps * time_s, time_s, speed_mps, *np.zeros((2, 2)))


def _period_by_period(scenario: Scenario) -> tuple[Motion, int]:
    """The motion, and how many stops it reached."""
    s_m, progress, stops = scenario.start.s_m, scenario.first_progress, scenario.all_stops
    before_mps = scenario.reference_speed_mps(s_m, 0.0, progress)
    speed_mps = scenario.start.speed_mps
    rows: list[tuple[float, float, float, float, bool]] = []
    for tick in range(scenario.ticks + 1):
        time_s = tick * PERIOD_S
        wanted_mps = scenario.reference_speed_mps(s_m, time_s, progress)
        acceleration_mps2 = (wanted_mps - before_mps) / PERIOD_S
        stop = progress.stops_done
        is_ahead = stop < len(stops) and wanted_mps >= _NEAR * braking_speed(stops[stop], s_m)
        if progress.is_holding or is_ahead:
            # Whole periods would give more where the car comes to rest.
            acceleration_mps2 = max(acceleration_mps2, -stops[stop].deceleration_mps2)
        if rows:
            is_for_stop = wanted_mps < scenario.speed.at(s_m, time_s)
            rows[-1] = (*rows[-1][:3], acceleration_mps2, is_for_stop)
            speed_mps = _approached(wanted_mps, speed_mps, speed_mps - before_mps)
        progress = next_progress(progress, stops, s_m, speed_mps, time_s)
        rows.append((s_m, time_s, speed_mps, 0.0, False))
        before_mps = wanted_mps
        s_m += speed_mps * PERIOD_S
        if s_m >= scenario.end_m:
            break
    motion = Motion(*np.array(rows).T)
    return motion, progress.stops_done + progress.is_holding


def _approached(wanted_mps: float, speed_mps: float, lead_mps: float) -> float:
    """The speed of the next period; the lead over the wanted one decreases, and then stays 0."""
    step_mps = APPROACH_MPS2 * PERIOD_S
    if lead_mps < 0.0:
        return min(wanted_mps, speed_mps + step_mps)
    return max(wanted_mps, min(speed_mps, wanted_mps + lead_mps) - step_mps)
