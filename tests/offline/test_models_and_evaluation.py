"""From a checkpoint or a fit to a bundle that may drive, its card, and its first judgement."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest
import torch
from made_models import WITH_PAST
from made_models import make_bundle as made_bundle

from offline.baselines import lti as lti_rival
from offline.card import Fact, describe_model, write_card
from offline.checkpoint import load_checkpoint
from offline.comparison import compare, print_pooled
from offline.evaluate import mse
from offline.evaluation_figures import pooled_figures
from offline.export import choose_selftest, make_bundle, pass_gate
from offline.judgement import FAIR_LTI, ratios_to_rivals
from offline.predictor import BundlePredictor
from offline.provenance import describe_training
from offline.sheet import in_digits
from offline.train import train
from rt_controller.contract.artifact import Bilinear, Lift, LiftSample, load_bundle, save_bundle
from rt_controller.contract.errors import ArtifactError, DatasetError
from rt_controller.contract.follow import Follow
from rt_controller.session import shipped_model


@pytest.fixture(autouse=True)
def cache_of_its_own(monkeypatch, tmp_path):
    """Rivals are kept there once fitted."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def lti(toy_dataset):
    """A linear model that passes the gate, as if it were of the toy's data."""
    shipped = load_bundle(shipped_model("lti"))
    return replace(
        shipped,
        A=0.95 * shipped.A,
        training=describe_training({}, toy_dataset.origin),
        data_sha256=toy_dataset.sha256,
    )


@pytest.fixture
def checkpoint(tiny_recommended, new_run, toy_dataset):
    return trained(tiny_recommended, new_run, toy_dataset)


def trained(config, new_run, dataset):
    run = new_run(config)
    train(config, dataset, run)
    # A dozen steps leave A where it started, at the unit circle, by chance on either side of it.
    return with_operator(load_checkpoint(run.best), lambda A: A.mul_(0.98))


def test_lti_bundle_can_be_shipped_and_lifts_by_the_identity(lti, tmp_path):
    pass_gate(lti)
    save_bundle(tmp_path, lti, "card")
    bundle = load_bundle(tmp_path)
    lifted = BundlePredictor(bundle).lift(bundle.selftest)
    assert np.array_equal(lifted, bundle.selftest.x)


def test_bundle_prediction_is_one_lift_and_a_linear_roll_out(lti):
    rng = np.random.default_rng(0)
    x0, past = lti.selftest.x[:3], np.zeros((3, 20, 6))
    U, W = rng.normal(size=(3, 4, 3)), rng.normal(size=(3, 4, 1))
    predicted = BundlePredictor(lti).predict(x0, past, U, W)
    assert predicted.shape == (3, 5, 6)
    for b in range(3):
        x = x0[b]
        for k in range(4):
            x = lti.A @ x + lti.B_uc @ U[b, k] + lti.B_uw @ W[b, k] + lti.c
            assert np.allclose(predicted[b, k + 1], x, rtol=1e-12)


def test_a_frozen_bilinear_bundle_predicts_with_the_input_matrix_of_its_first_lifted_state():
    """Which is not read anew along the way, and looks at the last rows of the past."""
    bundle = made_bundle(WITH_PAST, rank=2, bend=0.05)
    bundle = replace(bundle, bilinear=bundle.bilinear._replace(follows=Follow.START))
    rng = np.random.default_rng(0)
    x0, past = bundle.selftest.x[:3], rng.normal(size=(3, 20, 6))
    U, W = rng.normal(size=(3, 4, 3)), rng.normal(size=(3, 4, 1))
    model = BundlePredictor(bundle)
    psi = model.lift(LiftSample(x0, W[:, 0], past[:, -4:]))
    B = bundle.input_matrix(psi)
    assert np.ptp(B, axis=0).max() > 1e-3
    for k in range(4):
        psi = psi @ bundle.A.T + np.einsum("bnm,bm->bn", B, U[:, k]) + bundle.c
        psi += W[:, k] @ bundle.B_uw.T
    assert np.allclose(model.predict(x0, past, U, W)[:, -1], psi[:, :6], rtol=1e-12)


