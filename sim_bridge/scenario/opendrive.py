"""The reference line of roads in an OpenDRIVE file (.xodr, ASAM OpenDRIVE 1.4 to 1.8).

Read are the geometry of the plan view (line, arc, spiral, poly3, paramPoly3), elevation,
superelevation and the speed limit of each road; lanes and their offsets, junctions, signals and
objects are not. The geometry gives curvature over arc length directly; only the polynomials are
sampled.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from math import atan2, cos, hypot, inf, nan, pi, sin
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, TreeBuilder, XMLParser

import numpy as np
from numpy.polynomial import polynomial

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import open_regular
from rt_controller.mapping.units import require_unit
from sim_bridge.scenario.limits import LONGEST_ROAD_M
from sim_bridge.scenario.table import Ramp, Table, chained, joined

LARGEST_MB = 128
"""size of a file; its tree takes about ten times as much memory"""
LARGEST_NUMBER = 1e9
"""of coordinates and coefficients; the products of larger ones could overflow"""
SAMPLE_M = 0.5
"""distance of the samples of a polynomial"""
LARGEST_GAP_M, LARGEST_TURN_RAD = 0.5, 0.05
"""between the end of a piece and the beginning of the next one"""
_LENGTH_TOLERANCE = 0.05
"""of the length of a polynomial against the one that the file names"""
_NO_LIMIT = ("no limit", "undefined")
_MPS_PER_UNIT = {name: require_unit(name, "speed").factor for name in ("m/s", "km/h", "mph")}
_CURVATURES = {
    "line": ("", ""),
    "arc": ("curvature", "curvature"),
    "spiral": ("curvStart", "curvEnd"),
}
"""attributes with the first and last curvature of a shape"""
_Record = tuple[float, tuple[float, ...]]
"""s where a polynomial begins, and its four coefficients in ascending powers"""


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


class ReferenceLine(NamedTuple):
    """A road as tables over arc length."""

    curvature_per_m: Table
    bank_rad: Table
    """positive if the left side is higher"""
    grade: Table
    """rise over distance"""
    speed_limit_mps: Table
    """inf where none is named"""
    length_m: float
    start: Pose
    end: Pose


class _Builder(TreeBuilder):
    """A tree without a document type: its entities could fill the memory or name other files."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ValueError("no <!DOCTYPE> expected, found one; remove it")


def read_reference_line(path: Path, ids: Sequence[str] = ()) -> ReferenceLine:
    """The reference line of the named roads in a row.

    If none is named: of the only road, beside the connecting roads of junctions. An id with a
    minus sign means driving against the direction of the reference line.

    Raises:
        ConfigError: the file cannot be read, there are no such roads, or they do not join.
    """
    try:
        with open_regular(path, LARGEST_MB * 1_000_000) as file:
            root = ElementTree.parse(file, XMLParser(target=_Builder())).getroot()
    except (OSError, ElementTree.ParseError, ValueError, LookupError) as error:
        found = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"{path}: expected an OpenDRIVE file, found an error: {found}."
        ) from error
    try:
        return _joined_roads(root, ids)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}.") from error


def _joined_roads(root: Element, ids: Sequence[str]) -> ReferenceLine:
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    roads = {road.get("id", ""): road for road in root.findall("road")}
    if root.tag != "OpenDRIVE" or not roads:
        raise ValueError(f"expected an OpenDRIVE file with roads, found <{root.tag}>")
    own = [name for name, road in roads.items() if road.get("junction", "-1") == "-1"]
    own = own or list(roads)
    listed = ", ".join(f"{name} ({roads[name].get('length')} m)" for name in own[:20])
    if not ids and len(own) != 1:
        raise ValueError(
            f"expected the ids of the roads to drive on, because there are {len(own)}, found "
            f"none. Name some of {listed}"
        )
    ids = ids or own
    lines: list[ReferenceLine] = []
    for name in ids:
        is_against = name.startswith("-") and name not in roads
        road = roads.get(name.removeprefix("-") if is_against else name)
        if road is None:
            raise ValueError(f"expected a road of {listed}, found {name!r}")
        with _within(f"expected readable roads, found: road {name}"):
            line = _line_of(road)
        lines.append(_against(line) if is_against else line)
    for (before, line), (after, following) in pairwise(zip(ids, lines, strict=True)):
        with _within(f"roads {before} and {after}"):
            _require_joint(line.end, following.start)
    lengths = [line.length_m for line in lines]
    if sum(lengths) > LONGEST_ROAD_M:
        raise ValueError(
            f"expected roads of at most {LONGEST_ROAD_M:g} m in total, found {sum(lengths):g} m. "
            f"Name fewer roads"
        )
    curvature, bank, grade, limit = (
        joined(parts, lengths) for parts in zip(*(line[:4] for line in lines), strict=True)
    )
    ends = lines[0].start, lines[-1].end
    return ReferenceLine(curvature, bank, grade, limit, sum(lengths), *ends)


