"""The recurrent network."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from made_drives import drive, predict

from offline.baselines import recurrent
from offline.baselines.fitting import log_error
from offline.baselines.linear import Persistence
from offline.baselines.recurrent import (
    Settings,
    fit_network,
    has_flattened,
    horizon_of_step,
    is_late,
    rate_at,
)
from offline.baselines.road_path import path_states
from rt_controller.contract.errors import DatasetError

QUICK = Settings(
    hidden=16, encoder=16, past_steps=4, most_steps=60, batch=32, learning_rate=4e-2, warm_up=5
)


@pytest.fixture(scope="module")
def fitted(toy_dataset):
    return fit_network(toy_dataset, QUICK)


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
    baseline, test = fit_network(made, QUICK), made.select("test")
    assert baseline.learned.curvature is None
    assert log_error(baseline, test) < log_error(Persistence(), test) - 0.5


def weights_of(model):
    return torch.nn.utils.parameters_to_vector(model.network.parameters())


def test_training_is_repeatable_and_keeps_the_global_random_state(toy_dataset):
    settings = replace(QUICK, most_steps=3)
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    one, other = fit_network(toy_dataset, settings), fit_network(toy_dataset, settings)
    assert torch.equal(torch.rand(1), expected)
    assert torch.equal(weights_of(one), weights_of(other))
    another = fit_network(toy_dataset, replace(settings, seed=1))
    assert not torch.equal(weights_of(one), weights_of(another))


def test_a_window_counts_with_its_weight(toy_dataset, monkeypatch):
    """One of weight zero has no effect, whatever its states are."""
    open_source = recurrent.open_source

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
        monkeypatch.setattr(recurrent, "open_source", Weighted(weight, shift).open)
        return weights_of(fit_network(toy_dataset, replace(QUICK, most_steps=2)))

    assert torch.equal(trained(0.0, 0.0), trained(0.0, 3.0))
    assert not torch.equal(trained(1.0, 0.0), trained(1.0, 3.0))


def test_training_restores_the_number_of_threads(toy_dataset):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        fit_network(toy_dataset, replace(QUICK, most_steps=1))
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


def test_a_car_on_a_road_with_other_inputs_has_an_integrated_path_too(toy_dataset):
    schema = toy_dataset.schema
    other = replace(
        schema, inputs=tuple(each._replace(name=f"my_{each.name}") for each in schema.inputs)
    )
    past = tuple(name for name in toy_dataset.roles.past if name in schema.state_names)
    roles = replace(toy_dataset.roles, past=past, odd=None)
    data = replace(toy_dataset, manifest=replace(toy_dataset.manifest, schema=other, roles=roles))
    model = fit_network(data, replace(QUICK, most_steps=2))
    assert model.learned.curvature == 0
    predicted, _ = predict(model, data.select("test"))
    assert predicted.shape[-1] == 6


def test_the_rate_rises_stays_and_falls_to_zero():
    settings = Settings(learning_rate=1.0, warm_up=10, decay=0.4)
    rates = [rate_at(step, 100, settings) for step in range(101)]
    assert rates[4] == pytest.approx(0.5)
    assert rates[10:61] == pytest.approx([1.0] * 51)
    assert rates[80] == pytest.approx(0.5)
    assert rates[100] == pytest.approx(0.0)


def test_a_validation_error_is_flat_if_its_last_third_brought_too_little():
    settings = Settings(least_evaluations=6, flat_gain=0.02)
    assert has_flattened([0.0, -1.0, -1.0, -1.0, -1.01, -0.9], settings)
    assert not has_flattened([0.0, -1.0, -1.0, -1.0, -1.03, -0.9], settings)
    assert not has_flattened([0.0, 0.0, 0.0, 0.0, 0.0], settings)


def test_training_ends_soon_after_its_validation_error_is_flat(toy_dataset):
    settings = replace(
        QUICK, most_steps=400, evaluate_every=2, least_evaluations=3, flat_gain=1 - 1e-9
    )
    found = fit_network(toy_dataset, settings).training
    assert found.is_flat
    assert found.steps == 10  # 6 steps until then, and 40 % of all in which the rate falls
    assert found.curve[-1][0] == 10


def test_training_without_cpu_time_left_ends_with_a_falling_rate_and_is_not_converged(toy_dataset):
    settings = replace(QUICK, most_steps=400, evaluate_every=6, most_cpu_s=0.0)
    found = fit_network(toy_dataset, settings)
    assert not found.is_converged
    assert found.training.steps == 10  # the first look at the time is after 6 steps
    facts = {fact.name: fact.value for fact in found.fit_info()}
    assert facts["end of the training"] == "not converged"


def test_the_rate_falls_so_early_that_the_cpu_time_is_kept():
    """One second for 100 steps: of 1,000 steps in 10 s the last 400 have a falling rate."""
    settings = Settings(evaluate_every=100, most_cpu_s=10.0, decay=0.4)
    late = [is_late(step, step / 100.0, 1.0, settings) for step in (400, 500, 600)]
    assert late == [False, False, True]


def test_the_report_of_a_fit_has_steps_the_reason_of_the_end_and_the_curve(fitted):
    facts = {fact.name: fact.value for fact in fitted.fit_info()}
    assert facts["training steps"] == "60"
    assert facts["end of the training"] == "not converged"
    assert facts["validation log error"].endswith("after 60")


def test_roll_outs_grow_to_the_whole_horizon():
    settings = Settings(most_steps=1_000, first_horizon=8, horizon_growth=0.1)
    found = [horizon_of_step(step, 80, settings) for step in (0, 50, 100, 500)]
    assert found == [8, 44, 80, 80]
    assert horizon_of_step(0, 5, settings) == 5


def test_the_network_of_the_smallest_validation_error_is_kept(toy_dataset, monkeypatch):
    scores = iter([-1.0, -3.0, -2.0])
    seen = []

    def score(model, windows):
        seen.append(weights_of(model).clone())
        return next(scores)

    monkeypatch.setattr(recurrent, "validation_score", score)
    found = fit_network(toy_dataset, replace(QUICK, most_steps=6, evaluate_every=2))
    assert torch.equal(weights_of(found), seen[1])
    assert not torch.equal(seen[1], seen[2])


def test_a_step_without_a_finite_gradient_is_left_out(toy_dataset, monkeypatch):
    open_source = recurrent.open_source

    class Damaged:
        def __init__(self, *arguments):
            self.source, self.drawn = open_source(*arguments), 0

        def draw(self, size, rng):
            self.drawn += 1
            batch = self.source.draw(size, rng)
            if self.drawn > 2:
                batch.x[1:] = torch.nan
            return batch

    alone = fit_network(toy_dataset, replace(QUICK, most_steps=6, evaluate_every=2))
    monkeypatch.setattr(recurrent, "open_source", Damaged)
    damaged = fit_network(toy_dataset, replace(QUICK, most_steps=6, evaluate_every=2))
    assert torch.isfinite(weights_of(damaged)).all()
    assert not torch.equal(weights_of(alone), weights_of(damaged))
