"""The geometry of a road in OpenDRIVE: curvature over arc length, and where each piece lies."""

from collections.abc import Callable
from itertools import pairwise
from math import atan2, cos, hypot, pi, sin
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.scenario.limits import LONGEST_ROAD_M
from sim_bridge.scenario.maps.xml_file import number
from sim_bridge.scenario.table import Ramp, chained

SAMPLE_M = 0.5
"""distance of the samples of a polynomial"""
LARGEST_GAP_M = 0.5
"""between the end of a piece and the beginning of the next one"""
LARGEST_TURN_RAD = 0.05
"""between their directions"""
_GEOMETRY = "geometry at s = {:.10g} m"
_LENGTH_TOLERANCE = 0.05
"""of the length of a polynomial against the one that the file names"""


class Pose(NamedTuple):
    """A place and a direction in the plane."""

    x_m: float
    y_m: float
    yaw_rad: float

    def turned(self) -> "Pose":
        """The same place, in the opposite direction."""
        return self._replace(yaw_rad=self.yaw_rad + pi)


class Piece(NamedTuple):
    """A geometry, or several that join."""

    ramps: list[Ramp]
    """curvature in 1/m"""
    start: Pose
    end: Pose


def require_joint(end: Pose, start: Pose) -> None:
    """Return if a piece that begins at `start` continues one that ends at `end`.

    Raises:
        ValueError: it does not.
    """
    gap_m = hypot(start.x_m - end.x_m, start.y_m - end.y_m)
    turn_rad = (start.yaw_rad - end.yaw_rad + pi) % (2.0 * pi) - pi
    if gap_m > LARGEST_GAP_M or abs(turn_rad) > LARGEST_TURN_RAD:
        raise ValueError(
            f"at most {LARGEST_GAP_M:g} m and {np.degrees(LARGEST_TURN_RAD):.1f} deg expected "
            f"between an end at ({end.x_m:.1f}, {end.y_m:.1f}) m and the next beginning, found "
            f"{gap_m:.2f} m and {np.degrees(turn_rad):.1f} deg"
        )


def plan_view(road: Element) -> Piece:
    """The whole geometry of a road.

    Raises:
        ValueError: it is not complete, or its parts do not join.
    """
    elements = sorted(road.findall("planView/geometry"), key=lambda part: attribute(part, "s"))
    placed = [(attribute(part, "s"), _named_piece_of(part)) for part in elements]
    placed = [(s_m, piece) for s_m, piece in placed if piece.ramps]
    if not placed:
        raise ValueError("no geometry in planView")
    for (_, before), (s_m, after) in pairwise(placed):
        try:
            require_joint(before.end, after.start)
        except ValueError as error:
            raise ValueError(
                f"{_GEOMETRY.format(s_m)}: {error}; compare s, x, y and hdg of both"
            ) from error
    pieces = [piece for _, piece in placed]
    ramps = [ramp for piece in pieces for ramp in piece.ramps]
    return Piece(ramps, pieces[0].start, pieces[-1].end)


def attribute(element: Element, name: str) -> float:
    """A number of an element.

    Raises:
        ValueError: there is none, or it is not finite or too large.
    """
    return number(element.get(name), f"attribute {name} of <{element.tag}>")


def _named_piece_of(element: Element) -> Piece:
    try:
        return _piece_of(element)
    except ValueError as error:
        raise ValueError(f"{_GEOMETRY.format(attribute(element, 's'))}: {error}") from error


def _piece_of(element: Element) -> Piece:
    length_m = attribute(element, "length")
    if not 0.0 <= length_m <= LONGEST_ROAD_M:
        raise ValueError(f"a length of 0..{LONGEST_ROAD_M:g} m expected, found {length_m:g} m")
    x_m, y_m, hdg = (attribute(element, name) for name in ("x", "y", "hdg"))
    if length_m == 0.0:
        return Piece([], Pose(x_m, y_m, hdg), Pose(x_m, y_m, hdg))
    shapes = [child for child in element if child.tag in _SHAPES]
    if len(shapes) != 1:
        tags = ", ".join(child.tag for child in element) or "nothing"
        raise ValueError(f"one of {', '.join(_SHAPES)} expected in geometry, found {tags}")
    ramps, (u, v, yaw) = _SHAPES[shapes[0].tag](shapes[0], length_m)
    c, s = cos(hdg), sin(hdg)
    start = Pose(x_m + u * c - v * s, y_m + u * s + v * c, hdg + yaw)
    return Piece(ramps, start, _end_of(start, ramps))


