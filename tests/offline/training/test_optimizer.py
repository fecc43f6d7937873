"""The groups of parameters, their learning rates, and the update of a matrix."""

import pytest
import torch

from offline.config import PRESETS, TrainingConfig
from offline.data.signals import VEHICLE_ROLES
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.training.optimizer import Optimizer
from rt_controller.contract.signals import VEHICLE

SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)
SMALL = {"hidden": (8, 8), "latents": 7, "path_latents": 2, "path_hidden": (6,)}


def made(**changes: object) -> tuple[MdkNet, Optimizer, TrainingConfig]:
    torch.manual_seed(0)
    config = PRESETS["recommended"].model_copy(update={**SMALL, **changes})
    model = MdkNet(config, SIZES)
    return model, Optimizer(model, config), config


def groups(optimizer: Optimizer) -> list[dict]:
    parts = optimizer.state_dict()["parts"]
    return [group for part in parts for group in part["param_groups"]]


@pytest.mark.parametrize("name", ["muon", "adam"])
def test_every_parameter_is_optimised_once(name):
    model, optimizer, _ = made(optimizer=name)
    sizes = [len(group["params"]) for group in groups(optimizer)]
    assert sum(sizes) == len(list(model.parameters()))
    assert sizes[-1] == 1  # A


def test_matrices_and_a_have_their_own_share_of_the_rate():
    _, optimizer, config = made()
    optimizer.rate = 0.01
    expected = [0.01 * config.matrix_rate, 0.01, 0.01 * config.operator_rate]
    assert [group["lr"] for group in groups(optimizer)] == pytest.approx(expected)
    assert optimizer.rate == pytest.approx(0.01)


def test_adam_alone_has_two_rates():
    _, optimizer, config = made(optimizer="adam")
    rate = config.learning_rate
    found = [group["lr"] for group in groups(optimizer)]
    assert found == pytest.approx([rate, rate * config.operator_rate])


@pytest.mark.parametrize(("name", "is_even"), [("muon", True), ("adam", False)])
def test_muon_changes_a_matrix_equally_in_all_directions(name, is_even):
    """Its update is nearly orthogonal, whatever the singular values of the gradient."""
    model, optimizer, _ = made(optimizer=name)
    weight = model.encoders[0].layers[2].weight
    left, _, right = torch.linalg.svd(torch.randn(8, 8))
    weight.grad = left @ torch.diag(torch.logspace(0, -1, 8)) @ right
    before = weight.detach().clone()
    optimizer.step()
    sizes = torch.linalg.svdvals(before - weight.detach())
    assert bool(sizes[0] / sizes[-1] < 2.0) is is_even


@pytest.mark.parametrize("name", ["muon", "adam"])
def test_a_model_without_gains_learns(name):
    """Its matrices of gains are empty."""
    model, optimizer, _ = made(optimizer=name, bilinear_rank=0, path_rank=0, drift_rank=0)
    u, w = torch.randn(5, 3, 3), torch.randn(5, 3, 1)
    before = [parameter.detach().clone() for parameter in model.parameters()]
    model.roll_out(torch.randn(3, model.n_observables), u, w).square().mean().backward()
    optimizer.step()
    after = list(model.parameters())
    assert all(torch.isfinite(parameter).all() for parameter in after)
    assert any(not torch.equal(one, other) for one, other in zip(before, after, strict=True))


def test_without_gradients_nothing_changes():
    model, optimizer, _ = made()
    model.roll_out(
        torch.randn(3, model.n_observables), torch.randn(5, 3, 3), torch.randn(5, 3, 1)
    ).square().mean().backward()
    optimizer.zero_grad()
    before = [parameter.detach().clone() for parameter in model.parameters()]
    optimizer.step()
    for one, other in zip(before, model.parameters(), strict=True):
        assert torch.equal(one, other)
