"""Groups of parameters, learning rates and their schedule, the update of a matrix."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from offline.config import PRESETS, TrainingConfig
from offline.data.dataset import Dataset
from offline.data.signals import VEHICLE_ROLES, fit_scaling
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.training.optimizer import Optimizer, cosine_rate
from offline.training.run import TrainingState, find_device, initialise
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import INPUT_LIMITS
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


def test_matrices_and_a_have_their_own_share_of_the_rate():
    _, optimizer, config = made()
    optimizer.rate = 0.01
    expected = [0.01 * config.matrix_rate, 0.01, 0.01 * config.operator_rate]
    assert [group["lr"] for group in groups(optimizer)] == pytest.approx(expected)
    assert optimizer.rate == pytest.approx(0.01)


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


HIGHEST = 2e-3
run_lengths = st.integers(1, 5000)
seeded = settings(max_examples=50, derandomize=True, deadline=None)


def rates(steps: int) -> list[float]:
    return [cosine_rate(step, steps, HIGHEST) for step in range(steps)]


@seeded
@given(run_lengths)
def test_the_cosine_rate_rises_to_its_maximum_and_then_falls(steps):
    found = rates(steps)
    top = found.index(max(found))
    assert found[: top + 1] == sorted(found[: top + 1])
    assert found[top:] == sorted(found[top:], reverse=True)
    assert found[top] == pytest.approx(HIGHEST)


def test_after_the_warm_up_the_rate_is_half_a_cosine():
    found = rates(1000)
    assert found[50] == pytest.approx(HIGHEST)
    assert found[50 + 475] == pytest.approx(HIGHEST / 2)
    assert found[50 + 950 // 4] == pytest.approx(
        HIGHEST * (1 + math.cos(math.pi * (950 // 4) / 950)) / 2
    )
    assert found[-1] < 1e-5 * HIGHEST


CPU = torch.device("cpu")


def started(config: TrainingConfig, dataset: Dataset) -> TrainingState:
    scaling = fit_scaling(dataset.select("train"), dataset.schema, dataset.roles)
    return initialise(config, dataset, scaling, CPU)


def test_the_model_knows_the_scaled_range_of_its_signals(tiny_recommended, toy_dataset):
    train = toy_dataset.select("train")
    scaling = fit_scaling(train, toy_dataset.schema, toy_dataset.roles)
    lowest, highest = started(tiny_recommended, toy_dataset).model.signal_range.numpy()
    scale = np.append(scaling.u_scale, scaling.w_scale)
    np.testing.assert_allclose(lowest * scale, [*INPUT_LIMITS.lower, train.w.min()], rtol=1e-6)
    np.testing.assert_allclose(highest * scale, [*INPUT_LIMITS.upper, train.w.max()], rtol=1e-6)


def test_an_unknown_device_is_refused():
    with pytest.raises(ConfigError, match="--device"):
        find_device("no-such-device")
