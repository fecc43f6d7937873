"""A model with an encoder and a loss of your own: trained for a moment, exported, compared.

pip install -e ".[offline]"
offline-data --episodes 20 --seed 1 --largest-steer-deg 40 --data small
python examples/own_encoder.py
"""

from datetime import datetime
from pathlib import Path

import numpy as np
from torch import nn

from offline import load_dataset
from offline.config import PRESETS
from offline.evaluation.predictor import prediction_errors
from offline.model.bundle_predictor import BundlePredictor
from offline.model.losses import state_errors, total_loss
from offline.training.export import export_checkpoint
from offline.training.run import create_run, load_checkpoint
from offline.training.train import train


def encoder(width, latents):
    """From scaled inputs (..., width) to latents (..., latents)."""
    return nn.Sequential(nn.Linear(width, 32), nn.Tanh(), nn.Linear(32, latents))


def loss(model, config, batch):
    """The loss of the preset, plus the mean squared lateral and heading error."""
    losses = total_loss(model, config, batch)
    return losses._replace(total=losses.total + state_errors(model, batch)[4:].mean())


dataset = load_dataset(Path("small"))
small = {"steps": 100, "evaluate_every": 50, "batch": 32, "latents": 16, "weight_stability": 100.0}
config = PRESETS["quick"].model_copy(update=small)
run = create_run(Path("runs"), config, Path("small"), dataset.sha256, datetime.now())
train(config, dataset, run, loss=loss, encoder=encoder)
bundle, checks = export_checkpoint(load_checkpoint(run.best), dataset, encoder)
bundle.save(run.bundle)
errors = prediction_errors(BundlePredictor(bundle), dataset.select("test"))
print("difference of ONNX:", checks.parity, "root mean square errors:", *bundle.schema.state_names)
print(np.sqrt(np.mean(errors**2, axis=(0, 1))))
