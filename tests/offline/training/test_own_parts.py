"""A loss and an encoder that are passed to the training as functions."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from fitted_network import fitted
from run_contents import history
from torch import nn

from offline.data.sampling import scale
from offline.model.bundle_predictor import BundlePredictor
from offline.model.losses import Losses, state_errors
from offline.training.export import export_checkpoint
from offline.training.initial import with_structure_of
from offline.training.run import load_checkpoint, restore_model
from offline.training.train import train
from rt_controller.contract.errors import ArtifactError, ConfigError


class Sines(nn.Module):
    """Sines of linear functions, then a linear layer; the first linear layer has no bias."""

    def __init__(self, width: int, latents: int) -> None:
        super().__init__()
        self.first = nn.Linear(width, 6, bias=False)
        self.last = nn.Linear(6, latents)

    def forward(self, inputs):
        return self.last(torch.sin(self.first(inputs)))


def lateral_error(model, config, batch):
    """Mean squared error of e_y alone."""
    error = state_errors(model, batch)[4]
    zero = error.new_zeros(())
    return Losses(error, zero, error, zero, zero, error)


def test_a_loss_of_ones_own_becomes_smaller(config, toy_dataset, new_run):
    run = new_run(config.model_copy(update={"steps": 100, "evaluate_every": 50}))
    result = train(run.config, toy_dataset, run, loss=lateral_error)
    values = [line["validation"]["total"] for line in history(run)]
    assert values[-1] < 0.5 * values[0]
    assert result.best_validation_loss == min(values)


@pytest.fixture(scope="module")
def of_sines(config, toy_dataset, new_run):
    run = new_run(config)
    train(config, toy_dataset, run, encoder=Sines)
    return run


def test_an_encoder_of_ones_own_learns(of_sines):
    first, *_, last = (line["validation"]["total"] for line in history(of_sines))
    assert last < first
    model = load_checkpoint(of_sines.last).model
    assert "encoders.0.layers.own.first.weight" in model
    assert not [name for name in model if "layers.0." in name]


def test_its_bundle_predicts_like_torch(of_sines, toy_dataset):
    checkpoint = fitted(load_checkpoint(of_sines.best), toy_dataset, Sines)
    # The latents act on the states, so that predictions depend on the encoder.
    coupled = checkpoint.model["A_rows"].clone()
    coupled[:3, 6:] += 1e-3
    checkpoint = replace(checkpoint, model={**checkpoint.model, "A_rows": coupled})
    bundle, figures = export_checkpoint(checkpoint, toy_dataset, Sines)
    assert figures.parity < 1e-5
    assert np.ptp(bundle.selftest_psi[:, 6:], axis=0).max() > 0.0

    part, scaling = toy_dataset.select("validation"), checkpoint.scaling
    schema, roles = toy_dataset.schema, toy_dataset.roles
    batch = scale(part, scaling, schema, roles, checkpoint.config.history_steps)
    model = restore_model(checkpoint, schema, roles, Sines)
    with torch.no_grad():
        psi0 = model.lift(batch.at(torch.zeros(1, dtype=torch.long)))[0]
        expected = model.roll_out(psi0, batch.u, batch.w)[..., :6].transpose(0, 1).numpy()
    x, u, w, past = (array.astype(float) for array in part[:4])
    found = scaling.normalise_states(BundlePredictor(bundle).predict(x[:, 0], past, u, w))[:, 1:]
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()


def perceptron(width, latents):
    """Shapes and names as of the perceptron of the tests."""
    layers = nn.Linear(width, 8), nn.Tanh(), nn.Linear(8, 8), nn.Tanh(), nn.Linear(8, latents)
    return nn.Sequential(*layers)


@pytest.mark.parametrize("config", ["paper"], indirect=True)
@pytest.mark.parametrize(
    "trained", [Sines, perceptron, lambda *_: None], ids=["own", "perceptron", "none"]
)
def test_without_its_encoder_a_run_is_neither_exported_nor_resumed(
    config, toy_dataset, new_run, trained
):
    """Nor is a run of perceptrons with an encoder of one's own."""
    encoder, other = (trained, None) if trained in (Sines, perceptron) else (None, perceptron)
    run = new_run(config)
    train(config, toy_dataset, run, encoder=encoder)
    with pytest.raises(ArtifactError, match="with that encoder"):
        export_checkpoint(load_checkpoint(run.best), toy_dataset, other)
    with pytest.raises(ArtifactError, match="with that encoder"):
        train(config, toy_dataset, run, encoder=other, resume_from=load_checkpoint(run.last))


@pytest.mark.parametrize("config", ["paper"], indirect=True)
def test_its_bundle_starts_no_training(of_sines, toy_dataset, config, new_run):
    checkpoint = fitted(load_checkpoint(of_sines.best), toy_dataset, Sines)
    bundle, _ = export_checkpoint(checkpoint, toy_dataset, Sines)
    assert json.loads(bundle.training)["encoder"]
    with pytest.raises(ConfigError, match="lacks hidden"):
        with_structure_of(bundle, config, {})
    with pytest.raises(ArtifactError, match="without an encoder of its own"):
        train(config, toy_dataset, new_run(config), encoder=Sines, first_model=bundle)


def test_an_encoder_of_another_width_is_refused(config, toy_dataset, new_run):
    with pytest.raises(ConfigError, match=r"expected.*latents.*found.*Return a module"):
        train(config, toy_dataset, new_run(config), encoder=lambda width, _: nn.Linear(width, 99))
