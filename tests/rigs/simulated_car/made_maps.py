"""Small OpenDRIVE maps and CommonRoad scenarios, written by hand."""

from pathlib import Path

import numpy as np

LINE, ARC = "<line/>", '<arc curvature="0.01"/>'
SPIRAL = '<spiral curvStart="0.0" curvEnd="0.01"/>'
_CURVATURES = {LINE: (0.0, 0.0), ARC: (0.01, 0.01), SPIRAL: (0.0, 0.01)}

Pieces = list[tuple[float, str]]
Pose = tuple[float, float, float]
"""x and y in m, direction in rad"""
ORIGIN = (0.0, 0.0, 0.0)


def end_of(pieces: Pieces, start: Pose = ORIGIN) -> Pose:
    """Where lines, arcs and spirals in a row end."""
    x, y, yaw = start
    for length, shape in pieces:
        first, last = _CURVATURES.get(shape, (0.0, 0.0))
        s = np.linspace(0.0, length, 2001)
        along = yaw + first * s + 0.5 * (last - first) * s**2 / length
        x += float(np.trapezoid(np.cos(along), s))
        y += float(np.trapezoid(np.sin(along), s))
        yaw = float(along[-1])
    return x, y, yaw


def road(
    pieces: Pieces, name: str = "1", extra: str = "", start: Pose = ORIGIN, junction: str = "-1"
) -> str:
    """One road of geometries with their lengths."""
    s, geometry = 0.0, ""
    for i, (length, shape) in enumerate(pieces):
        x, y, yaw = end_of(pieces[:i], start)
        geometry += f'<geometry s="{s}" x="{x}" y="{y}" hdg="{yaw}" length="{length}">{shape}'
        geometry += "</geometry>"
        s += length
    return (
        f'<road name="" length="{s}" id="{name}" junction="{junction}">'
        f"<planView>{geometry}</planView>{extra}</road>"
    )


def write_map(path: Path, *roads: str) -> Path:
    """An OpenDRIVE file."""
    header = '<header revMajor="1" revMinor="6"/>'
    path.write_text(f'<?xml version="1.0"?><OpenDRIVE>{header}{"".join(roads)}</OpenDRIVE>')
    return path


def _bound(tag: str, points: np.ndarray) -> str:
    inside = "".join(f"<point><x>{x:.6f}</x><y>{y:.6f}</y></point>" for x, y in points)
    return f"<{tag}>{inside}</{tag}>"


def lanelet(name: str, centre: np.ndarray, *links: str, width: float = 3.5) -> str:
    """A lanelet around centre points (n, 2)."""
    along = np.gradient(centre, axis=0)
    left = np.column_stack((-along[:, 1], along[:, 0])) / np.hypot(*along.T)[:, None]
    bounds = _bound("leftBound", centre + 0.5 * width * left) + _bound(
        "rightBound", centre - 0.5 * width * left
    )
    return f'<lanelet id="{name}">{bounds}{"".join(links)}</lanelet>'


def planning_problem(
    x: float, y: float, yaw_rad: float, speed_mps: float, goal: str, time: str = ""
) -> str:
    """A planning problem whose goal state contains `goal`."""
    exact = "<{0}><exact>{1}</exact></{0}>"
    start = f"<position><point><x>{x}</x><y>{y}</y></point></position>" + "".join(
        exact.format(tag, value)
        for tag, value in (
            ("orientation", yaw_rad), ("time", 0), ("velocity", speed_mps), ("yawRate", 0.0),
            ("slipAngle", 0.0),
        )
    )  # fmt: skip
    time = time or "<time><intervalStart>0</intervalStart><intervalEnd>200</intervalEnd></time>"
    return (
        f'<planningProblem id="100"><initialState>{start}</initialState>'
        f"<goalState>{goal}{time}</goalState></planningProblem>"
    )


def write_commonroad(path: Path, *parts: str, version: str = "2020a") -> Path:
    """A CommonRoad scenario."""
    head = (
        f'<commonRoad timeStepSize="0.1" commonRoadVersion="{version}" author="tests" '
        f'affiliation="tests" source="made" benchmarkID="ZAM_Made-1_1_T-1" date="2025-01-01">'
        "<location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude>"
        "<gpsLongitude>999</gpsLongitude></location><scenarioTags><urban/></scenarioTags>"
    )
    path.write_text(f'<?xml version="1.0"?>{head}{"".join(parts)}</commonRoad>')
    return path


def straight(x0: float, x1: float, y: float = 0.0, n: int = 21) -> np.ndarray:
    """Points along x."""
    return np.column_stack((np.linspace(x0, x1, n), np.full(n, y)))


def arc(x0: float, radius: float, turn_rad: float, n: int = 31) -> np.ndarray:
    """Points of a left bend that begins at (x0, 0) along x."""
    angle = np.linspace(0.0, turn_rad, n)
    return np.column_stack((x0 + radius * np.sin(angle), radius * (1.0 - np.cos(angle))))
