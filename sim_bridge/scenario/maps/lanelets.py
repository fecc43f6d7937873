"""Lanelets and planning problem of a CommonRoad scenario (XML, versions 2018b and 2020a).

commonroad-io is not used: it requires protobuf 3.20.2, which cannot be installed beside the onnx
of `offline`.
"""

from collections.abc import Iterator
from math import inf, nan
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario.maps.xml_file import number, read_xml

VERSIONS = ("2018b", "2020a")
_SPEED_SIGNS = {
    "274", "274.1",  # Germany, also China, Italy and Zamunda; 274.1: of a zone
    "R2-1",  # United States, Puerto Rico
    "r301",  # Spain
    "3.24",  # Russia
    "R15",  # Argentina
    "C43",  # Belgium
    "B14",  # France
    "\u03a1-32",  # Greece, with the letter rho
    "B31",  # Croatia
}  # fmt: skip
"""ids of speed limits in the catalogues of commonroad-io 2026.1"""


class Lanelet(NamedTuple):
    """A piece of a lane between two bounds."""

    name: str
    left: Array
    """(n, 2) of its bounds"""
    right: Array
    successors: tuple[str, ...]
    neighbours: tuple[str, ...]
    """of the same direction"""
    limit_mps: float

    @property
    def centre(self) -> Array:
        """(n, 2)."""
        return 0.5 * (self.left + self.right)

    def contains(self, point: Array) -> bool:
        """True if the point is between the bounds."""
        outline = np.concatenate((self.left, self.right[::-1]))
        x, y = outline.T
        x2, y2 = np.roll(outline, -1, axis=0).T
        crosses = (y > point[1]) != (y2 > point[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            at_x = x + (point[1] - y) * (x2 - x) / (y2 - y)
        return bool(np.count_nonzero(crosses & (point[0] < at_x)) % 2)

    def distance_m(self, point: Array) -> float:
        """Distance of a point from the centre line."""
        first, along = self.centre[:-1], np.diff(self.centre, axis=0)
        length = np.maximum(np.sum(along**2, axis=1), 1e-12)
        share = np.clip(np.sum((point - first) * along, axis=1) / length, 0.0, 1.0)
        return float(np.min(np.hypot(*(first + share[:, None] * along - point).T)))


class PlanningProblem(NamedTuple):
    """Where the car starts and where it has to go."""

    position: Array
    yaw_rad: float
    speed_mps: float
    goal_lanelets: tuple[str, ...]
    goal_position: Array | None
    goal_time_s: float
    """NaN if the goal has none"""


class RoadNetwork(NamedTuple):
    """The content of a file, as far as it is read."""

    name: str
    lanelets: dict[str, Lanelet]
    problem: PlanningProblem


def read_network(path: Path) -> RoadNetwork:
    """Lanelets and first planning problem of a file.

    Raises:
        ConfigError: the file cannot be read, or is not complete.
    """
    root = _root_of(path)
    try:
        lanelets = {lanelet.name: lanelet for lanelet in _lanelets(root)}
        problem = _problem_of(root)
    except ValueError as error:
        raise ConfigError(
            f"{path}: expected a complete CommonRoad scenario, found an error: {error}."
        ) from error
    return RoadNetwork(root.get("benchmarkID", path.stem), lanelets, problem)


def _root_of(path: Path) -> Element:
    root = read_xml(path, "a CommonRoad scenario")
    version = root.get("commonRoadVersion")
    if root.tag != "commonRoad" or version not in VERSIONS:
        raise ConfigError(
            f"{path}: expected a CommonRoad scenario of version {' or '.join(VERSIONS)}, found "
            f"<{root.tag}> of version {version}."
        )
    return root


def _lanelets(root: Element) -> Iterator[Lanelet]:
    limits = {sign.get("id", ""): _limit_of(sign) for sign in root.findall("trafficSign")}
    for element in root.findall("lanelet"):
        neighbours = tuple(
            near.get("ref", "")
            for side in ("adjacentLeft", "adjacentRight")
            for near in element.findall(side)
            if near.get("drivingDir") == "same"
        )
        limit_mps = _speed_of(element, "speedLimit")
        for sign in element.findall("trafficSignRef"):
            limit_mps = min(limit_mps, limits.get(sign.get("ref", ""), inf))
        left, right = (_points(element.find(side)) for side in ("leftBound", "rightBound"))
        if len(left) != len(right) or len(left) < 2:
            raise ValueError(
                f"lanelet {element.get('id')}: as many points expected on both bounds, at least "
                f"2, found {len(left)} and {len(right)}"
            )
        yield Lanelet(
            name=element.get("id", ""),
            left=left,
            right=right,
            successors=tuple(s.get("ref", "") for s in element.findall("successor")),
            neighbours=neighbours,
            limit_mps=limit_mps,
        )


def _limit_of(sign: Element) -> float:
    """Speed in m/s of a traffic sign; inf if it is no speed limit."""
    for part in sign.findall("trafficSignElement"):
        if part.findtext("trafficSignID", "").strip() in _SPEED_SIGNS:
            return _speed_of(part, "additionalValue")
    return inf


def _speed_of(element: Element, name: str) -> float:
    """Speed limit in m/s; inf if there is none."""
    text = element.findtext(name)
    if text is None:
        return inf
    limit_mps = number(text, name)
    if limit_mps <= 0.0:
        raise ValueError(f"a speed limit above 0 expected as {name}, found {text}")
    return limit_mps


def _points(bound: Element | None) -> Array:
    """(n, 2) points of a bound."""
    if bound is None:
        raise ValueError("leftBound and rightBound expected in every lanelet, found one missing")
    return np.array([_point(point) for point in bound.findall("point")]).reshape(-1, 2)


def _point(element: Element) -> tuple[float, float]:
    return number(element.findtext("x"), "x of a point"), number(
        element.findtext("y"), "y of a point"
    )


def _problem_of(root: Element) -> PlanningProblem:
    element = root.find("planningProblem")
    if element is None:
        raise ValueError("a planningProblem expected, found none")
    state, goal = element.find("initialState"), element.find("goalState")
    start = None if state is None else state.find("position/point")
    if state is None or start is None:
        raise ValueError("initialState with an exact position expected, found none")
    place = None if goal is None else goal.find("position")
    lanelets: tuple[str, ...] = ()
    position: Array | None = None
    if place is not None:
        lanelets = tuple(part.get("ref", "") for part in place.findall("lanelet"))
        position = _middle_of(place) if not lanelets else None
    return PlanningProblem(
        position=np.array(_point(start)),
        yaw_rad=_exact(state, "orientation"),
        speed_mps=_exact(state, "velocity"),
        goal_lanelets=lanelets,
        goal_position=position,
        goal_time_s=_middle_time(goal) * number(root.get("timeStepSize"), "timeStepSize"),
    )


def _middle_of(place: Element) -> Array | None:
    """Centre of the first shape of a position."""
    for shape in place:
        centre = shape if shape.tag == "point" else shape.find("center")
        if shape.tag in ("rectangle", "circle", "point") and centre is not None:
            return np.array(_point(centre))
        if shape.tag == "polygon":
            corners = [_point(point) for point in shape.findall("point")]
            if not corners:
                raise ValueError("points expected in a polygon, found none")
            return np.asarray(np.mean(corners, axis=0))
    return None


def _exact(state: Element, name: str) -> float:
    """A number that may be given as an interval: its middle."""
    element = state.find(name)
    if element is None:
        raise ValueError(f"{name} expected in {state.tag}, found none")
    text = element.findtext("exact")
    if text is not None:
        return number(text, name)
    ends = [number(element.findtext(part), name) for part in ("intervalStart", "intervalEnd")]
    return 0.5 * (ends[0] + ends[1])


def _middle_time(goal: Element | None) -> float:
    return nan if goal is None or goal.find("time") is None else _exact(goal, "time")
