"""The recurrent network."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from made_drives import drive, predict

from offline.baselines.catalogue import gru
from offline.baselines.catalogue.gru import GruSettings, fit_gru
from offline.baselines.catalogue.persistence import Persistence
from offline.baselines.road_path import path_states
from offline.baselines.score import log_error
from rt_controller.contract.errors import DatasetError

QUICK = GruSettings(hidden=16, encoder=16, past_steps=4, steps=60, batch=32, learning_rate=1e-2)


@pytest.fixture(scope="module")
def fitted(toy_dataset):
    return fit_gru(toy_dataset, QUICK)


def test_errors_are_smaller_than_those_of_persistence(fitted, toy_dataset):
    test = toy_dataset.select("test")
    assert log_error(fitted, test) < log_error(Persistence(), test) - 2.0


def test_the_path_of_the_car_is_integrated_from_its_motion(fitted, toy_dataset):
    windows = toy_dataset.select("test")
    x, u, w, past = (series.astype(np.float64) for series in windows[:4])
    states = fitted.predict(x[:, 0], past, u, w)
    path = path_states(np, states[..., :3], x[:, 0], w[..., 0], 0.025)
    assert np.allclose(states[:, 1:, 3:], path, atol=1e-4)


def test_for_other_signals_than_the_cars_all_states_are_learned():
    made = drive(lambda x, u, w, b: 0.95 * x + 0.1 * np.stack([u[:, 0], u[:, 1], w[:, 0]], axis=1))
    baseline, test = fit_gru(made, QUICK), made.select("test")
    assert not baseline.is_car
    assert log_error(baseline, test) < log_error(Persistence(), test) - 0.5


def weights_of(model):
    return torch.nn.utils.parameters_to_vector(model.network.parameters())


def test_training_is_repeatable_and_keeps_the_global_random_state(toy_dataset):
    settings = replace(QUICK, steps=3)
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    one, other = fit_gru(toy_dataset, settings), fit_gru(toy_dataset, settings)
    assert torch.equal(torch.rand(1), expected)
    assert torch.equal(weights_of(one), weights_of(other))
    another = fit_gru(toy_dataset, replace(settings, seed=1))
    assert not torch.equal(weights_of(one), weights_of(another))


def test_a_window_counts_with_its_weight(toy_dataset, monkeypatch):
    """One of weight zero has no effect, whatever its states are."""
    open_source = gru.open_source

    class Weighted:
        def __init__(self, weight, shift):
            self.weight, self.shift = weight, shift

        def draw(self, size, rng):
            batch = self.source.draw(size, rng)
            batch.weight[0, 0, 0] = self.weight
            batch.x[1:, 0] += self.shift
            return batch

        def open(self, *arguments):
            self.source = open_source(*arguments)
            return self

    def trained(weight, shift):
        monkeypatch.setattr(gru, "open_source", Weighted(weight, shift).open)
        return weights_of(fit_gru(toy_dataset, replace(QUICK, steps=2)))

    assert torch.equal(trained(0.0, 0.0), trained(0.0, 3.0))
    assert not torch.equal(trained(1.0, 0.0), trained(1.0, 3.0))


def test_training_restores_the_number_of_threads(toy_dataset):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        fit_gru(toy_dataset, replace(QUICK, steps=1))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_only_the_last_rows_of_a_longer_past_are_used(fitted, toy_dataset):
    windows = toy_dataset.select("test")
    short, _ = predict(fitted, windows._replace(past=windows.past[:, -4:]))
    long, _ = predict(fitted, windows)
    assert np.array_equal(short, long)


def test_a_past_that_is_too_short_is_refused(fitted, toy_dataset):
    windows = toy_dataset.select("test")
    with pytest.raises(DatasetError, match="4 or more"):
        predict(fitted, windows._replace(past=windows.past[:, -3:]))