def _end_of(start: Pose, ramps: list[Ramp]) -> Pose:
    """The pose at the end of a curvature without jumps."""
    curvature = chained(ramps)
    count = max(2, round(curvature.end / SAMPLE_M) + 1)
    s_m = np.linspace(0.0, curvature.end, count)
    at = curvature(s_m)
    step_m = curvature.end / (count - 1)
    yaw = start.yaw_rad + np.concatenate(([0.0], np.cumsum(0.5 * (at[1:] + at[:-1]) * step_m)))
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    return Pose(
        start.x_m + step_m * float(np.cos(middle).sum()),
        start.y_m + step_m * float(np.sin(middle).sum()),
        float(yaw[-1]),
    )


_Shape = tuple[list[Ramp], Pose]
"""curvature, and the first pose in the axes of the geometry"""
_ORIGIN = Pose(0.0, 0.0, 0.0)


def _line(shape: Element, length_m: float) -> _Shape:
    return [Ramp(length_m, 0.0, 0.0)], _ORIGIN


def _arc(shape: Element, length_m: float) -> _Shape:
    curvature = attribute(shape, "curvature")
    return [Ramp(length_m, curvature, curvature)], _ORIGIN


def _spiral(shape: Element, length_m: float) -> _Shape:
    return [Ramp(length_m, attribute(shape, "curvStart"), attribute(shape, "curvEnd"))], _ORIGIN


def _poly3(shape: Element, length_m: float) -> _Shape:
    v = np.array([attribute(shape, name) for name in "abcd"])
    # v is a function of u; the arc is at least as long as its projection on u.
    return _sampled(np.array([0.0, 1.0, 0.0, 0.0]), v, length_m, length_m)


def _param_poly3(shape: Element, length_m: float) -> _Shape:
    u, v = (np.array([attribute(shape, name + axis) for name in "abcd"]) for axis in "UV")
    ranges = {"arcLength": length_m, "normalized": 1.0}
    name = shape.get("pRange", "arcLength")
    if name not in ranges:
        raise ValueError(f"pRange of {' or '.join(ranges)} expected, found {name!r}")
    return _sampled(u, v, ranges[name], length_m, is_whole=True)


_SHAPES: dict[str, Callable[[Element, float], _Shape]] = {
    "line": _line,
    "arc": _arc,
    "spiral": _spiral,
    "poly3": _poly3,
    "paramPoly3": _param_poly3,
}


def _sampled(u: Array, v: Array, last: float, length_m: float, is_whole: bool = False) -> _Shape:
    """Curvature of (u(p), v(p)) over `length_m` of arc.

    p is from 0 to `last`; `is_whole`: this is all of the arc, not more.
    """
    poly = np.polynomial.polynomial
    count = max(2, round(length_m / SAMPLE_M) + 1)
    p = np.linspace(0.0, last, 8 * count)
    with np.errstate(all="ignore"):
        du, dv = poly.polyval(p, poly.polyder(u)), poly.polyval(p, poly.polyder(v))
        speed = np.hypot(du, dv)
        curvature = (
            du * poly.polyval(p, poly.polyder(v, 2)) - dv * poly.polyval(p, poly.polyder(u, 2))
        ) / speed**3
        arc_m = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(p))))
    if not np.all(np.isfinite(curvature)):
        raise ValueError(f"a curve without standstill expected in a polynomial, found {u}, {v}")
    ratio = float(arc_m[-1]) / length_m
    if ratio < 1.0 - _LENGTH_TOLERANCE or (is_whole and ratio > 1.0 + _LENGTH_TOLERANCE):
        raise ValueError(
            f"a polynomial as long as its geometry, {length_m:g} m, expected, found "
            f"{arc_m[-1]:.6g} m; compare length and pRange"
        )
    s_m = np.linspace(0.0, length_m, count)
    values = np.interp(s_m, arc_m, curvature).tolist()
    step_m = length_m / (count - 1)
    first = Pose(float(u[0]), float(v[0]), atan2(float(dv[0]), float(du[0])))
    return [Ramp(step_m, a, b) for a, b in pairwise(values)], first
