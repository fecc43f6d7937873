"""The validation loss does not depend on how the trajectories are split into chunks."""

import pytest
import torch

from offline.config import PRESETS
from offline.data.sampling import Batch, scale
from offline.data.signals import fit_scaling
from offline.model import losses
from offline.model.losses import evaluate, log_error, state_errors, total_loss
from offline.model.network import MdkNet
from offline.model.observables import sizes_of

CPU = torch.device("cpu")


@pytest.fixture(params=["paper", "recommended"])
def case(request, toy_dataset):
    """A fresh model, its configuration, and 160 trajectories."""
    small = {"hidden": (8, 8), "latents": 5, "threads": 1}
    config = PRESETS[request.param].model_copy(update=small)
    schema, roles = toy_dataset.schema, toy_dataset.roles
    torch.manual_seed(0)
    model = MdkNet(config, sizes_of(schema, roles))
    train = toy_dataset.select("train")
    batch = scale(train, fit_scaling(train, schema, roles), schema, roles, config.history_steps)
    return model, config, batch


@pytest.mark.parametrize("chunk", [1, 7, 10_000])
def test_the_validation_loss_does_not_depend_on_the_size_of_the_chunks(case, monkeypatch, chunk):
    model, config, batch = case
    batch = Batch(*(series[:, :25] for series in batch))
    whole = evaluate(model, config, batch, CPU)
    monkeypatch.setattr(losses, "CHUNK", chunk)
    assert evaluate(model, config, batch, CPU) == pytest.approx(whole, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("case", ["recommended"], indirect=True)
def test_the_validation_loss_is_the_logarithm_of_the_mean_error_of_all_chunks(case, monkeypatch):
    monkeypatch.setattr(losses, "CHUNK", 50)
    model, config, batch = case
    model.eval()
    with torch.no_grad():
        exact = log_error(state_errors(model, batch)).item()
        at_once = total_loss(model, config, batch)
    total, _, multi_step, *_, states = evaluate(model, config, batch, CPU)
    assert multi_step == pytest.approx(exact, abs=1e-5)
    assert total == pytest.approx(at_once.total.item(), abs=1e-5)
    assert states == pytest.approx(at_once.states.item(), rel=1e-5)
