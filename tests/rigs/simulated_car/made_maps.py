"""Small OpenDRIVE maps, written by hand."""

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
