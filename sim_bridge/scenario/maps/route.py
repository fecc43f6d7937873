"""The route through lanelets from the initial state to the goal, and its centre line."""

from collections import deque
from itertools import pairwise
from math import atan2, pi
from pathlib import Path

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario.maps.lanelets import Lanelet, PlanningProblem

FREE_DRIVE_M = 500.0
"""length of the drive where the goal has no position"""

FARTHEST_START_M = 3.0
"""largest distance of an initial position beside all lanelets from a centre line"""

LARGEST_GAP_M = 5.0
"""between the centre lines of a lanelet and its successor, whose widths may differ"""

Route = list[tuple[Lanelet, Lanelet]]
"""lanelets where the route enters and leaves each section; different where it changes lanes"""


def find_route(path: Path, lanelets: dict[str, Lanelet], problem: PlanningProblem) -> Route:
    """The shortest route along successors and neighbours of the same direction.

    Raises:
        ConfigError: the initial position or the goal is beside all lanelets, or no route connects
            them.
    """
    starts = [name for name, lane in lanelets.items() if lane.contains(problem.position)]
    if not starts:  # a car may start on a marking or on a hard shoulder
        starts = [
            name
            for name, lane in lanelets.items()
            if lane.distance_m(problem.position) < FARTHEST_START_M
        ]
    if not starts:
        raise ConfigError(
            f"{path}: expected an initial position on a lanelet, found "
            f"({problem.position[0]:.1f}, {problem.position[1]:.1f}) beside all of them."
        )
    goals = set(problem.goal_lanelets)
    if problem.goal_position is not None:
        at = problem.goal_position
        goals = {name for name, lane in lanelets.items() if lane.contains(at)}
    if not goals:
        if problem.goal_position is not None:
            raise ConfigError(f"{path}: expected a goal on a lanelet, found it beside all of them.")
        return _ahead(lanelets, min(starts, key=lambda name: _turn(lanelets[name], problem)))
    starts.sort(key=lambda name: _turn(lanelets[name], problem))
    before: dict[str, tuple[str, bool] | None] = {starts[0]: None}
    waiting = deque([starts[0]])
    while waiting:
        name = waiting.popleft()
        if name in goals:
            return _pairs(lanelets, before, name)
        lane = lanelets[name]
        for following, is_change in (
            *((other, False) for other in lane.successors),
            *((other, True) for other in lane.neighbours),
        ):
            if following in lanelets and following not in before:
                before[following] = (name, is_change)
                waiting.append(following)
    raise ConfigError(
        f"{path}: expected a goal that can be reached from the initial lanelet {starts[0]}, found "
        f"no route to {', '.join(sorted(goals))}."
    )


def _turn(lane: Lanelet, problem: PlanningProblem) -> float:
    """Angle between the car and the lanelet, in rad: of overlapping lanelets the best fits."""
    near = int(np.argmin(np.hypot(*(lane.centre[:-1] - problem.position).T)))
    along = lane.centre[near + 1] - lane.centre[near]
    angle = atan2(along[1], along[0]) - problem.yaw_rad
    return abs((angle + pi) % (2.0 * pi) - pi)


def _ahead(lanelets: dict[str, Lanelet], name: str) -> Route:
    """Successors until the drive is long enough or the map ends."""
    route, length_m = [], 0.0
    while name in lanelets and length_m < 2.0 * FREE_DRIVE_M:
        lane = lanelets[name]
        route.append((lane, lane))
        length_m += float(np.hypot(*np.diff(lane.centre, axis=0).T).sum())
        if not lane.successors:
            break
        name = lane.successors[0]
    return route


def _pairs(
    lanelets: dict[str, Lanelet], before: dict[str, tuple[str, bool] | None], goal: str
) -> Route:
    """The route that the search found, from its end to its beginning and back."""
    route = [(lanelets[goal], lanelets[goal])]
    step = before[goal]
    while step is not None:
        name, is_change = step
        if is_change:
            route[0] = (lanelets[name], route[0][1])
        else:
            route.insert(0, (lanelets[name], lanelets[name]))
        step = before[name]
    return route


def points_of(route: Route) -> Array:
    """(n, 2) points of the centre line; lanes change by a smooth blend over the lanelet.

    Raises:
        ValueError: a lanelet does not begin where the one before ends.
    """
    for (_, before), (after, _) in pairwise(route):
        gap_m = float(np.hypot(*(after.centre[0] - before.centre[-1])))
        if gap_m > LARGEST_GAP_M:
            raise ValueError(
                f"expected at most {LARGEST_GAP_M:g} m between lanelet {before.name} and its "
                f"successor {after.name}, found {gap_m:.1f} m"
            )
    parts = []
    for entered, left in route:
        centre = entered.centre
        if entered is not left:
            share = np.linspace(0.0, 1.0, len(centre))[:, None]
            weight = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            centre = (1.0 - weight) * centre + weight * _resampled(left.centre, len(centre))
        parts.append(centre)
    return np.concatenate(parts)


def _resampled(points: Array, count: int) -> Array:
    """(count, 2) points at equal shares of the number of points."""
    at = np.linspace(0.0, len(points) - 1.0, count)
    columns = [np.interp(at, np.arange(len(points)), column) for column in points.T]
    return np.column_stack(columns)
