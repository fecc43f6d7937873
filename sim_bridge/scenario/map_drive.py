"""A drive along a map: a road from a file, at the speed that its bends allow."""

from math import ceil
from pathlib import Path

import numpy as np

from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario.limits import FASTEST_KMH, KMH_PER_MPS, LONGEST_S
from sim_bridge.scenario.road import OpenDrive, Road
from sim_bridge.scenario.scenario import Scenario, Start
from sim_bridge.scenario.speed import CurveSpeed
from sim_bridge.scenario.table import Table

UNLIMITED_MPS = 50.0 / KMH_PER_MPS
"""where a map names no speed limit"""
_COMFORT = CurveSpeed(kind="curve_speed", max_kmh=FASTEST_KMH, lateral_mps2=2.5)
_SPARE_S = 3.0
"""added to the time that the reference needs"""


def scenario_of_map(path: Path, roads: str) -> Scenario:
    """A drive along roads of an OpenDRIVE file.

    Args:
        path: the file.
        roads: ids in driving order with commas between them; "": the only road of the file.

    Raises:
        ConfigError: the file cannot be read, there are no such roads, they are out of the limits
            of a road, or the drive is too long.
    """
    ids = tuple(name.strip() for name in roads.split(",") if name.strip())
    source = OpenDrive(file=path, roads=ids)
    line = source.line
    named = line.speed_limit_mps.coefficients[:, :1]
    known = np.where(np.isfinite(named), named, UNLIMITED_MPS)
    known = np.minimum(known, FASTEST_KMH / KMH_PER_MPS)
    fastest = Table(line.speed_limit_mps.starts, np.pad(known, ((0, 0), (0, 3))))
    speed = _COMFORT.on_road(line.curvature_per_m, line.length_m, fastest)
    s_m = np.linspace(0.0, line.length_m, max(2, ceil(line.length_m)))
    mps = np.array([max(speed.at(s, 0.0), 0.5) for s in s_m.tolist()])
    needed_s = _SPARE_S + float(np.sum(np.diff(s_m) * 2.0 / (mps[1:] + mps[:-1])))
    if needed_s > LONGEST_S:
        raise ConfigError(
            f"{path}: expected a drive of at most {LONGEST_S:g} s, found {needed_s:.0f} s for "
            f"{line.length_m:.0f} m. Choose a shorter route."
        )
    road = Road.model_validate({"opendrive": source})
    start = Start.model_construct(speed_mps=speed.at(0.0, 0.0))
    return Scenario(path.stem, needed_s, start, road, speed)
