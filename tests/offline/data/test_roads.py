"""Roads that turn about as the car does."""

from dataclasses import replace

import numpy as np
import pytest

from offline.config import PRESETS, STEPS
from offline.data.recording import Recording
from offline.data.roads import LARGEST_PER_M, RoadsNearCar, roads_near_car
from offline.data.sampling import validation_batch
from offline.data.signals import fit_scaling
from rt_controller.contract.car import DEFAULT_CAR


def turning(speed_mps: float, yaw_rate_radps: float) -> Recording:
    """A car that turns only in the second half."""
    x = np.zeros((3 * STEPS, 3), dtype=np.float32)
    x[:, 0] = speed_mps
    x[STEPS + 20 :, 2] = yaw_rate_radps
    none = np.zeros((len(x), 0), dtype=np.float32)
    return Recording(x, none, none, np.zeros((len(x), 3)), np.array([0]))


@pytest.mark.parametrize(("speed", "yaw_rate"), [(10.0, 0.4), (25.0, -0.1)])
def test_the_road_has_the_mean_curvature_of_the_window_and_some_noise(speed, yaw_rate):
    roads, normal = RoadsNearCar(turning(speed, yaw_rate)), np.linspace(-1.0, 1.0, 5)
    rows = np.array([0, STEPS, STEPS + 20, 2 * STEPS - 1, STEPS + 20])
    share = np.array([0.0, 0.75, 1.0, 1.0, 1.0])
    mean = roads.draw(rows, np.zeros(5))
    np.testing.assert_allclose(mean, share * yaw_rate / speed, rtol=1e-5, atol=1e-9)
    sideways_m = 0.5 * (roads.draw(rows, normal) - mean) * (2.0 * speed) ** 2
    np.testing.assert_allclose(sideways_m, 2.5 * normal, atol=1e-3)


def test_no_road_is_tighter_than_a_plan_may_turn_on_it():
    for speed, most in ((30.0, DEFAULT_CAR.plan_lateral_mps2 / 900.0), (3.0, LARGEST_PER_M)):
        found = RoadsNearCar(turning(speed, 0.8)).draw(np.full(4, STEPS), np.array([30, -30, 9, 0]))
        assert np.abs(found).max() == pytest.approx(most)
        assert found.min() < 0.0 < found.max()


def test_such_roads_need_poses_and_the_motion_of_a_car(toy_dataset):
    assert roads_near_car(toy_dataset) is not None
    recording = toy_dataset.recording._replace(pose=np.zeros((0, 3)))
    assert roads_near_car(replace(toy_dataset, recording=recording)) is None
    schema = toy_dataset.schema
    other = replace(schema, states=schema.states[::-1])
    manifest = replace(toy_dataset.manifest, schema=other)
    assert roads_near_car(replace(toy_dataset, manifest=manifest)) is None


@pytest.mark.parametrize(("changes", "least", "most"), [
    ({"near_roads": 0.0}, 0.0, 0.0), ({"windows": "slices"}, 0.0, 0.0),
    ({"near_roads": 0.5}, 0.2, 0.8), ({"near_roads": 1.0}, 1.0, 1.0),
])  # fmt: skip
def test_a_share_of_the_validation_part_has_roads_near_the_car(toy_dataset, changes, least, most):
    config = PRESETS["recommended"].model_copy(update=changes)
    scaling = fit_scaling(toy_dataset.select("train"), toy_dataset.schema, toy_dataset.roles)
    batch = validation_batch(toy_dataset, scaling, config)
    stored = toy_dataset.select("validation").w[:, 0, 0]
    differs = np.abs(batch.w[0, :, 0].numpy() * scaling.w_scale[0] - stored) > 1e-6
    assert least <= differs.mean() <= most
