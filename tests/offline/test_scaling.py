"""Scaling keeps the zeros that mean something."""

import numpy as np

from offline.scaling import fit_scaling


def fit(dataset):
    return fit_scaling(*dataset.select("train")[:3])


def test_scaled_training_data_have_unit_spread(toy_dataset):
    scaling = fit(toy_dataset)
    scaled = scaling.normalise_states(toy_dataset.select("train").x)
    assert np.allclose(np.sqrt(np.mean(scaled**2, axis=(0, 1))), 1.0, rtol=1e-6)


def test_only_speed_and_progress_are_centred(toy_dataset):
    scaling = fit(toy_dataset)
    assert np.flatnonzero(scaling.x_centre).tolist() == [0, 3]


def test_a_mirrored_drive_stays_a_mirror_image(toy_dataset):
    mirror = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    scaling = fit(toy_dataset)
    x = toy_dataset.trajectories.x
    assert np.allclose(scaling.normalise_states(x * mirror), scaling.normalise_states(x) * mirror)


def test_restoring_undoes_normalising(toy_dataset):
    scaling = fit(toy_dataset)
    x = toy_dataset.trajectories.x.astype(np.float64)
    assert np.allclose(scaling.restore_states(scaling.normalise_states(x)), x)


def test_other_parts_do_not_touch_the_scaling(toy_dataset):
    train = toy_dataset.select("train")
    everything = toy_dataset.trajectories
    assert not np.allclose(fit_scaling(*everything[:3]).x_scale, fit_scaling(*train[:3]).x_scale)


def test_a_signal_that_never_moves_keeps_its_unit(toy_dataset):
    train = toy_dataset.select("train")
    still = np.zeros_like(train.u)
    scaling = fit_scaling(train.x, still, np.zeros_like(train.kappa))
    assert np.array_equal(scaling.u_scale, np.ones(4))
