"""Checks of a bundle at its export."""

import json
from dataclasses import replace

import onnx
import pytest
import torch

from offline.data.provenance import describe_training
from offline.model.export_checks import check_export
from offline.training.checkpoint import load_checkpoint
from offline.training.export import export_checkpoint
from offline.training.train import train
from rt_controller.contract.errors import ArtifactError, DatasetError
from rt_controller.contract.model.artifact import load_bundle, save_bundle, shipped_model


@pytest.fixture(scope="module")
def lti(toy_dataset):
    """A stable linear bundle with the origin of the toy data."""
    shipped = load_bundle(shipped_model("lti"))
    return replace(
        shipped,
        A=0.95 * shipped.A,
        training=describe_training({}, toy_dataset.origin),
        data_sha256=toy_dataset.sha256,
    )


@pytest.fixture
def checkpoint(tiny_recommended, new_run, toy_dataset):
    run = new_run(tiny_recommended)
    train(tiny_recommended, toy_dataset, run)
    return load_checkpoint(run.best)


def test_a_stable_bundle_passes_and_can_be_loaded(lti, tmp_path):
    check_export(lti)
    save_bundle(tmp_path, lti, "card")
    assert load_bundle(tmp_path).sha256 == lti.sha256


def test_a_trained_bundle_has_the_hash_of_its_data_its_episodes_and_its_step(
    checkpoint, toy_dataset, tmp_path
):
    bundle, parity = export_checkpoint(checkpoint, toy_dataset)
    save_bundle(tmp_path, bundle, "card")
    loaded = load_bundle(tmp_path)
    assert (loaded.sha256, loaded.data_sha256) == (bundle.sha256, toy_dataset.sha256)
    training = json.loads(loaded.training)
    assert (training["episodes"], training["data_seed"]) == (40, 3)
    assert training["conditions"] == "recipe nominal"
    assert training["step"] == checkpoint.step
    assert loaded.selftest.x.shape == (32, 6)
    assert parity < 1e-5


def with_operator(checkpoint, edit):
    model = {name: tensor.clone() for name, tensor in checkpoint.model.items()}
    edit(model["A_rows"])
    return replace(checkpoint, model=model)


def test_a_model_is_not_exported_with_other_data_than_it_was_trained_on(checkpoint, toy_dataset):
    manifest = replace(toy_dataset.manifest, sha256="another")
    with pytest.raises(DatasetError, match="trained on"):
        export_checkpoint(checkpoint, replace(toy_dataset, manifest=manifest))


def test_a_model_with_a_large_spectral_radius_is_not_exported(checkpoint, toy_dataset):
    growing = with_operator(checkpoint, lambda A: A.mul_(1.06))
    with pytest.raises(ArtifactError, match="spectral radius"):
        export_checkpoint(growing, toy_dataset)


def test_a_model_with_a_nan_is_not_exported(checkpoint, toy_dataset):
    broken = with_operator(checkpoint, lambda A: A[0].fill_(torch.nan))
    with pytest.raises(ArtifactError, match="finite"):
        export_checkpoint(broken, toy_dataset)


def test_an_encoder_that_differs_from_training_is_not_exported(lti):
    with pytest.raises(ArtifactError, match="torch and ONNX"):
        check_export(replace(lti, selftest_psi=lti.selftest_psi + 1e-2))


def test_differences_of_a_latent_are_measured_in_units_of_its_spread(checkpoint, toy_dataset):
    bundle, _ = export_checkpoint(with_latents_of(checkpoint, 1e-3), toy_dataset)
    psi = bundle.selftest_psi.copy()
    psi[0, 6] += 1e-4 * bundle.spread[6]
    assert 1e-4 * bundle.spread[6] < 1e-5
    with pytest.raises(ArtifactError, match="of the spread of each observable"):
        check_export(replace(bundle, selftest_psi=psi))


def with_latents_of(checkpoint, size):
    """The same network with all latents scaled by `size`."""
    model = {name: tensor.clone() for name, tensor in checkpoint.model.items()}
    layers = sorted(name for name in model if name.startswith("encoder.layers."))
    for name in (*layers[-2:], "encoder.products.weights.weight"):
        model[name] *= size
    return replace(checkpoint, model=model)


@pytest.mark.parametrize("encoder", [b"no encoder", "fixed batch"])
def test_an_encoder_that_cannot_lift_a_batch_is_refused(lti, encoder):
    if encoder == "fixed batch":
        model = onnx.load_from_string(lti.encoder_onnx)
        for tensor in (*model.graph.input, *model.graph.output):
            tensor.type.tensor_type.shape.dim[0].dim_value = 2
        encoder = model.SerializeToString()
    with pytest.raises(ArtifactError, match="offline-export"):
        check_export(replace(lti, encoder_onnx=encoder))
