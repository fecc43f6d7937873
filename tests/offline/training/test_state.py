"""The state of a training: optimiser groups, learning rate, checkpoint."""

import numpy as np
import pytest
import torch

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.signals import fit_scaling
from offline.training.state import TrainingState, find_device, initialise
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import INPUT_LIMITS

CPU = torch.device("cpu")


def started(config: TrainingConfig, dataset: Dataset) -> TrainingState:
    scaling = fit_scaling(dataset.select("train"), dataset.schema, dataset.roles)
    return initialise(config, dataset, scaling, CPU)


def test_halving_the_rate_halves_it_for_every_parameter(tiny_config, toy_dataset):
    state = started(tiny_config.model_copy(update={"operator_rate": 0.2}), toy_dataset)
    state.learning_rate *= 0.5
    state.learning_rate *= 0.5
    (part,) = state.optimizer.state_dict()["parts"]
    rates = [group["lr"] for group in part["param_groups"]]
    assert rates == pytest.approx([1e-3 / 4, 0.2e-3 / 4])


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
