"""Checks of a bundle at its export."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest
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
    limits_beside,
    limits_of,
    signal_box,
)
from offline.model.physical_units import choose_selftest
from offline.training.export import export_checkpoint
from offline.training.run import load_checkpoint
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


def with_latents_of(checkpoint, size):
    """The same network with all latents scaled by `size`."""
    model = {name: tensor.clone() for name, tensor in checkpoint.model.items()}
    last = max(name.split(".")[3] for name in model if name.startswith("encoders.0.layers."))
    for name in model:
        if f".layers.{last}." in name or "products" in name:
            model[name] *= size
    return replace(checkpoint, model=model)


def test_a_state_that_does_not_change_is_not_compared_with_persistence(lti, toy_dataset):
    x = toy_dataset.recording.x.copy()
    x[:, 1] = 0.25
    still = replace(toy_dataset, recording=toy_dataset.recording._replace(x=x))
    assert check_export(lti, still).persistence_over_model[1] == 0.0


def test_a_trained_bundle_knows_its_data_its_step_and_the_range_of_its_signals(
    finished, toy_dataset, tmp_path
):
    """And it is not exported with other data than it was trained on."""
    checkpoint = fitted(load_checkpoint(finished.best), toy_dataset)
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
    roads = toy_dataset.select("train").w
    lowest, highest = bundle.signal_range
    assert lowest.tolist() == [*INPUT_LIMITS.lower, pytest.approx(roads.min())]
    assert highest.tolist() == [*INPUT_LIMITS.upper, pytest.approx(roads.max())]
    validity, train = loaded.validity, toy_dataset.select("train").x
    assert (validity.speed_mps[0], validity.speed_mps[-1]) == pytest.approx(
        np.quantile(train[:, :-1, 0], [1e-3, 0.999])
    )
    lateral = np.abs(train[..., 0] * train[..., 2]).max()
    assert 0.5 * lateral < validity.lateral_mps2.max() <= lateral
    assert validity.curvature_per_m.max() > 0.004  # of roads near the car
    assert validity.conditions.tolist() == [[0.85, 0.85], *([[0.0, 0.0]] * 3)]
    manifest = replace(toy_dataset.manifest, sha256="another")
    with pytest.raises(DatasetError, match="trained on"):
        export_checkpoint(checkpoint, replace(toy_dataset, manifest=manifest))


@pytest.mark.parametrize("config", ["recommended"], indirect=True)
def test_differences_of_a_latent_are_measured_in_units_of_its_spread(finished, toy_dataset):
    checkpoint = fitted(load_checkpoint(finished.best), toy_dataset)
    bundle, _ = export_checkpoint(with_latents_of(checkpoint, 1e-3), toy_dataset)
    psi = bundle.selftest_psi.copy()
    psi[0, 6] += 1e-4 * bundle.spread[6]
    assert 1e-4 * bundle.spread[6] < 1e-5
    with pytest.raises(ArtifactError, match="of the spread of each observable"):
        check_export(replace(bundle, selftest_psi=psi), toy_dataset)


def plus(array, place, value):
    changed = array.copy()
    changed[place] += value
    return changed


def with_not_a_number(bundle, field):
    return replace(bundle, **{field: with_nan(getattr(bundle, field))})


def with_gain_not_a_number(bundle, field):
    bent = with_feedback_of_the_steering(bundle, 0.0, True)
    gains = bent.gains._replace(**{field: with_nan(getattr(bent.gains, field))})
    return replace(bent, gains=gains)


def for_two_rows_only(bundle):
    model = onnx.load_from_string(bundle.encoder_onnx)
    for tensor in (*model.graph.input, *model.graph.output):
        tensor.type.tensor_type.shape.dim[0].dim_value = 2
    return replace(bundle, encoder_onnx=model.SerializeToString())


EXPLODES = r"inputs .* unsaturated, .* found [0-9.]+ and .* grow"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        # No eigenvalue of A exceeds the limit.
        (lambda lti: with_feedback_of_the_steering(lti, 3.0, False), EXPLODES),
        (lambda lti: with_feedback_of_the_steering(lti, 3.0, True), EXPLODES),
        *(
            (lambda lti, field=field: with_not_a_number(lti, field), "finite numbers")
            for field in ("A", "B_uc", "B_uw", "c", "selftest_psi")
        ),
        *(
            (lambda lti, field=field: with_gain_not_a_number(lti, field), "finite numbers")
            for field in ("N", "S", "s0")
        ),
        # An offset does not matter for stability.
        (lambda lti: replace(lti, c=plus(lti.c, 0, 1e200)), r"vx_mps \(mean squared error inf"),
        (lambda lti: replace(lti, selftest_psi=lti.selftest_psi + 1e-2), "torch and ONNX"),
        (lambda lti: replace(lti, encoder_onnx=b"no encoder"), "offline-export"),
        (for_two_rows_only, "offline-export"),
    ],
)
def test_a_model_that_must_not_be_driven_with_is_refused(lti, toy_dataset, change, words):
    check_export(with_feedback_of_the_steering(lti, 1e-3, True), toy_dataset)
    with pytest.raises(ArtifactError, match=words):
        check_export(change(lti), toy_dataset)


@pytest.mark.parametrize("state", range(6))
def test_a_model_that_predicts_a_state_worse_than_persistence_is_refused(lti, toy_dataset, state):
    offset = 20.0 * toy_dataset.select("train").x[..., state].std()
    with pytest.raises(ArtifactError, match="better than the last measured state") as error:
        check_export(replace(lti, c=plus(lti.c, state, offset)), toy_dataset)
    assert f"{toy_dataset.schema.state_names[state]} (mean squared error " in str(error.value)


def test_radius_and_growth_are_limited_each_by_itself(lti, toy_dataset):
    """Integrators in a chain grow although no eigenvalue exceeds 1."""
    radius, growth = lti.spectral_radius, lti.growth(80)
    check_export(lti, toy_dataset, DrivenStability(1.0001 * radius, 1.01 * growth))
    with pytest.raises(ArtifactError, match="a spectral radius of at most"):
        check_export(lti, toy_dataset, DrivenStability(0.9999 * radius, np.inf))
    with pytest.raises(ArtifactError, match="a growth of at most"):
        check_export(lti, toy_dataset, DrivenStability(OTHERS.radius, 0.99 * growth))


def test_a_model_may_grow_twice_as_much_as_the_one_that_its_training_began_with(lti):
    """In units of the spread of the new data."""
    centre = lti.selftest_psi.mean(axis=0)
    narrow = centre + (lti.selftest_psi - centre) * np.where(np.arange(6) == 1, 1e-3, 1.0)
    bundle = replace(lti, selftest_psi=narrow)
    growth = box_stability(bundle, signal_box(bundle)).unsaturated.growth
    assert growth > PENALISED.growth
    assert limits_beside(lti, bundle, PENALISED).growth == pytest.approx(2.0 * growth)
    assert limits_beside(lti, lti, OTHERS) == OTHERS
