"""The geometry of a road in OpenDRIVE: curvature over arc length, and where it begins and ends."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from math import atan2, cos, hypot, nan, pi, sin
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.polynomial import polynomial

from rt_controller.contract.arrays import Array
from sim_bridge.scenario.limits import LONGEST_ROAD_M
from sim_bridge.scenario.table import Ramp, chained

LARGEST_NUMBER = 1e9
"""of coordinates and coefficients; the products of larger ones could overflow"""
SAMPLE_M = 0.5
"""distance of the samples of a polynomial"""
LARGEST_GAP_M, LARGEST_TURN_RAD = 0.5, 0.05
"""between the end of a piece and the beginning of the next one"""
_LENGTH_TOLERANCE = 0.05
"""of the length of a polynomial against the one that the file names"""


class Pose(NamedTuple):
    """A place and a direction in the plane."""

    x_m: float
    y_m: float
    yaw_rad: float


class Piece(NamedTuple):
    """A geometry, or several that join."""

    ramps: list[Ramp]
    """curvature in 1/m"""
    start: Pose
    end: Pose


@contextmanager
def within(place: str) -> Iterator[None]:
    """Name the place in the file in the errors of its values.

    Raises:
        ValueError: with the place.
    """
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error


def attribute(element: Element, name: str) -> float:
    """A number of an element.

    Raises:
        ValueError: there is none, or it is not finite, or larger than `LARGEST_NUMBER`.
    """
    text = element.get(name)
    try:
        value = float(text or "")
    except ValueError:
        value = nan
    if not abs(value) <= LARGEST_NUMBER:
        found = "none" if text is None else repr(text)
        raise ValueError(
            f"a number of at most {LARGEST_NUMBER:g} expected as attribute {name} of "
            f"<{element.tag}>, found {found}"
        )
    return value


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
            f"{gap_m:.2f} m and {np.degrees(turn_rad):.1f} deg; compare s, x, y and hdg of both"
        )


def plan_view(road: Element) -> Piece:
    """The whole geometry of a road.

    Raises:
        ValueError: it is not complete, or its parts do not join.
    """
    pieces: list[Piece] = []
    for part in sorted(road.findall("planView/geometry"), key=lambda each: attribute(each, "s")):
        with within(f"geometry at s = {attribute(part, 's'):.10g} m"):
            piece = _piece_of(part)
            if pieces and piece.ramps:
                require_joint(pieces[-1].end, piece.start)
        pieces += [piece] if piece.ramps else []
    if not pieces:
        raise ValueError("no geometry in planView")
    ramps = [ramp for piece in pieces for ramp in piece.ramps]
    return Piece(ramps, pieces[0].start, pieces[-1].end)


def _piece_of(element: Element) -> Piece:
    """A geometry; one of no length has no ramps."""
    length_m = attribute(element, "length")
    if not 0.0 <= length_m <= LONGEST_ROAD_M:
        raise ValueError(f"a length of 0..{LONGEST_ROAD_M:g} m expected, found {length_m:g} m")
    start = Pose(*(attribute(element, name) for name in ("x", "y", "hdg")))
    if length_m == 0.0:
        return Piece([], start, start)
    for shape in element:
        if shape.tag in ("poly3", "paramPoly3"):
            return _sampled(shape, length_m, start)
        names = _CURVATURES.get(shape.tag)
        if names is not None:
            first, last = (attribute(shape, name) if name else 0.0 for name in names)
            ramps = [Ramp(length_m, first, last)]
            return Piece(ramps, start, _end_of(start, ramps))
    tags = ", ".join(child.tag for child in element) or "nothing"
    known = ", ".join((*_CURVATURES, "poly3, paramPoly3"))
    raise ValueError(f"one of {known} expected in geometry, found {tags}")


_CURVATURES = {
    "line": ("", ""),
    "arc": ("curvature", "curvature"),
    "spiral": ("curvStart", "curvEnd"),
}
"""attributes with the first and last curvature of a shape"""


def _end_of(start: Pose, ramps: list[Ramp]) -> Pose:
    """The pose at the end of a curvature without jumps."""
    curvature = chained(ramps)
    count = max(2, round(curvature.end / SAMPLE_M) + 1)
    at = curvature(np.linspace(0.0, curvature.end, count))
    step_m = curvature.end / (count - 1)
    yaw = start.yaw_rad + np.concatenate(([0.0], np.cumsum(0.5 * (at[1:] + at[:-1]) * step_m)))
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    return Pose(
        start.x_m + step_m * float(np.cos(middle).sum()),
        start.y_m + step_m * float(np.sin(middle).sum()),
        float(yaw[-1]),
    )


def _sampled(shape: Element, length_m: float, origin: Pose) -> Piece:
    """A polynomial (u(p), v(p)) as curvature over `length_m` of arc.

    That of a poly3 is v(u): its arc is at least as long as its projection on u.
    """
    is_whole, last = shape.tag == "paramPoly3", length_m
    u, v = np.array([0.0, 1.0, 0.0, 0.0]), _coefficients(shape, "V" if is_whole else "")
    if is_whole:
        u, name = _coefficients(shape, "U"), shape.get("pRange", "arcLength")
        if name not in ("arcLength", "normalized"):
            raise ValueError(f"pRange of arcLength or normalized expected, found {name!r}")
        last = 1.0 if name == "normalized" else length_m
    count = max(2, round(length_m / SAMPLE_M) + 1)
    p = np.linspace(0.0, last, 8 * count)
    with np.errstate(all="ignore"):
        du, ddu, dv, ddv = (
            polynomial.polyval(p, polynomial.polyder(c, k)) for c in (u, v) for k in (1, 2)
        )
        speed = np.hypot(du, dv)
        curvature = (du * ddv - dv * ddu) / speed**3
        arc_m = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(p))))
    if not np.all(np.isfinite(curvature)):
        raise ValueError(f"a curve without standstill expected in a polynomial, found {u}, {v}")
    ratio = float(arc_m[-1]) / length_m
    if ratio < 1.0 - _LENGTH_TOLERANCE or (is_whole and ratio > 1.0 + _LENGTH_TOLERANCE):
        raise ValueError(
            f"a polynomial as long as its geometry, {length_m:g} m, expected, found "
            f"{arc_m[-1]:.6g} m; compare length and pRange"
        )
    values = np.interp(np.linspace(0.0, length_m, count), arc_m, curvature).tolist()
    ramps = [Ramp(length_m / (count - 1), a, b) for a, b in pairwise(values)]
    c, s = cos(origin.yaw_rad), sin(origin.yaw_rad)
    x_m, y_m = float(u[0]), float(v[0])
    start = Pose(
        origin.x_m + x_m * c - y_m * s,
        origin.y_m + x_m * s + y_m * c,
        origin.yaw_rad + atan2(float(dv[0]), float(du[0])),
    )
    return Piece(ramps, start, _end_of(start, ramps))


def _coefficients(shape: Element, axis: str) -> Array:
    return np.array([attribute(shape, name + axis) for name in "abcd"])
