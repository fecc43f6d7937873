"""Dictionary models of the motion of a car, completed by the path."""

from dataclasses import replace

import numpy as np
from made_drives import drive, predict

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.model import LiftedModel
from offline.baselines.dictionary.motion import fit_motion, motion_part
from offline.baselines.dictionary.search import EdmdSettings, fit_edmd
from offline.baselines.road_path import path_states, split_path
from offline.baselines.score import log_error

SETTINGS = EdmdSettings(Family.NONE, past_steps=(2,), ridges=(1e-9,))


def test_the_motion_is_predicted_by_the_dictionary_and_the_path_by_kinematics(toy_dataset):
    model = fit_motion(toy_dataset, SETTINGS)
    windows = toy_dataset.select("test")
    x, u, w, past = (series.astype(np.float64) for series in windows[:4])
    states = model.predict(x[:, 0], past, u, w)
    motion = model.motion.predict(x[:, 0, :3], past, u, w[..., :0])
    assert np.array_equal(states[:, 0], x[:, 0])
    assert np.array_equal(states[..., :3], motion)
    assert np.allclose(states[:, 1:, 3:], path_states(np, motion, x[:, 0], w[..., 0], 0.025))
    assert log_error(model, windows) < log_error(fit_edmd(toy_dataset, SETTINGS), windows)


def test_the_part_of_the_motion_has_neither_path_nor_roads(toy_dataset):
    part = motion_part(toy_dataset, split_path(toy_dataset.schema))
    assert part.schema.state_names == ("vx_mps", "vy_mps", "yaw_rate_radps")
    assert part.schema.exogenous == ()
    assert part.roles.centred == ("vx_mps",)
    assert set(part.roles.odd) == {"vy_mps", "yaw_rate_radps", "steer_rad"}
    whole = toy_dataset.select("train")
    assert np.array_equal(part.select("train").x, whole.x[..., :3])


def test_a_past_with_other_columns_is_reduced_to_those_of_the_motion(toy_dataset):
    """A history with a path state, which the model of the motion does not read."""
    roles = replace(toy_dataset.roles, past=("vx_mps", "yaw_rate_radps", "steer_rad"))
    data = replace(toy_dataset, manifest=replace(toy_dataset.manifest, roles=roles))
    model = fit_motion(data, SETTINGS)
    windows = data.select("test")
    reversed_order = replace(model, past=model.past[::-1])
    found, _ = predict(model, windows)
    assert model.past == (0, 1, 2)
    assert not np.allclose(found, predict(reversed_order, windows)[0])


def test_data_without_a_path_have_the_plain_dictionary():
    assert isinstance(fit_motion(drive(lambda x, u, w, b: 0.9 * x), SETTINGS), LiftedModel)
