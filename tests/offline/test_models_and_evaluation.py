"""The rivals, the bundle of a trained model, and the table that compares them."""

import json
from dataclasses import replace
from datetime import datetime

import numpy as np
import onnx
import pytest
import torch

from offline.baselines.lti import fit_lti
from offline.baselines.persistence import PersistencePredictor
from offline.card import Fact, write_card
from offline.checkpoint import load_checkpoint
from offline.comparison import compare
from offline.dataset import Dataset, Trajectories
from offline.evaluate import StateErrors, choose_test_trajectories, evaluate, squared_errors
from offline.export import choose_selftest_states, make_bundle, pass_gate
from offline.learner import Learner, normalise
from offline.predictor import BundlePredictor
from offline.rollout import roll_out
from offline.run_folder import create_run
from offline.train import train
from rt_controller.contract.artifact import load_bundle, save_bundle
from rt_controller.contract.errors import ArtifactError, DatasetError


@pytest.fixture(scope="module")
def lti(toy_dataset):
    return fit_lti(toy_dataset, choose_selftest_states(toy_dataset))


@pytest.fixture
def checkpoint(tiny_config, toy_folder, toy_dataset, tmp_path):
    run = create_run(
        tmp_path / "runs", tiny_config, toy_folder, toy_dataset.sha256, datetime(2026, 1, 1)
    )
    train(tiny_config, toy_dataset, run)
    return load_checkpoint(run.best)


def linear_dataset(toy_dataset) -> tuple[Dataset, np.ndarray, np.ndarray, np.ndarray]:
    """The toy's inputs driving a system that is linear with an offset."""
    rng = np.random.default_rng(0)
    A = 0.95 * np.eye(6) + 0.02 * rng.normal(size=(6, 6))
    B, c = 0.1 * rng.normal(size=(6, 4)), 0.1 * rng.normal(size=6)
    toy = toy_dataset.trajectories
    x = np.empty(toy.x.shape)
    x[:, 0] = toy.x[:, 0]
    for k in range(80):
        u = np.column_stack([toy.u[:, k], toy.kappa])
        x[:, k + 1] = x[:, k] @ A.T + u @ B.T + c
    trajectories = Trajectories(x.astype(np.float32), toy.u, toy.kappa, toy.episode)
    return Dataset(trajectories, toy_dataset.part, toy_dataset.manifest), A, B, c


def test_persistence_predicts_that_nothing_changes():
    x0 = np.arange(12.0).reshape(2, 6)
    predicted = PersistencePredictor().predict(x0, np.zeros((2, 3, 3)), np.zeros(2))
    assert predicted.shape == (2, 4, 6)
    assert np.array_equal(predicted[:, -1], x0)


def test_lti_finds_the_matrices_and_offset_of_a_linear_system(toy_dataset):
    dataset, A, B, c = linear_dataset(toy_dataset)
    found = fit_lti(dataset, choose_selftest_states(dataset))
    assert np.allclose(found.A, A, atol=1e-4)
    assert np.allclose(found.B_uc, B[:, :3], atol=1e-3)
    assert np.allclose(found.B_uw, B[:, 3:], atol=1e-2)
    assert np.allclose(found.c, c, atol=1e-3)


def test_lti_is_the_least_squares_solution_of_all_transitions_at_once(toy_dataset, lti):
    """Against numpy's solver on the whole problem in physical units."""
    train_part = toy_dataset.select("train")
    x, u = train_part.x.astype(float), train_part.u.astype(float)
    kappa = np.broadcast_to(train_part.kappa.astype(float)[:, None, None], (*u.shape[:2], 1))
    regressors = np.concatenate([x[:, :-1], u, kappa, np.ones_like(kappa)], axis=-1).reshape(-1, 11)
    targets = x[:, 1:].reshape(-1, 6)
    expected, *_ = np.linalg.lstsq(regressors, targets, rcond=None)
    found = np.vstack([lti.A.T, lti.B_uc.T, lti.B_uw.T, lti.c])
    assert np.allclose(regressors @ found, regressors @ expected, atol=1e-5)


