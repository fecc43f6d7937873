"""The recurrent network."""

import numpy as np
import pytest
import torch
from made_drives import drive, predict

from offline.baselines import recurrent
from offline.baselines.fitting import log_error
from offline.baselines.linear import Persistence
from offline.baselines.recurrent import CONFIG, fit_network
from offline.baselines.registry import not_converged
from offline.baselines.road_path import path_states

SMALL = {
    "hidden": (16, 16), "latents": 16, "history_steps": 4, "steps": 60, "batch": 32,
    "learning_rate": 4e-2,
}  # fmt: skip


def quick(**changes):
    return CONFIG.model_copy(update=SMALL | changes)


@pytest.fixture(scope="module")
def fitted(toy_dataset):
    return fit_network(toy_dataset, quick())


def weights_of(model):
    return torch.nn.utils.parameters_to_vector(model.network.parameters())


def test_its_errors_are_small_and_the_path_of_the_car_is_integrated(fitted, toy_dataset):
    test = toy_dataset.select("test")
    assert log_error(fitted, test) < log_error(Persistence(), test) - 2.0
    x, u, w, past = (series.astype(np.float64) for series in test[:4])
    states = fitted.predict(x[:, 0], past, u, w)
    path = path_states(np, states[..., :3], x[:, 0], w[..., 0], 0.025)
    assert np.allclose(states[:, 1:, 3:], path, atol=1e-4)
    assert not fitted.is_converged


def test_for_other_signals_than_the_cars_all_states_are_learned():
    made = drive(lambda x, u, w, b: 0.95 * x + 0.1 * np.stack([u[:, 0], u[:, 1], w[:, 0]], axis=1))
    baseline, test = fit_network(made, quick()), made.select("test")
    assert baseline.learned.curvature is None
    assert log_error(baseline, test) < log_error(Persistence(), test) - 0.5


def test_training_is_repeatable_and_keeps_the_global_state_of_torch(toy_dataset):
    threads = torch.get_num_threads()
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    torch.set_num_threads(2)
    try:
        one, other = (fit_network(toy_dataset, quick(steps=3)) for _ in range(2))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(torch.rand(1), expected)
    assert torch.equal(weights_of(one), weights_of(other))
    another = fit_network(toy_dataset, quick(steps=3, seed=1))
    assert not torch.equal(weights_of(one), weights_of(another))


def test_a_step_without_a_finite_gradient_is_left_out(toy_dataset, monkeypatch):
    config = quick(steps=6, evaluate_every=2)
    alone = fit_network(toy_dataset, config)
    open_source = recurrent.open_source

    class Damaged:
        def __init__(self, *arguments):
            self.source, self.drawn = open_source(*arguments), 0

        def draw(self, size, rng):
            batch, self.drawn = self.source.draw(size, rng), self.drawn + 1
            return batch if self.drawn <= 2 else batch._replace(x=batch.x * torch.nan)

    monkeypatch.setattr(recurrent, "open_source", Damaged)
    damaged = fit_network(toy_dataset, config)
    assert torch.isfinite(weights_of(damaged)).all()
    assert not torch.equal(weights_of(alone), weights_of(damaged))


def test_only_the_last_rows_of_a_longer_past_are_used(fitted, toy_dataset):
    windows = toy_dataset.select("test")
    short, _ = predict(fitted, windows._replace(past=windows.past[:, -4:]))
    long, _ = predict(fitted, windows)
    assert np.array_equal(short, long)


@pytest.mark.parametrize(
    ("scores", "most_cpu_s", "evaluations", "is_converged"),
    [([-1.0, -3.0, -2.0, -2.5], 600.0, 7, True), ([-1.0, -2.0], 0.0, 2, False)],
    ids=["flat", "no CPU time"],
)
def test_training_ends_with_a_falling_rate_and_keeps_the_best_network(
    toy_dataset, monkeypatch, scores, most_cpu_s, evaluations, is_converged
):
    """It falls over 40 % of all steps, after 8 of 13 steps or after the first evaluation."""
    seen, found = [], iter(scores)

    def score(model, windows):
        seen.append(weights_of(model).clone())
        return next(found, 0.0)

    monkeypatch.setattr(recurrent, "validation_score", score)
    monkeypatch.setattr(recurrent, "MOST_CPU_S", most_cpu_s)
    monkeypatch.setattr(recurrent, "PATIENCE", 2)
    model = fit_network(toy_dataset, quick(steps=400, evaluate_every=2))
    assert (len(seen), model.is_converged) == (evaluations, is_converged)
    assert torch.equal(weights_of(model), seen[1])
    assert not_converged({"lti": Persistence(), "gru": model}) == (() if is_converged else ("gru",))
