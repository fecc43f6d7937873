"""Groups of parameters, learning rates and their schedule, the update of a matrix."""

import math

import pytest
import torch

from offline.config import PRESETS, TrainingConfig
from offline.data.signals import VEHICLE_ROLES
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.training.optimizer import Optimizer, cosine_rate
from offline.training.state import find_device
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import VEHICLE

SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)
SMALL = {"hidden": (8, 8), "latents": 7}


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


HIGHEST = 2e-3


def rates(steps: int) -> list[float]:
    return [cosine_rate(step, steps, HIGHEST) for step in range(steps)]


def test_after_the_warm_up_the_rate_is_half_a_cosine():
    found = rates(1000)
    assert found[50] == pytest.approx(HIGHEST)
    assert found[50 + 475] == pytest.approx(HIGHEST / 2)
    assert found[50 + 950 // 4] == pytest.approx(
        HIGHEST * (1 + math.cos(math.pi * (950 // 4) / 950)) / 2
    )
    assert found[-1] < 1e-5 * HIGHEST


def test_an_unknown_device_is_refused():
    with pytest.raises(ConfigError, match="--device"):
        find_device("no-such-device")
