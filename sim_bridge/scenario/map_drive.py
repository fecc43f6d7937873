"""A drive along a map: a road from a file, at the speed that its bends allow."""

from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from sim_bridge.scenario.limits import FASTEST_KMH, KMH_PER_MPS
from sim_bridge.scenario.road import OpenDrive
from sim_bridge.scenario.speed import CurveSpeed
from sim_bridge.scenario.table import Table

UNLIMITED_MPS = 50.0 / KMH_PER_MPS
"""where a map names no speed limit"""
_COMFORT = CurveSpeed(kind="curve_speed", max_kmh=FASTEST_KMH, lateral_mps2=2.5)
_SPARE_S = 3.0
"""added to the time that the reference needs"""


def content_of_map(path: Path, roads: str) -> dict[str, Any]:
    """The content of a scenario file for a drive along roads of an OpenDRIVE file.

    Args:
        path: the file.
        roads: ids in driving order with commas between them; "": the only road of the file.

    Raises:
        ConfigError: the file cannot be read, or there are no such roads.
    """
    ids = tuple(name.strip() for name in roads.split(",") if name.strip())
    source = OpenDrive(file=path, roads=ids)
    line = source.line
    named = line.speed_limit_mps.coefficients[:, :1]
    known = np.where(np.isfinite(named), named, UNLIMITED_MPS)
    known = np.minimum(known, FASTEST_KMH / KMH_PER_MPS)
    fastest = Table(line.speed_limit_mps.starts, np.pad(known, ((0, 0), (0, 3))))
    speed = _COMFORT.profile(line.curvature_per_m, line.length_m, fastest)
    s_m = np.linspace(0.0, line.length_m, max(2, ceil(line.length_m)))
    mps = np.array([max(speed.at(s, 0.0), 0.5) for s in s_m.tolist()])
    needed_s = _SPARE_S + float(np.sum(np.diff(s_m) * 2.0 / (mps[1:] + mps[:-1])))
    return {
        "format": 2,
        "name": path.stem,
        "duration_s": needed_s,
        "road": {"opendrive": source},
        "reference": {"speed_kmh": speed},
    }