def test_lti_bundle_can_be_shipped_and_lifts_by_the_identity(lti, tmp_path):
    pass_gate(lti)
    save_bundle(tmp_path, lti, "card")
    bundle = load_bundle(tmp_path)
    x = bundle.selftest_x
    assert np.array_equal(BundlePredictor(bundle).lift(x), x.astype(np.float32))


def test_bundle_prediction_is_one_lift_and_a_linear_roll_out(lti):
    rng = np.random.default_rng(0)
    x0, U, kappa = lti.selftest_x[:3], rng.normal(size=(3, 4, 3)), np.array([0.0, 1e-3, -2e-3])
    predicted = BundlePredictor(lti).predict(x0, U, kappa)
    assert predicted.shape == (3, 5, 6)
    for b in range(3):
        x = x0[b].astype(np.float32).astype(float)
        for k in range(4):
            x = lti.A @ x + lti.B_uc @ U[b, k] + lti.B_uw[:, 0] * kappa[b] + lti.c
            assert np.allclose(predicted[b, k + 1], x, rtol=1e-12)


def test_errors_are_in_the_squared_units_of_the_papers_table(toy_dataset):
    """Off by 1 m/s, 1 rad/s and 1 m everywhere."""
    test = toy_dataset.select("test")

    class Off:
        def predict(self, x0, U, kappa):
            return test.x + np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])

    found = evaluate({"off": Off()}, test).pooled["off"]
    degrees = np.degrees(1.0) ** 2
    assert found == pytest.approx(StateErrors(12.96, 12.96, degrees, 1.0, 1.0, degrees), rel=1e-4)


def test_the_first_state_is_measured_and_counts_for_nothing(toy_dataset):
    assert squared_errors(PersistencePredictor(), toy_dataset.select("test")).shape[1] == 80


def test_pooled_errors_are_the_mean_of_those_per_curvature(toy_dataset):
    test = toy_dataset.select("test")
    found = evaluate({"persistence": PersistencePredictor()}, test)
    weights = {kappa: np.mean(np.isclose(test.kappa, kappa)) for kappa in found.per_curvature}
    assert sum(weights.values()) == pytest.approx(1.0)
    for state in StateErrors._fields:
        mean = sum(
            weight * getattr(found.per_curvature[kappa]["persistence"], state)
            for kappa, weight in weights.items()
        )
        assert mean == pytest.approx(getattr(found.pooled["persistence"], state))


def test_a_linear_bundle_is_judged_itself_and_not_the_one_that_would_be_fitted(toy_dataset, lti):
    worse = replace(lti, A=0.9 * lti.A)
    assert compare(worse, toy_dataset).pooled["lti"].vx > compare(lti, toy_dataset).pooled["lti"].vx


def test_480_trajectories_of_each_curvature_are_judged():
    kappa = np.repeat(np.array([-1e-3, 2e-3], dtype=np.float32), [700, 300])
    n = len(kappa)
    everything = Trajectories(
        np.zeros((n, 2, 6), np.float32), np.zeros((n, 1, 3), np.float32), kappa, np.arange(n)
    )
    chosen = choose_test_trajectories(everything)
    assert np.unique(chosen.kappa, return_counts=True)[1].tolist() == [480, 300]


def test_bundle_of_a_trained_model_predicts_what_the_network_predicts(checkpoint, toy_dataset):
    bundle, _ = make_bundle(checkpoint, toy_dataset)
    test = toy_dataset.select("test")
    predicted = BundlePredictor(bundle).predict(
        test.x[:, 0].astype(float), test.u.astype(float), test.kappa.astype(float)
    )
    learner = Learner(checkpoint.config, checkpoint.scaling, toy_dataset.sha256)
    learner.restore(checkpoint)
    x, u = normalise(test, checkpoint.scaling)
    with torch.no_grad():
        A, B = learner.model.operator()
        psi = roll_out(learner.model.lift(x[:, 0]), A, u.transpose(0, 1) @ B.t())
    expected = checkpoint.scaling.restore_states(psi[..., :6].transpose(0, 1).numpy())
    assert np.allclose(predicted[:, 1:], expected, atol=1e-4)


