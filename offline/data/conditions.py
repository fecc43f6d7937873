"""Conditions of simulated drives: road, wind, load and tyres, which the state does not contain."""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from offline.data.excitation import monotone_cubic
from offline.data.variation import NOMINAL, Variation
from rt_controller.contract.arrays import Array
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.parameters import (
    Parameters,
    default_car,
    with_cornering_stiffness,
    with_mass_factor,
    with_payload,
)
from sim_bridge.plant.parts import Payload, RoadParameters

Range = tuple[float, float]

CONDITIONS = (*RoadParameters._fields, "mass_factor", "cg_ahead_m", "stiffness_factor")
"""columns: road and wind in the axes of the car; mass with the load, relative to the car file;
shift of the centre of gravity by the load, positive forward; cornering stiffness, relative to the
car file"""
FRICTION_COLUMNS = [CONDITIONS.index("friction_left"), CONDITIONS.index("friction_right")]

SLOW_KNOT_S = 5.0
"""spacing of the random points of bank, grade and mean wind in a changing episode"""
GUST_KNOT_S = 1.5
PATCH_S = (0.5, 3.0)
"""duration of a patch, and of the road between two patches"""


class Conditions(NamedTuple):
    """The conditions of one episode."""

    car: Parameters
    """loaded, on the road of the first period"""
    roads: Array
    """(periods, 6) as `RoadParameters`"""
    rows: Array
    """(periods, q) as `CONDITIONS`"""


def draw_conditions(rng: np.random.Generator, variation: Variation, periods: int) -> Conditions:
    """The conditions of one episode: nominal, constant or changing."""
    kind = rng.random()
    is_changing = kind >= 1.0 - variation.changing_share
    if kind < variation.nominal_share:
        variation = NOMINAL
    nominal = default_car()
    payload = Payload(
        mass_kg=_draw(rng, variation.payload_kg, 0.0),
        ahead_m=_draw(rng, variation.payload_ahead_m, 0.0),
    )
    stiffness_factor = _draw(rng, variation.stiffness_factor, 1.0)
    car = with_mass_factor(nominal, _draw(rng, variation.mass_factor, 1.0))
    car = with_cornering_stiffness(with_payload(car, payload), stiffness_factor)
    roads = _draw_roads(rng, variation, nominal.road, periods, is_changing)
    load = (
        car.body.mass_kg / nominal.body.mass_kg,
        nominal.body.front_axle_m - car.body.front_axle_m,
        stiffness_factor,
    )
    return Conditions(
        car._replace(road=RoadParameters(*roads[0].tolist())),
        roads,
        np.hstack([roads, np.tile(load, (periods, 1))]),
    )


def _draw_roads(
    rng: np.random.Generator,
    variation: Variation,
    nominal: RoadParameters,
    periods: int,
    is_changing: bool,
) -> Array:
    """(periods, 6) as `RoadParameters`."""
    columns = {name: np.full(periods, value) for name, value in nominal._asdict().items()}
    if variation.friction is not None:
        level = rng.uniform(*variation.friction)
        columns["friction_left"][:] = columns["friction_right"][:] = level
    for name in ("bank_rad", "grade_rad", "wind_forward_mps", "wind_left_mps"):
        limits = getattr(variation, name)
        if limits is not None and is_changing:
            columns[name][:] = _draw_curve(rng, limits, SLOW_KNOT_S, periods)
        elif limits is not None:
            columns[name][:] = rng.uniform(*limits)
    if is_changing:
        gust = (-variation.gust_mps, variation.gust_mps)
        for name in ("wind_forward_mps", "wind_left_mps"):
            columns[name] += _draw_curve(rng, gust, GUST_KNOT_S, periods)
    roads = np.column_stack(list(columns.values()))
    if is_changing and variation.patch_friction is not None:
        _lay_patches(rng, variation.patch_friction, roads)
    return roads


def _lay_patches(rng: np.random.Generator, limits: Range, roads: Array) -> None:
    """Write patches of other friction into `roads`."""
    left, right = FRICTION_COLUMNS
    row = round(rng.uniform(0.0, PATCH_S[1]) / PERIOD_S)
    while row < len(roads):
        end = row + round(rng.uniform(*PATCH_S) / PERIOD_S)
        sides = ([left, right], [left], [right])[rng.integers(3)]
        roads[row:end, sides] = rng.uniform(*limits)
        row = end + round(rng.uniform(*PATCH_S) / PERIOD_S)


def _draw_curve(rng: np.random.Generator, limits: Range, spacing_s: float, periods: int) -> Array:
    """(periods,) values of a smooth curve through random points at equal distances in time."""
    t = PERIOD_S * np.arange(periods, dtype=np.float64)
    knot_t = spacing_s * np.arange(int(t[-1] / spacing_s) + 2, dtype=np.float64)
    return monotone_cubic(knot_t, rng.uniform(*limits, size=len(knot_t)), t)


def _draw(rng: np.random.Generator, limits: Range | None, otherwise: float) -> float:
    return otherwise if limits is None else float(rng.uniform(*limits))


EDGES = (0.0, 0.4, 0.55, 0.7, 0.85, 2.0)
"""of the bands of friction"""


@dataclass(frozen=True, slots=True)
class FrictionBand:
    """The episodes whose lowest friction lies in one band."""

    friction: tuple[float, float]
    """lowest friction in these episodes, first value included"""
    episodes: int
    rejected: int
    """drawn before them, under the same conditions"""

    @property
    def rejected_fraction(self) -> float:
        """Share of the drawn drives that were rejected."""
        return self.rejected / max(1, self.rejected + self.episodes)


def by_friction(lowest_friction: Array, rejected: Array) -> tuple[FrictionBand, ...]:
    """The bands that contain episodes, from the slippery end.

    Args:
        lowest_friction: (E,) of each episode, on either side.
        rejected: (E,) number of rejected drives before each.
    """
    bands = []
    for low, high in pairwise(EDGES):
        is_inside = (lowest_friction >= low) & (lowest_friction < high)
        if np.any(is_inside):
            count = int(np.sum(is_inside))
            bands.append(FrictionBand((low, high), count, int(np.sum(rejected[is_inside]))))
    return tuple(bands)
