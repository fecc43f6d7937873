"""A drive along a map: a road from a file, at the speed that its bends allow."""

from math import ceil
from pathlib import Path

import numpy as np

from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario.curve_speed import Comfort, curve_speed
from sim_bridge.scenario.limits import (
    DRY_ASPHALT,
    FASTEST_KMH,
    KMH_PER_MPS,
    LONGEST_S,
)
from sim_bridge.scenario.maps.opendrive import read_reference_line
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.scenario import Scenario, Start
from sim_bridge.scenario.speed import SpeedProfile
from sim_bridge.scenario.table import Table, constant

UNLIMITED_MPS = 50.0 / KMH_PER_MPS
"""where a map names no speed limit"""
LARGEST_MPS = FASTEST_KMH / KMH_PER_MPS
MAP_COMFORT = Comfort(lateral_mps2=2.5)
_SPARE_S = 3.0
"""added to the time that the reference needs"""


def scenario_of_map(path: Path, roads: str) -> Scenario:
    """A drive along roads of an OpenDRIVE file.

    Args:
        path: the file.
        roads: ids in driving order with commas between them; "": the only road of the file.

    Raises:
        ConfigError: the file cannot be read, there are no such roads, or the drive is too long.
    """
    ids = [name.strip() for name in roads.split(",") if name.strip()]
    line = read_reference_line(path, ids)
    limits = line.speed_limit_mps
    named = limits.coefficients[:, :1]
    known = np.minimum(np.where(np.isfinite(named), named, UNLIMITED_MPS), LARGEST_MPS)
    fastest = Table(limits.starts, np.pad(known, ((0, 0), (0, 3))))
    speed = curve_speed(line.curvature_per_m, fastest, line.length_m, MAP_COMFORT)
    road = Road(
        curvature_per_m=line.curvature_per_m,
        friction_left=constant(DRY_ASPHALT),
        friction_right=constant(DRY_ASPHALT),
        bank_rad=line.bank_rad,
        grade=line.grade,
        length_m=line.length_m,
    )
    start = Start(speed.at(0.0, 0.0))
    return Scenario(path.stem, time_needed_s(path, speed, 0.0, line.length_m), start, road, speed)


def time_needed_s(path: Path, speed: SpeedProfile, from_m: float, to_m: float) -> float:
    """Time in which the reference drives a distance, and a few seconds more.

    Raises:
        ConfigError: it is longer than a drive may be.
    """
    s_m = np.linspace(from_m, to_m, max(2, ceil(to_m - from_m)))
    mps = np.array([max(speed.at(s, 0.0), 0.5) for s in s_m.tolist()])
    needed_s = _SPARE_S + float(np.sum(np.diff(s_m) * 2.0 / (mps[1:] + mps[:-1])))
    if needed_s > LONGEST_S:
        raise ConfigError(
            f"{path}: expected a drive of at most {LONGEST_S:g} s, found {needed_s:.0f} s for "
            f"{to_m - from_m:.0f} m. Choose a shorter route."
        )
    return needed_s
