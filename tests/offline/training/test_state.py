"""The state of a training: optimiser groups, learning rate, checkpoint."""

import pytest
import torch

from offline.model.network import sizes_of
from offline.training.state import find_device, initialise
from rt_controller.contract.errors import ConfigError

CPU = torch.device("cpu")


@pytest.fixture
def sizes(toy_dataset):
    return sizes_of(toy_dataset.schema, toy_dataset.roles)


def test_every_parameter_is_optimised_once_and_a_has_its_own_rate(tiny_recommended, sizes):
    state = initialise(tiny_recommended, sizes, CPU)
    rest, operator = state.optimizer.param_groups
    assert operator["params"] == [state.model.A_rows]
    assert len(rest["params"]) + 1 == len(list(state.model.parameters()))
    state.learning_rate = 0.02
    assert (rest["lr"], operator["lr"]) == (0.02, pytest.approx(0.004))


def test_halving_the_rate_halves_it_for_every_parameter(tiny_config, sizes):
    state = initialise(tiny_config.model_copy(update={"operator_rate": 0.2}), sizes, CPU)
    state.learning_rate *= 0.5
    state.learning_rate *= 0.5
    rates = [group["lr"] for group in state.optimizer.param_groups]
    assert rates == pytest.approx([1e-3 / 4, 0.2e-3 / 4])


def test_an_unknown_device_is_refused():
    with pytest.raises(ConfigError, match="--device"):
        find_device("no-such-device")
