"""How files name what the checks of a scenario refuse."""

from typing import NamedTuple


class FieldNames(NamedTuple):
    """Names that messages begin with; a road and an initial state are named alike everywhere."""

    path: str = "reference.ey_m"
    speed: str = "reference.speed_kmh"
    curvature: str = "road.curvature_per_m"


FORMAT_1 = FieldNames("moves", "speed_kmh", "curvature_per_m")
FORMAT_2 = FieldNames()
MAP = FieldNames("path of the map", "speed on the map", "the map")