def test_a_linear_bundle_is_judged_itself_and_not_the_one_that_would_be_fitted(toy_dataset, lti):
    worse = replace(lti, A=0.9 * lti.A)
    found = {}
    for bundle in (worse, lti):
        judgement = compare(bundle, toy_dataset)
        assert judgement.judged == ("lti",)
        assert judgement.rivals == ("lti-per-curvature", "persistence")
        found[bundle.sha256] = mse(judgement.library["lti"]).value[0]
    assert found[worse.sha256] > found[lti.sha256]


def test_a_trained_bundle_passes_the_contract_and_carries_its_origin_and_its_errors(
    tiny_config, new_run, toy_dataset, tmp_path, capsys
):
    """The paper's network, on the way that an export takes."""
    checkpoint = trained(tiny_config, new_run, toy_dataset)
    bundle, gate = make_bundle(checkpoint, toy_dataset)
    judgement = compare(bundle, toy_dataset)
    assert judgement.names == ("mdk-net-paper", "lti", "lti-per-curvature", "persistence")
    assert FAIR_LTI in ratios_to_rivals(judgement, "mdk-net-paper")
    print_pooled(judgement)
    printed = capsys.readouterr().out
    for model in pooled_figures(judgement)["models"].values():
        assert in_digits(model["mse"]["ey_m_squared"]["value"]) in printed

    save_bundle(tmp_path, bundle, write_card(bundle, gate, judgement, [Fact("preset", "tiny")]))
    loaded = load_bundle(tmp_path)
    assert loaded.sha256 == bundle.sha256
    assert loaded.data_sha256 == toy_dataset.sha256
    assert f'"step": {checkpoint.step}' in loaded.training
    assert loaded.selftest.x.shape == (32, 6)
    assert gate.parity < 1e-5
    card = (tmp_path / "card.md").read_text()
    assert "| preset | tiny |" in card
    assert bundle.sha256 in card


def test_the_card_shows_every_error_with_its_interval(lti, toy_dataset):
    judgement = compare(lti, toy_dataset)
    card = write_card(lti, pass_gate(lti), judgement, [])
    for scores in judgement.library.values():
        value, low, high = (float(part[4]) for part in mse(scores))
        assert f"{in_digits(value)} ({in_digits(low, 3)}–{in_digits(high, 3)})" in card


def test_the_card_says_what_the_lift_is_shown_and_how_the_inputs_act(lti):
    plain = dict(describe_model(lti))
    assert plain["input matrix"] == "constant"
    assert "curvature" not in plain["observables"]
    n = lti.n_observables
    richer = replace(
        lti,
        lift=Lift(("x", "w", "history"), 4, ("vx_mps", "steer_rad")),
        bilinear=Bilinear(np.zeros((3, n, 3)), np.zeros((3, 3, n)), np.zeros((3, 3))),
    )
    found = dict(describe_model(richer))
    assert "rank 3, following the lifted state" in found["input matrix"]
    frozen = replace(richer, bilinear=richer.bilinear._replace(follows=Follow.START))
    assert "rank 3, frozen at the first" in dict(describe_model(frozen))["input matrix"]
    assert "curvature_per_m" in found["observables"]
    assert "the last 4 periods (100 ms) of vx_mps, steer_rad" in found["observables"]


def with_operator(checkpoint, edit):
    model = {name: tensor.clone() for name, tensor in checkpoint.model.items()}
    edit(model["A_rows"])
    return replace(checkpoint, model=model)


def test_a_model_is_exported_with_the_data_it_was_trained_on(checkpoint, toy_dataset):
    manifest = replace(toy_dataset.manifest, sha256="another")
    with pytest.raises(DatasetError, match="trained on"):
        make_bundle(checkpoint, replace(toy_dataset, manifest=manifest))


def test_a_bundle_says_which_episodes_it_was_trained_on(checkpoint, toy_dataset):
    """Whatever the configuration says: the data set knows better."""
    lti_bundle = lti_rival.as_bundle(
        "lti",
        lti_rival.fit_linear(toy_dataset),
        toy_dataset,
        choose_selftest(toy_dataset, Lift()),
    )
    mdk_net, _ = make_bundle(checkpoint, toy_dataset)
    for bundle in (mdk_net, lti_bundle):
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
    layers = sorted(name for name in model if name.startswith("encoder.layers."))
    for name in (*layers[-2:], "encoder.products.weights.weight"):
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
