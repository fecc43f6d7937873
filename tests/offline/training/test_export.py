"""Checks of a bundle at its export."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest
import torch
from fitted_network import fitted
from made_models import input_gains, join_gains, saturations

from offline.data.manifest import describe_training
from offline.data.signals import fit_scaling
from offline.model.export_checks import (
    OTHERS,
    PENALISED,
    DrivenStability,
    box_stability,
    check_export,
    limits_of,
)
from offline.model.physical_units import choose_selftest
from offline.training.export import export_checkpoint
from offline.training.run import load_checkpoint
from offline.training.train import train
from rt_controller.contract.errors import ArtifactError, DatasetError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.model.artifact import load_bundle, save_bundle
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Matrices
from rt_controller.model.lift import Lift


@pytest.fixture(scope="module")
def lti(toy_dataset):
    """The ridge regression of the toy data, where speed and progress are proportional."""
    part, schema = toy_dataset.select("train"), toy_dataset.schema
    scaling = fit_scaling(part, schema, toy_dataset.roles)
    x = scaling.normalise_states(part.x.astype(np.float64))
    before, after = x[:, :-1].reshape(-1, 6), x[:, 1:].reshape(-1, 6)
    u, w = (part.u / scaling.u_scale).reshape(-1, 3), (part.w / scaling.w_scale).reshape(-1, 1)
    regressors = np.hstack([before, u, w, np.ones_like(w)])
    normal = regressors.T @ regressors + 1e-6 * len(x) * part.u.shape[1] * np.eye(11)
    A, B_uc, B_uw, c = np.split(np.linalg.solve(normal, regressors.T @ after).T, (6, 9, 10), axis=1)
    matrices = scaling.to_physical(Matrices(A, B_uc, B_uw, c[:, 0]))
    sample = choose_selftest(toy_dataset, Lift())
    linear = Bundle.linear(matrices.A, matrices.B_uc, matrices.B_uw, matrices.c)
    return replace(
        linear,
        selftest=sample,
        selftest_psi=sample.x,
        training=describe_training({}, toy_dataset.origin),
        data_sha256=toy_dataset.sha256,
    )


@pytest.fixture(params=["paper", "recommended"])
def checkpoint(request, tiny_config, tiny_recommended, new_run, toy_dataset):
    """Trained for a moment, then with matrices that are better than persistence."""
    config = {"paper": tiny_config, "recommended": tiny_recommended}[request.param]
    run = new_run(config)
    train(config, toy_dataset, run)
    return fitted(load_checkpoint(run.best), toy_dataset)


def test_a_good_bundle_passes_and_can_be_loaded(lti, toy_dataset, tmp_path):
    check_export(lti, toy_dataset)
    save_bundle(tmp_path, lti, "card")
    assert load_bundle(tmp_path).sha256 == lti.sha256


def test_the_figures_of_an_export_are_those_of_the_bundle(lti, toy_dataset):
    figures = check_export(lti, toy_dataset)
    x, u, w, _ = (part.astype(np.float64) for part in toy_dataset.select("validation")[:4])
    error, persistence = np.zeros(6), np.zeros(6)
    for b in range(len(x)):
        predicted = x[b, 0]
        for k in range(u.shape[1]):
            predicted = lti.A @ predicted + lti.B_uc @ u[b, k] + lti.B_uw @ w[b, k] + lti.c
            error += (predicted - x[b, k + 1]) ** 2
            persistence += (x[b, 0] - x[b, k + 1]) ** 2
    np.testing.assert_allclose(figures.persistence_over_model, persistence / error, rtol=1e-6)
    assert figures.stability.unsaturated.radius == pytest.approx(lti.spectral_radius)
    assert figures.stability.unsaturated.growth == pytest.approx(lti.growth(80))
    assert figures.parity < 1e-6


def test_a_trained_bundle_has_the_hash_of_its_data_its_episodes_and_its_step(
    checkpoint, toy_dataset, tmp_path
):
    bundle, figures = export_checkpoint(checkpoint, toy_dataset)
    save_bundle(tmp_path, bundle, "card")
    loaded = load_bundle(tmp_path)
    assert (loaded.sha256, loaded.data_sha256) == (bundle.sha256, toy_dataset.sha256)
    training = json.loads(loaded.training)
    assert (training["episodes"], training["data_seed"]) == (40, 3)
    assert training["conditions"] == "recipe nominal"
    assert training["step"] == checkpoint.step
    assert loaded.selftest.x.shape == (32, 6)
    assert figures.parity < 1e-5
    assert figures.persistence_over_model.min() > 1.0


def test_a_trained_bundle_knows_the_limits_of_the_inputs_and_the_roads_of_its_data(
    checkpoint, toy_dataset
):
    bundle, _ = export_checkpoint(checkpoint, toy_dataset)
    roads = toy_dataset.select("train").w
    lowest, highest = bundle.signal_range
    assert lowest.tolist() == [*INPUT_LIMITS.lower, pytest.approx(roads.min())]
    assert highest.tolist() == [*INPUT_LIMITS.upper, pytest.approx(roads.max())]


def with_operator(checkpoint, edit):
    model = {name: tensor.clone() for name, tensor in checkpoint.model.items()}
    edit(model["A_rows"])
    return replace(checkpoint, model=model)


def test_a_model_is_not_exported_with_other_data_than_it_was_trained_on(checkpoint, toy_dataset):
    manifest = replace(toy_dataset.manifest, sha256="another")
    with pytest.raises(DatasetError, match="trained on"):
        export_checkpoint(checkpoint, replace(toy_dataset, manifest=manifest))


def test_a_model_with_a_large_spectral_radius_is_not_exported(checkpoint, toy_dataset):
    growing = with_operator(checkpoint, lambda A: A[0, 0].fill_(1.06))
    with pytest.raises(ArtifactError, match="spectral radius"):
        export_checkpoint(growing, toy_dataset)


def test_a_model_with_a_nan_is_not_exported(checkpoint, toy_dataset):
    broken = with_operator(checkpoint, lambda A: A[0].fill_(torch.nan))
    with pytest.raises(ArtifactError, match="finite"):
        export_checkpoint(broken, toy_dataset)


def test_a_model_whose_growth_was_penalised_has_stricter_limits(tiny_config, tiny_recommended):
    assert limits_of(tiny_recommended) == PENALISED
    assert limits_of(tiny_config) == OTHERS
    assert PENALISED.radius < OTHERS.radius
    assert PENALISED.growth < OTHERS.growth


def with_feedback_of_the_steering(bundle, size, saturates):
    """The steering acts on v_y by a gain that is v_y: J[1, 1] = A[1, 1] + size * steering."""
    N, S = np.zeros((1, 6, 3)), np.zeros((1, 3, 6))
    N[0, 1, 2], S[0, 2, 1] = size, 1.0
    lowest, highest = (np.append(limit, 0.0) for limit in INPUT_LIMITS[:2])
    return replace(
        bundle,
        gains=input_gains(N, S, np.zeros((1, 3)), saturates),
        signal_range=np.stack([lowest, highest]),
    )


@pytest.mark.parametrize("saturates", [False, True])
def test_a_model_that_explodes_under_inputs_is_refused(lti, toy_dataset, saturates):
    """No eigenvalue of A exceeds the limit."""
    exploding = with_feedback_of_the_steering(lti, 3.0, saturates)
    assert exploding.spectral_radius < OTHERS.radius
    with pytest.raises(ArtifactError, match=r"inputs .* unsaturated, .* found [0-9.]+ and .* grow"):
        check_export(exploding, toy_dataset)
    harmless = with_feedback_of_the_steering(lti, 1e-3, saturates)
    assert check_export(harmless, toy_dataset).stability.unsaturated.radius < OTHERS.radius


def test_a_model_that_only_its_radius_speaks_against_is_refused(lti, toy_dataset):
    radius = lti.spectral_radius
    check_export(lti, toy_dataset, DrivenStability(1.0001 * radius, np.inf))
    with pytest.raises(ArtifactError, match="a spectral radius of at most"):
        check_export(lti, toy_dataset, DrivenStability(0.9999 * radius, np.inf))


def test_a_model_that_only_its_growth_speaks_against_is_refused(lti, toy_dataset):
    """Integrators in a chain grow although no eigenvalue exceeds 1."""
    growth = lti.growth(80)
    check_export(lti, toy_dataset, DrivenStability(OTHERS.radius, 1.01 * growth))
    with pytest.raises(ArtifactError, match="a growth of at most"):
        check_export(lti, toy_dataset, DrivenStability(OTHERS.radius, 0.99 * growth))


@pytest.mark.parametrize("state", range(6))
def test_a_model_that_predicts_a_state_worse_than_persistence_is_refused(lti, toy_dataset, state):
    wrong = lti.c.copy()
    wrong[state] += 20.0 * toy_dataset.select("train").x[..., state].std()
    with pytest.raises(ArtifactError, match="better than the last measured state") as error:
        check_export(replace(lti, c=wrong), toy_dataset)
    assert f"{toy_dataset.schema.state_names[state]} (mean squared error " in str(error.value)


def test_the_message_names_only_the_states_that_are_predicted_worse(lti, toy_dataset):
    """No other state depends on e_y."""
    A, wrong = lti.A.copy(), lti.c.copy()
    A[np.arange(6) != 4, 4] = 0.0
    wrong[4] += 1.0
    with pytest.raises(ArtifactError, match=r"part for ey_m \(mean squared error [^,]*, [^,]*\)\."):
        check_export(replace(lti, A=A, c=wrong), toy_dataset)


def test_a_prediction_beyond_all_numbers_is_worse_than_persistence(lti, toy_dataset):
    """An offset does not matter for stability."""
    c = lti.c.copy()
    c[0] = 1e200
    with pytest.raises(ArtifactError, match=r"vx_mps \(mean squared error inf"):
        check_export(replace(lti, c=c), toy_dataset)


def growing_where_a_drift_is_saturated(bundle, by):
    """The throttle adds `by` to A[0, 0], and a road takes it away unless v_x saturates its gain."""
    N, S = np.zeros((1, 6, 3)), np.zeros((1, 3, 6))
    weak, strong, curvature_per_m = 1e-6, 10.0, 0.01
    N[0, 0, 0], S[0, 0, 0] = by / weak, weak
    drift = saturations(np.zeros((6, 1)), np.zeros((1, 6)), np.zeros(1), np.array([3]), one=4)
    drift.N[0, 0], drift.S[0, 0] = -by / curvature_per_m / strong, strong
    return replace(
        bundle,
        gains=join_gains(input_gains(N, S, np.zeros((1, 3)), True), drift),
        signal_range=np.tile([1.0, 0.0, 0.0, curvature_per_m], (2, 1)),
    )


def test_gains_as_at_lifted_states_have_the_wider_limits(lti, toy_dataset):
    """Such a model is stable enough; that it predicts badly is found by the next check."""
    strict = DrivenStability(lti.spectral_radius + 0.002, 1.01 * lti.growth(80))
    slow = growing_where_a_drift_is_saturated(lti, 0.04)
    parts = box_stability(slow, slow.signal_range)
    assert parts.unsaturated.radius < strict.radius < parts.at_states.radius
    assert parts.saturated.radius < strict.radius
    with pytest.raises(ArtifactError, match="better than the last measured state"):
        check_export(slow, toy_dataset, strict)
    fast = growing_where_a_drift_is_saturated(lti, 0.1)
    with pytest.raises(ArtifactError, match=r"gains at states, a spectral radius of at most 1\.05"):
        check_export(fast, toy_dataset, strict)


def with_nan(array):
    broken = array.copy()
    broken.flat[0] = np.nan
    return broken


@pytest.mark.parametrize("field", ["A", "B_uc", "B_uw", "c", "selftest_psi"])
def test_a_matrix_that_is_not_finite_is_refused(lti, toy_dataset, field):
    with pytest.raises(ArtifactError, match="finite numbers"):
        check_export(replace(lti, **{field: with_nan(getattr(lti, field))}), toy_dataset)


@pytest.mark.parametrize("field", ["N", "S", "s0"])
def test_gains_that_are_not_finite_are_refused(lti, toy_dataset, field):
    bent = with_feedback_of_the_steering(lti, 0.0, True)
    check_export(bent, toy_dataset)
    gains = bent.gains._replace(**{field: with_nan(getattr(bent.gains, field))})
    with pytest.raises(ArtifactError, match="finite numbers"):
        check_export(replace(bent, gains=gains), toy_dataset)


def test_an_encoder_that_differs_from_training_is_not_exported(lti, toy_dataset):
    with pytest.raises(ArtifactError, match="torch and ONNX"):
        check_export(replace(lti, selftest_psi=lti.selftest_psi + 1e-2), toy_dataset)


def test_differences_of_a_latent_are_measured_in_units_of_its_spread(checkpoint, toy_dataset):
    bundle, _ = export_checkpoint(with_latents_of(checkpoint, 1e-3), toy_dataset)
    psi = bundle.selftest_psi.copy()
    psi[0, 6] += 1e-4 * bundle.spread[6]
    assert 1e-4 * bundle.spread[6] < 1e-5
    with pytest.raises(ArtifactError, match="of the spread of each observable"):
        check_export(replace(bundle, selftest_psi=psi), toy_dataset)


def with_latents_of(checkpoint, size):
    """The same network with all latents scaled by `size`."""
    model = {name: tensor.clone() for name, tensor in checkpoint.model.items()}
    last = max(name.split(".")[3] for name in model if name.startswith("encoders.0.layers."))
    for name in model:
        if f".layers.{last}." in name or "products" in name:
            model[name] *= size
    return replace(checkpoint, model=model)


@pytest.mark.parametrize("encoder", [b"no encoder", "fixed batch"])
def test_an_encoder_that_cannot_lift_a_batch_is_refused(lti, toy_dataset, encoder):
    if encoder == "fixed batch":
        model = onnx.load_from_string(lti.encoder_onnx)
        for tensor in (*model.graph.input, *model.graph.output):
            tensor.type.tensor_type.shape.dim[0].dim_value = 2
        encoder = model.SerializeToString()
    with pytest.raises(ArtifactError, match="offline-export"):
        check_export(replace(lti, encoder_onnx=encoder), toy_dataset)


def test_a_state_that_does_not_change_is_not_compared_with_persistence(lti, toy_dataset):
    x = toy_dataset.recording.x.copy()
    x[:, 1] = 0.25
    still = replace(toy_dataset, recording=toy_dataset.recording._replace(x=x))
    assert check_export(lti, still).persistence_over_model[1] == 0.0
