"""The reference line of roads in an OpenDRIVE file (.xodr, ASAM OpenDRIVE 1.4 to 1.8).

Read are the geometry of the plan view (line, arc, spiral, poly3, paramPoly3), elevation,
superelevation and the speed limit of each road; lanes and their offsets, junctions, signals and
objects are not. The geometry gives curvature over arc length directly; only the polynomials are
sampled.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import inf, pi
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, TreeBuilder, XMLParser

import numpy as np

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import open_regular
from sim_bridge.scenario.limits import LONGEST_ROAD_M
from sim_bridge.scenario.maps.plan_view import Pose, attribute, plan_view, require_joint, within
from sim_bridge.scenario.table import Table, chained, joined

LARGEST_MB = 128
"""size of a file; its tree takes about ten times as much memory"""
_NO_LIMIT = ("no limit", "undefined")
_MPS_PER_UNIT = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
_Record = tuple[float, tuple[float, ...]]
"""s where a polynomial begins, and its four coefficients in ascending powers"""


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
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    roads = {road.get("id", ""): road for road in root.findall("road")}
    if root.tag != "OpenDRIVE" or not roads:
        raise ConfigError(f"{path}: expected an OpenDRIVE file with roads, found <{root.tag}>.")
    own = [name for name, road in roads.items() if road.get("junction", "-1") == "-1"]
    own = own or list(roads)
    listed = ", ".join(f"{name} ({roads[name].get('length')} m)" for name in own[:20])
    ids = ids or own
    if ids is own and len(own) != 1:
        raise ConfigError(
            f"{path}: expected the ids of the roads to drive on, because there are {len(own)}, "
            f"found none. Name some of {listed}."
        )
    lines: list[ReferenceLine] = []
    for name in ids:
        is_against = name.startswith("-") and name not in roads
        road = roads.get(name.removeprefix("-") if is_against else name)
        if road is None:
            raise ConfigError(f"{path}: expected a road of {listed}, found {name!r}.")
        try:
            with within(f"road {name}"):
                line = _line_of(road)
            lines.append(_against(line) if is_against else line)
        except ValueError as error:
            raise ConfigError(f"{path}: expected readable roads, found: {error}.") from error
    for (before, line), (after, following) in pairwise(zip(ids, lines, strict=True)):
        try:
            require_joint(line.end, following.start)
        except ValueError as error:
            raise ConfigError(
                f"{path}: roads {before} and {after}: {error}. Name roads in driving order, with a "
                f"minus sign where the drive is against their reference line."
            ) from error
    lengths = [line.length_m for line in lines]
    if sum(lengths) > LONGEST_ROAD_M:
        raise ConfigError(
            f"{path}: expected roads of at most {LONGEST_ROAD_M:g} m in total, found "
            f"{sum(lengths):g} m. Name fewer roads."
        )
    return ReferenceLine(
        joined([line.curvature_per_m for line in lines], lengths),
        joined([line.bank_rad for line in lines], lengths),
        joined([line.grade for line in lines], lengths),
        joined([line.speed_limit_mps for line in lines], lengths),
        sum(lengths),
        lines[0].start,
        lines[-1].end,
    )


def _line_of(road: Element) -> ReferenceLine:
    piece = plan_view(road)
    curvature = chained(piece.ramps)
    length_m = curvature.end
    rises = _cubics(road, "elevationProfile/elevation")
    slopes = [(s, (b, 2.0 * c, 3.0 * d, 0.0)) for s, (_, b, c, d) in rises]
    limits = [(attribute(r, "s"), (_limit_of(r), 0.0, 0.0, 0.0)) for r in road.findall("type")]
    return ReferenceLine(
        curvature_per_m=curvature,
        bank_rad=_table(_cubics(road, "lateralProfile/superelevation"), 0.0, length_m),
        grade=_table(slopes, 0.0, length_m),
        speed_limit_mps=_table(limits, inf, length_m),
        length_m=length_m,
        start=piece.start,
        end=piece.end,
    )


def _cubics(road: Element, path: str) -> list[_Record]:
    """The polynomials of elevation or superelevation."""
    return [
        (attribute(each, "s"), tuple(attribute(each, name) for name in "abcd"))
        for each in road.findall(path)
    ]


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
    limit_mps = attribute(speed, "max") * _MPS_PER_UNIT[unit]
    if limit_mps <= 0.0:
        raise ValueError(
            f"max above 0, {' or '.join(_NO_LIMIT)} expected in <speed>, found {speed.get('max')}"
        )
    return limit_mps


def _against(line: ReferenceLine) -> ReferenceLine:
    start, end = (pose._replace(yaw_rad=pose.yaw_rad + pi) for pose in (line.end, line.start))
    return ReferenceLine(
        line.curvature_per_m.backwards(line.length_m).scaled(-1.0),
        line.bank_rad.backwards(line.length_m).scaled(-1.0),
        line.grade.backwards(line.length_m).scaled(-1.0),
        line.speed_limit_mps.backwards(line.length_m),
        line.length_m,
        start,
        end,
    )