@contextmanager
def _within(place: str) -> Iterator[None]:
    """Name the place in the file in the errors of its values."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error


def _attribute(element: Element, name: str) -> float:
    """A number of an element; ValueError if there is none, or it is too large."""
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


def _require_joint(end: Pose, start: Pose) -> None:
    """Return if a piece that begins at `start` continues one that ends at `end`."""
    gap_m = hypot(start.x_m - end.x_m, start.y_m - end.y_m)
    turn_rad = (start.yaw_rad - end.yaw_rad + pi) % (2.0 * pi) - pi
    if gap_m > LARGEST_GAP_M or abs(turn_rad) > LARGEST_TURN_RAD:
        raise ValueError(
            f"at most {LARGEST_GAP_M:g} m and {np.degrees(LARGEST_TURN_RAD):.1f} deg expected "
            f"between an end at ({end.x_m:.1f}, {end.y_m:.1f}) m and the next beginning, found "
            f"{gap_m:.2f} m and {np.degrees(turn_rad):.1f} deg; compare s, x, y and hdg of both"
        )


def _line_of(road: Element) -> ReferenceLine:
    pieces: list[Piece] = []
    for part in sorted(road.findall("planView/geometry"), key=lambda each: _attribute(each, "s")):
        with _within(f"geometry at s = {_attribute(part, 's'):.10g} m"):
            piece = _piece_of(part)
            if pieces and piece.ramps:
                _require_joint(pieces[-1].end, piece.start)
        pieces += [piece] if piece.ramps else []
    if not pieces:
        raise ValueError("no geometry in planView")
    curvature = chained([ramp for piece in pieces for ramp in piece.ramps])
    rises, banks = (
        [
            (_attribute(each, "s"), tuple(_attribute(each, name) for name in "abcd"))
            for each in road.findall(path)
        ]
        for path in ("elevationProfile/elevation", "lateralProfile/superelevation")
    )
    slopes = [(s, (b, 2.0 * c, 3.0 * d, 0.0)) for s, (_, b, c, d) in rises]
    limits = [(_attribute(r, "s"), (_limit_of(r), 0.0, 0.0, 0.0)) for r in road.findall("type")]
    return ReferenceLine(
        curvature_per_m=curvature,
        bank_rad=_table(banks, 0.0, curvature.end),
        grade=_table(slopes, 0.0, curvature.end),
        speed_limit_mps=_table(limits, inf, curvature.end),
        length_m=curvature.end,
        start=pieces[0].start,
        end=pieces[-1].end,
    )


def _table(records: Sequence[_Record], before: float, length_m: float) -> Table:
    """Records along a road, with the value `before` up to the first."""
    known = sorted(records, key=lambda record: record[0])
    if known and known[0][0] < 0.0:
        raise ValueError(f"s of at least 0 expected in all records, found {known[0][0]:g}")
    if not known or known[0][0] > 0.0:
        known.insert(0, (0.0, (before, 0.0, 0.0, 0.0)))
    table = Table(np.array([s for s, _ in known]), np.array([c for _, c in known]))
    return joined([table], [length_m])


def _limit_of(record: Element) -> float:
    """Speed limit in m/s of the type of a road; inf if it names none."""
    speed = record.find("speed")
    if speed is None or speed.get("max", "undefined") in _NO_LIMIT:
        return inf
    unit = speed.get("unit", "m/s")
    if unit not in _MPS_PER_UNIT:
        raise ValueError(f"unit {', '.join(_MPS_PER_UNIT)} expected in <speed>, found {unit!r}")
    limit_mps = _attribute(speed, "max") * _MPS_PER_UNIT[unit]
    if limit_mps <= 0.0:
        raise ValueError(
            f"max above 0, {' or '.join(_NO_LIMIT)} expected in <speed>, found {speed.get('max')}"
        )
    return limit_mps


def _against(line: ReferenceLine) -> ReferenceLine:
    start, end = (pose._replace(yaw_rad=pose.yaw_rad + pi) for pose in (line.end, line.start))
    curvature, bank, grade = (t.backwards(line.length_m).scaled(-1.0) for t in line[:3])
    limit = line.speed_limit_mps.backwards(line.length_m)
    return ReferenceLine(curvature, bank, grade, limit, line.length_m, start, end)


def _piece_of(element: Element) -> Piece:
    """A geometry; one of no length has no ramps."""
    length_m = _attribute(element, "length")
    if not 0.0 <= length_m <= LONGEST_ROAD_M:
        raise ValueError(f"a length of 0..{LONGEST_ROAD_M:g} m expected, found {length_m:g} m")
    start = Pose(*(_attribute(element, name) for name in ("x", "y", "hdg")))
    if length_m == 0.0:
        return Piece([], start, start)
    for shape in element:
        if shape.tag in ("poly3", "paramPoly3"):
            return _sampled(shape, length_m, start)
        if shape.tag in _CURVATURES:
            names = _CURVATURES[shape.tag]
            first, last = (_attribute(shape, name) if name else 0.0 for name in names)
            ramps = [Ramp(length_m, first, last)]
            return Piece(ramps, start, _end_of(start, ramps))
    tags = ", ".join(child.tag for child in element) or "nothing"
    known = ", ".join((*_CURVATURES, "poly3, paramPoly3"))
    raise ValueError(f"one of {known} expected in geometry, found {tags}")


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
    return np.array([_attribute(shape, name + axis) for name in "abcd"])
