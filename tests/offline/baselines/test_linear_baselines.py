"""Linear models: for all roads, and for each road."""

import json
from dataclasses import replace

import made_drives
import numpy as np
import pytest
from made_drives import drive

from offline.baselines.linear import (
    LinearModel,
    LinearPerCurvature,
    fit_linear,
    fit_one_step,
    fit_per_curvature,
    to_bundle,
)
from offline.config import PAST_STEPS
from offline.data.generate import steering_geometry
from offline.data.signals import past_names
from offline.model.bundle_predictor import BundlePredictor
from offline.model.physical_units import choose_selftest
from rt_controller.contract.errors import DatasetError
from rt_controller.model.artifact import load_bundle, save_bundle
from rt_controller.model.lift import Lift

A = np.array([[0.97, 0.01, 0.0], [0.05, 1.0, 0.0], [0.0, 0.02, 0.9]])
B = np.array([[0.1, 0.0], [0.0, 0.02], [-0.05, 0.1]])
B_W = np.array([[0.02], [0.0], [0.01]])
C = np.array([0.03, -0.01, 0.0])


def linear_step(x, u, w, u_before):
    return x @ A.T + u @ B.T + w @ B_W.T + C


@pytest.fixture(scope="module")
def linear():
    return drive(linear_step)


def test_least_squares_finds_the_matrices_and_offset_of_a_linear_system(linear):
    found = fit_linear(linear).matrices
    assert np.allclose(found.A, A, atol=1e-5)
    assert np.allclose(found.B_uc, B, atol=1e-5)
    assert np.allclose(found.B_uw, B_W, atol=1e-5)
    assert np.allclose(found.c, C, atol=1e-5)


def test_least_squares_is_the_solution_of_all_transitions_at_once(toy_dataset):
    """Against numpy's solver on the whole problem in physical units."""
    train = toy_dataset.select("train")
    x, u, w = (series.astype(float) for series in train[:3])
    regressors = np.concatenate([x[:, :-1], u, w, np.ones((*u.shape[:2], 1))], axis=-1)
    regressors, targets = regressors.reshape(-1, 11), x[:, 1:].reshape(-1, 6)
    expected, *_ = np.linalg.lstsq(regressors, targets, rcond=None)
    lti = fit_linear(toy_dataset).matrices
    found = np.vstack([lti.A.T, lti.B_uc.T, lti.B_uw.T, lti.c])
    assert np.allclose(regressors @ found, regressors @ expected, atol=1e-5)


def sample_of(dataset):
    """Instants with states, exogenous signals and the whole past."""
    names = past_names(dataset.schema, dataset.roles)
    return choose_selftest(dataset, Lift(True, PAST_STEPS, names))


def test_the_bundle_predicts_what_the_model_predicts(toy_dataset, tmp_path):
    bundle = to_bundle("lti", fit_linear(toy_dataset), toy_dataset, sample_of(toy_dataset))
    save_bundle(tmp_path, bundle, "card")
    by_bundle, _ = made_drives.predict(
        BundlePredictor(load_bundle(tmp_path)), toy_dataset.select("test")
    )
    by_model, _ = made_drives.predict(fit_linear(toy_dataset), toy_dataset.select("test"))
    assert np.allclose(by_bundle, by_model, rtol=1e-6, atol=1e-8)


def test_a_linear_bundle_has_its_kind_and_data_set(toy_dataset):
    bundle = to_bundle("lti", fit_linear(toy_dataset), toy_dataset, sample_of(toy_dataset))
    training = json.loads(bundle.training)
    assert bundle.name == "lti"
    assert bundle.geometry is toy_dataset.car is None
    known = replace(
        toy_dataset, manifest=replace(toy_dataset.manifest, geometry=steering_geometry())
    )
    assert (
        to_bundle("lti", fit_linear(known), known, sample_of(known)).geometry == steering_geometry()
    )
    assert bundle.data_sha256 == toy_dataset.sha256
    assert (training["kind"], training["episodes"], training["data_seed"]) == ("lti", 40, 3)


def test_windows_of_other_signals_are_refused(linear, toy_dataset):
    with pytest.raises(DatasetError, match=r"expected x0 \(batch, 3\)"):
        made_drives.predict(fit_linear(linear), toy_dataset.select("test"))


def test_the_model_of_a_road_is_fitted_to_its_trajectories(toy_dataset):
    model = fit_per_curvature(toy_dataset)
    assert model.curvature_per_m.tolist() == [-4e-3, 0.0, 4e-3]
    train = toy_dataset.select("train")
    on_it = train.take(train.w[:, 0, 0] == np.float32(4e-3))
    alone = fit_one_step(on_it, toy_dataset.schema, toy_dataset.roles, sees_exogenous=False)
    among, _ = made_drives.predict(model, on_it)
    expected, _ = made_drives.predict(LinearModel(alone), on_it)
    assert np.allclose(among, expected)


def test_models_are_interpolated_between_roads_and_constant_beyond_them():
    model = LinearPerCurvature(
        curvature_per_m=np.array([0.0, 2e-3]),
        A=np.array([[[0.0]], [[0.0]]]),
        B_uc=np.zeros((2, 1, 1)),
        c=np.array([[1.0], [3.0]]),
    )
    kappa = np.array([0.0, 5e-4, 1e-3, 2e-3, 9e-3, -1.0])
    W = np.repeat(kappa[:, None, None], 2, axis=1)
    found = model.predict(np.zeros((6, 1)), np.zeros((6, 0, 1)), np.zeros((6, 2, 1)), W)
    assert np.allclose(found[:, 2, 0], [1.0, 1.5, 2.0, 3.0, 3.0, 1.0])
