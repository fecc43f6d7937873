"""CommonRoad scenarios as drives.

The route runs from the initial state to the goal of the first planning problem; its centre line
becomes the reference line. Other traffic is not read: the controller drives a path, it does not
plan one.
"""

from math import inf, nan
from pathlib import Path

from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario.curve_speed import curve_speed
from sim_bridge.scenario.limits import DRY_ASPHALT
from sim_bridge.scenario.maps.centre_line import through_points
from sim_bridge.scenario.maps.lanelets import PlanningProblem, read_network
from sim_bridge.scenario.maps.map_drive import (
    LARGEST_MPS,
    MAP_COMFORT,
    UNLIMITED_MPS,
    time_needed_s,
)
from sim_bridge.scenario.maps.route import FREE_DRIVE_M, find_route, points_of
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.scenario import Scenario, Start
from sim_bridge.scenario.table import constant

_SLOWEST_MPS = 1.0


def scenario_of_commonroad(path: Path) -> Scenario:
    """The drive of the first planning problem of a CommonRoad scenario.

    Raises:
        ConfigError: the file cannot be read, has no planning problem, its goal cannot be reached
            from its initial state, or the route is too short or too long.
    """
    name, lanelets, problem = read_network(path)
    route = find_route(path, lanelets, problem)
    try:
        line = through_points(points_of(route))
    except ValueError as error:
        raise ConfigError(f"{path}: route: {error}.") from error
    start_m, ey_m, epsi_rad = line.place(problem.position, problem.yaw_rad)
    end_m = min(line.length_m, start_m + FREE_DRIVE_M)
    if problem.goal_position is not None:
        end_m = line.place(problem.goal_position, 0.0)[0]
    elif problem.goal_lanelets:
        end_m = line.length_m
    if end_m <= start_m:
        raise ConfigError(
            f"{path}: expected a goal ahead of the initial position, found it at "
            f"{end_m - start_m:.1f} m along the route."
        )
    limit_mps = min((lanelet.limit_mps for lanelet, _ in route), default=inf)
    speed = curve_speed(
        line.curvature_per_m,
        constant(_wanted_mps(problem, end_m - start_m, limit_mps)),
        line.length_m,
        MAP_COMFORT,
        start_m,
        max(problem.speed_mps, _SLOWEST_MPS),
    )
    road = Road(
        curvature_per_m=line.curvature_per_m,
        friction_left=constant(DRY_ASPHALT),
        friction_right=constant(DRY_ASPHALT),
        length_m=line.length_m,
    )
    return Scenario(
        name=name,
        duration_s=time_needed_s(path, speed, start_m, end_m),
        start=Start(problem.speed_mps, start_m, ey_m, epsi_rad),
        road=road,
        speed=speed,
        distance_m=end_m - start_m,
    )


def _wanted_mps(problem: PlanningProblem, distance_m: float, limit_mps: float) -> float:
    """The speed that reaches the goal in time, within the limit."""
    wanted_mps = distance_m / problem.goal_time_s if problem.goal_time_s > 0.0 else nan
    if not 0.0 < wanted_mps < inf:
        wanted_mps = problem.speed_mps or UNLIMITED_MPS
    return min(max(wanted_mps, _SLOWEST_MPS), limit_mps, LARGEST_MPS)
