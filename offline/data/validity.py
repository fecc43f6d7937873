"""The ranges of the training data of a car, which a bundle carries: `Validity`."""

import numpy as np

from offline.data.dataset import Dataset
from offline.data.manifest import Simulated
from offline.data.roads import roads_near_car
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import VEHICLE, InputColumn, StateColumn
from rt_controller.model.validity import Validity
from sim_bridge.plant.parameters import default_car

KNOTS = 9
"""speeds at which the largest values are stored"""
TAIL = 0.001
"""share of the samples that is left out at each end of a range: rare ones teach little"""


def validity_of(dataset: Dataset, has_near_roads: bool) -> Validity | None:
    """The ranges of the training part; None if the signals are not those of the car.

    Where left and right are exchanged in the learning, both sides count as one; otherwise the
    smaller one counts. `has_near_roads`: a share of the windows is on roads near the car's turn.
    """
    if dataset.schema != VEHICLE:
        return None
    train = dataset.select("train")
    x, u = train.x[:, :-1].astype(np.float64), train.u.astype(np.float64)
    speed = x[..., StateColumn.vx_mps]
    lateral = speed * x[..., StateColumn.yaw_rate_radps]
    steer = u[..., InputColumn.steer_rad]
    curvature = train.w[..., 0].astype(np.float64)
    near_car = roads_near_car(dataset) if has_near_roads else None
    if near_car is not None:
        is_trained = np.isin(dataset.slices.episode, dataset.episodes("train"))
        rows = dataset.slices.row[is_trained]
        drawn = near_car.draw(rows, np.random.default_rng(0).standard_normal(len(rows)))
        larger = np.maximum(np.abs(drawn)[:, None], np.abs(curvature))
        curvature = np.copysign(larger, drawn[:, None])
    low_mps, high_mps = np.maximum(np.quantile(speed, [TAIL, 1.0 - TAIL]), 0.0).tolist()
    knots = np.linspace(low_mps, max(high_mps, low_mps + 1.0), KNOTS)
    nearest = np.rint((speed - knots[0]) / (knots[1] - knots[0])).astype(int)
    is_mirrored = dataset.roles.odd is not None
    at_knots = [nearest == k for k in range(KNOTS)]

    def largest(signal: Array) -> Array:
        return np.array([_largest(signal[at], is_mirrored) for at in at_knots])

    by_speed = largest(lateral), largest(steer), largest(curvature)
    return Validity(knots, *by_speed, _conditions(dataset))


def _largest(values: Array, is_mirrored: bool) -> float:
    """The largest magnitude on the side where it is smaller; 0 without values."""
    if values.size == 0:
        return 0.0
    if is_mirrored:
        values = np.concatenate([values, -values])
    low, high = np.quantile(values, [TAIL, 1.0 - TAIL])
    return float(max(min(-low, high), 0.0))


def _conditions(dataset: Dataset) -> Array:
    """(4, 2) as `CONDITIONS`, or (0, 2) where they are not known: in logs."""
    if not isinstance(dataset.origin, Simulated):
        return np.zeros((0, 2))
    car, recorded = default_car(), dataset.recording.conditions
    friction = car.road.friction_left
    if recorded is None:
        nominal = np.array([friction, car.road.grade_rad, car.road.bank_rad, 0.0])
        return np.stack([nominal, nominal], axis=1)
    is_trained = np.isin(
        np.repeat(np.arange(len(dataset.part)), dataset.recording.lengths),
        dataset.episodes("train"),
    )
    rows = dict(zip(dataset.manifest.conditions, recorded[is_trained].T, strict=True))
    found = (
        np.minimum(rows["friction_left"], rows["friction_right"]),
        np.tan(rows["grade_rad"]),
        rows["bank_rad"],
        (rows["mass_factor"] - 1.0) * car.body.mass_kg,
    )
    limits: Array = np.quantile(np.stack(found), [TAIL, 1.0 - TAIL], axis=1).T
    return limits
