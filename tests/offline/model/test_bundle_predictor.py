"""A bundle as a predictor."""

from dataclasses import replace

import numpy as np
import onnx_bytes
import pytest
from made_models import WITH_PAST, input_matrix, make_bundle

from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.errors import ArtifactError
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.follow import Follow
from rt_controller.model.lift import LiftSample


def test_a_linear_bundle_is_lifted_once_and_rolled_out():
    lti = load_bundle(shipped_model("lti"))
    rng = np.random.default_rng(0)
    x0, past = lti.selftest.x[:3], np.zeros((3, 20, 6))
    U, W = rng.normal(size=(3, 4, 3)), rng.normal(size=(3, 4, 1))
    model = BundlePredictor(lti)
    assert np.array_equal(model.lift(lti.selftest), lti.selftest.x)
    predicted = model.predict(x0, past, U, W)
    assert predicted.shape == (3, 5, 6)
    for b in range(3):
        x = x0[b]
        for k in range(4):
            x = lti.A @ x + lti.B_uc @ U[b, k] + lti.B_uw @ W[b, k] + lti.c
            assert np.allclose(predicted[b, k + 1], x, rtol=1e-12)


def test_a_frozen_bilinear_bundle_keeps_the_input_matrix_of_its_first_lifted_state():
    """It is lifted with the last rows of the past."""
    bundle = make_bundle(WITH_PAST, rank=2, bend=0.05)
    bundle = replace(bundle, gains=bundle.gains._replace(follows=Follow.START))
    rng = np.random.default_rng(0)
    x0, past = bundle.selftest.x[:3], rng.normal(size=(3, 20, 6))
    U, W = rng.normal(size=(3, 4, 3)), rng.normal(size=(3, 4, 1))
    model = BundlePredictor(bundle)
    psi = model.lift(LiftSample(x0, W[:, 0], past[:, -4:]))
    B = input_matrix(bundle, psi)
    assert np.ptp(B, axis=0).max() > 1e-3
    for k in range(4):
        psi = psi @ bundle.A.T + np.einsum("bnm,bm->bn", B, U[:, k]) + bundle.c
        psi += W[:, k] @ bundle.B_uw.T
    assert np.allclose(model.predict(x0, past, U, W)[:, -1], psi[:, :6], rtol=1e-12)


@pytest.mark.parametrize(
    ("operator", "second", "complaint"),
    [
        ("Add", "far", "lifts states .32, 6., found that it cannot"),
        ("Concat", "x", "found .64, 6."),
    ],
)
def test_an_encoder_that_cannot_lift_a_batch_is_refused(operator, second, complaint):
    """It adds row 99 of the batch, or returns every row twice."""
    tensor, rows = onnx_bytes.value, onnx_bytes.constant("rows", np.array([99]))
    nodes = [
        onnx_bytes.node("Gather", ["x", "rows"], "far", axis=0),
        onnx_bytes.node(operator, ["x", second], "psi", axis=0 if operator == "Concat" else None),
    ]
    shape = ("batch", 6)
    encoder = onnx_bytes.model(
        nodes[operator == "Concat" :], [tensor("x", shape)], [tensor("psi", shape)], [rows]
    )
    lti = load_bundle(shipped_model("lti"))
    with pytest.raises(ArtifactError, match=complaint):
        BundlePredictor(replace(lti, encoder_onnx=encoder)).lift(lti.selftest)