def test_exported_bundle_passes_the_contract_and_carries_its_origin(
    checkpoint, toy_dataset, tmp_path
):
    bundle, gate = make_bundle(checkpoint, toy_dataset)
    evaluation = evaluate({"mdk-net": BundlePredictor(bundle)}, toy_dataset.select("test"))
    save_bundle(tmp_path, bundle, write_card(bundle, gate, evaluation, [Fact("preset", "paper")]))
    loaded = load_bundle(tmp_path)
    assert loaded.name == "mdk-net"
    assert loaded.data_sha256 == toy_dataset.sha256
    assert f'"step": {checkpoint.step}' in loaded.training
    assert loaded.selftest_x.shape == (32, 6)
    assert gate.parity < 1e-5
    card = (tmp_path / "card.md").read_text()
    assert "| preset | paper |" in card
    assert bundle.sha256 in card
    assert f"{evaluation.pooled['mdk-net'].ey:.4g}" in card


def with_operator(checkpoint, edit):
    model = {name: tensor.clone() for name, tensor in checkpoint.model.items()}
    edit(model["A_rows"])
    return replace(checkpoint, model=model)


def test_a_model_is_exported_with_the_data_it_was_trained_on(checkpoint, toy_dataset):
    manifest = replace(toy_dataset.manifest, sha256="another")
    with pytest.raises(DatasetError, match="trained on"):
        make_bundle(checkpoint, replace(toy_dataset, manifest=manifest))


def test_a_bundle_says_which_episodes_it_was_trained_on(checkpoint, lti, toy_dataset):
    """Whatever the configuration says: the data set knows better."""
    mdk_net, _ = make_bundle(checkpoint, toy_dataset)
    for bundle in (mdk_net, lti):
        training = json.loads(bundle.training)
        assert (training["episodes"], training["data_seed"]) == (40, 3)


def test_a_model_that_grows_without_bound_is_not_exported(checkpoint, toy_dataset):
    growing = with_operator(checkpoint, lambda A: A.mul_(1.06))
    with pytest.raises(ArtifactError, match="spectral radius"):
        make_bundle(growing, toy_dataset)


def test_a_model_with_a_nan_is_not_exported(checkpoint, toy_dataset):
    broken = with_operator(checkpoint, lambda A: A[0].fill_(torch.nan))
    with pytest.raises(ArtifactError, match="finite"):
        make_bundle(broken, toy_dataset)


def test_an_encoder_that_answers_otherwise_than_in_training_is_not_exported(lti):
    with pytest.raises(ArtifactError, match="torch and ONNX"):
        pass_gate(replace(lti, selftest_psi=lti.selftest_psi + 1e-2))


def test_a_small_latent_that_answers_otherwise_is_not_exported(checkpoint, toy_dataset):
    """By a ten-thousandth of its spread, which is far less than 1e-5."""
    bundle, _ = make_bundle(with_latents_of(checkpoint, 1e-3), toy_dataset)
    psi = bundle.selftest_psi.copy()
    psi[0, 6] += 1e-4 * bundle.spread[6]
    assert 1e-4 * bundle.spread[6] < 1e-5
    with pytest.raises(ArtifactError, match="of the spread of each observable"):
        pass_gate(replace(bundle, selftest_psi=psi))


def with_latents_of(checkpoint, size):
    """The same network with all latents so much smaller."""
    model = {name: tensor.clone() for name, tensor in checkpoint.model.items()}
    for name in sorted(name for name in model if name.startswith("encoder."))[-2:]:
        model[name] *= size
    return replace(checkpoint, model=model)


@pytest.mark.parametrize("encoder", [b"no encoder", "fixed batch"])
def test_an_encoder_that_lifts_no_batch_is_refused(lti, encoder):
    if encoder == "fixed batch":
        model = onnx.load_from_string(lti.encoder_onnx)
        for tensor in (*model.graph.input, *model.graph.output):
            tensor.type.tensor_type.shape.dim[0].dim_value = 2
        encoder = model.SerializeToString()
    with pytest.raises(ArtifactError, match="offline-export"):
        pass_gate(replace(lti, encoder_onnx=encoder))
