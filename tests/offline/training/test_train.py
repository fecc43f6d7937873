"""Training: repeatable, resumable, and the best model is kept."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from run_contents import history, weights_equal

from offline.config import PRESETS
from offline.data.manifest import PARTS
from offline.data.sampling import SliceSource, scale
from offline.data.signals import fit_scaling
from offline.model.losses import evaluate
from offline.training import train as training
from offline.training.optimizer import cosine_rate
from offline.training.run import load_checkpoint, restore_model
from offline.training.state import TrainingDivergedError
from offline.training.train import train
from rt_controller.contract.errors import DatasetError


def stop_after(steps):
    asked = itertools.count()
    return lambda: next(asked) >= steps


def test_a_run_evaluates_after_the_first_step_then_periodically_and_at_the_end(
    config, toy_dataset, new_run
):
    run = new_run(config)
    result = train(config, toy_dataset, run)
    assert result.is_finished
    assert [line["step"] for line in history(run)] == [0, 5, 10, 11]
    assert load_checkpoint(run.last).step == 12


def test_training_lowers_the_validation_loss(tiny_config, toy_dataset, new_run):
    config = tiny_config.model_copy(update={"steps": 150, "evaluate_every": 50})
    run = new_run(config)
    train(config, toy_dataset, run)
    losses = [line["validation"]["total"] for line in history(run)]
    assert losses[-1] < 0.3 * losses[0]


def test_a_run_ends_after_ten_halvings_of_the_rate(tiny_config, toy_dataset, new_run):
    """With a negligible rate the loss is constant and every evaluation halves the rate."""
    still = {"learning_rate": 1e-30, "patience": 1, "evaluate_every": 1, "steps": 50}
    run = new_run(tiny_config.model_copy(update=still))
    result = train(run.config, toy_dataset, run)
    assert result.is_finished
    assert result.step == 11
    assert history(run)[-1]["learning_rate"] == pytest.approx(1e-30 / 1024)
    again = train(run.config, toy_dataset, run, resume_from=load_checkpoint(run.last))
    assert (again.is_finished, again.step) == (True, 11)


def test_a_cosine_schedule_does_not_end_a_run_early(tiny_recommended, toy_dataset, new_run):
    run = new_run(tiny_recommended)
    assert train(run.config, toy_dataset, run).step == run.config.steps


def test_training_with_the_horizon_loss_lowers_the_validation_loss(
    tiny_recommended, toy_dataset, new_run
):
    """The loss is a logarithm: one less means errors of about a third."""
    config = tiny_recommended.model_copy(update={"steps": 150, "evaluate_every": 50})
    run = new_run(config)
    train(config, toy_dataset, run)
    losses = [line["validation"]["total"] for line in history(run)]
    assert losses[-1] < losses[0] - 1.0


def test_equal_seeds_write_equal_histories_and_models(config, toy_dataset, new_run):
    first, second = new_run(config), new_run(config)
    for run in (first, second):
        train(config, toy_dataset, run)
    assert first.history.read_bytes() == second.history.read_bytes()
    assert weights_equal(load_checkpoint(first.last).model, load_checkpoint(second.last).model)


def test_another_seed_trains_another_model(config, toy_dataset, new_run):
    first, second = new_run(config), new_run(config)
    train(config, toy_dataset, first)
    train(config.model_copy(update={"seed": 1}), toy_dataset, second)
    assert not weights_equal(load_checkpoint(first.last).model, load_checkpoint(second.last).model)


@pytest.mark.parametrize("stopped_after", [0, 3, 6, 8])
def test_a_resumed_run_equals_an_uninterrupted_one_bit_by_bit(
    config, toy_dataset, new_run, stopped_after
):
    whole, halved = new_run(config), new_run(config)
    train(config, toy_dataset, whole)

    stopped = train(config, toy_dataset, halved, stop_requested=stop_after(stopped_after))
    assert (stopped.step, stopped.is_finished) == (stopped_after, False)
    torch.manual_seed(999)
    train(config, toy_dataset, halved, resume_from=load_checkpoint(halved.last))

    assert whole.history.read_bytes() == halved.history.read_bytes()
    one, other = load_checkpoint(whole.last), load_checkpoint(halved.last)
    assert weights_equal(one.model, other.model)
    assert torch.equal(one.training["batch_rng"], other.training["batch_rng"])
    assert weights_equal(load_checkpoint(whole.best).model, load_checkpoint(halved.best).model)


def test_the_best_checkpoint_has_the_lowest_validation_loss(tiny_config, toy_dataset, new_run):
    config = tiny_config.model_copy(update={"learning_rate": 0.05, "steps": 150})
    run = new_run(config)
    train(config, toy_dataset, run)
    lines = history(run)
    losses = [line["validation"]["total"] for line in lines]
    best = losses.index(min(losses))
    assert best < len(losses) - 1
    assert load_checkpoint(run.best).step == lines[best]["step"] + 1

    checkpoint = load_checkpoint(run.best)
    schema, roles = toy_dataset.schema, toy_dataset.roles
    model = restore_model(checkpoint, schema, roles)
    validation = toy_dataset.select("validation")
    batch = scale(validation, checkpoint.scaling, schema, roles, config.history_steps)
    assert evaluate(model, config, batch, torch.device("cpu")).total == min(losses)


def test_the_reported_best_loss_is_that_of_the_kept_model(tiny_config, toy_dataset, new_run):
    """The printed rule keeps a loss below the previous one, although a lower one existed."""
    config = tiny_config.model_copy(update={"best_rule": "as-printed"})
    run = new_run(config)
    train(config, toy_dataset, run, stop_requested=stop_after(8))
    halfway = replace(load_checkpoint(run.last), validation_losses=[1e-9, 1e9])

    heard = []

    def hear(state):
        heard.append(state.best_validation_loss)

    result = train(config, toy_dataset, run, resume_from=halfway, on_progress=hear)
    kept = load_checkpoint(run.best).validation_losses[-1]
    assert 1e-9 < kept < 1e9
    assert result.best_validation_loss == kept
    assert (heard[0], heard[-1]) == (1e-9, kept)


def test_a_run_stopped_before_its_first_step_has_no_best_loss(tiny_config, toy_dataset, new_run):
    result = train(tiny_config, toy_dataset, new_run(tiny_config), stop_requested=lambda: True)
    assert result.best_validation_loss == np.inf


def test_scaling_is_fitted_on_the_training_part_only(config, toy_dataset, new_run):
    schema, roles = toy_dataset.schema, toy_dataset.roles
    expected = fit_scaling(toy_dataset.select("train"), schema, roles)
    run = new_run(config)
    train(config, toy_dataset, run)
    kept = load_checkpoint(run.best).scaling
    for name in ("x_centre", "x_scale", "u_scale", "w_scale", "past_centre", "past_scale"):
        assert np.array_equal(getattr(kept, name), getattr(expected, name)), name


def test_a_data_set_without_validation_episodes_is_refused(config, toy_dataset, new_run):
    """No model could be selected."""
    everything_trains = replace(toy_dataset, part=np.zeros_like(toy_dataset.part))
    with pytest.raises(DatasetError, match="validation"):
        train(config, everything_trains, new_run(config))


def test_the_preset_paper_literal_trains(tiny_config, toy_dataset, new_run):
    small = tiny_config.model_dump(include={"batch", "hidden", "latents", "threads"})
    config = PRESETS["paper-literal"].model_copy(
        update={**small, "steps": 60, "evaluate_every": 30}
    )
    run = new_run(config)
    result = train(config, toy_dataset, run)
    assert result.best_validation_loss < history(run)[0]["validation"]["total"]


def test_denormal_numbers_are_zero_during_a_training_and_not_after_it(
    tiny_recommended, toy_dataset, new_run
):
    seen = []

    def halve_the_smallest_normal(state):
        seen.append((torch.tensor(torch.finfo(torch.float32).tiny) * 0.5).item())

    config = tiny_recommended.model_copy(update={"steps": 1})
    train(config, toy_dataset, new_run(config), on_progress=halve_the_smallest_normal)
    assert seen == [0.0]
    assert (torch.tensor(torch.finfo(torch.float32).tiny) * 0.5).item() > 0.0


def test_a_step_whose_gradient_is_not_finite_is_skipped_and_counted(
    config, toy_dataset, new_run, monkeypatch
):
    runs = [new_run(config), new_run(config)]
    train(config, toy_dataset, runs[0], stop_requested=lambda: True)
    monkeypatch.setattr(training, "clip_grad_norm_", lambda *ignored: torch.tensor(torch.nan))
    result = train(config, toy_dataset, runs[1], stop_requested=stop_after(3))
    assert (result.step, result.skipped) == (3, 3)
    assert weights_equal(*(load_checkpoint(run.last).model for run in runs))


def test_the_rate_follows_the_cosine(tiny_recommended, toy_dataset, new_run):
    run = new_run(tiny_recommended)
    rates = []
    train(run.config, toy_dataset, run, on_progress=lambda state: rates.append(state.learning_rate))
    assert rates == [cosine_rate(step, 12, run.config.learning_rate) for step in range(12)]


def test_the_first_roll_outs_have_the_length_of_the_first_horizon(
    tiny_recommended, toy_dataset, new_run, monkeypatch
):
    config = tiny_recommended.model_copy(update={"horizon_start": 8, "windows": "slices"})
    scaling = fit_scaling(toy_dataset.select("train"), toy_dataset.schema, toy_dataset.roles)
    source = SliceSource(toy_dataset, scaling, config.history_steps)
    monkeypatch.setattr(training, "open_source", lambda *ignored: source)
    source._all.x[9:] = torch.nan
    train(config, toy_dataset, new_run(config), stop_requested=stop_after(1))
    source._all.x[8:] = torch.nan
    with pytest.raises(TrainingDivergedError):
        train(config, toy_dataset, new_run(config), stop_requested=stop_after(1))


@pytest.mark.parametrize("windows", ["slices", "all"])
def test_held_back_episodes_do_not_change_the_model(config, toy_dataset, new_run, windows):
    config = config.model_copy(update={"windows": windows})
    recording = toy_dataset.recording
    held_back = np.repeat(toy_dataset.part != PARTS.index("train"), recording.lengths)
    others = replace(toy_dataset, recording=recording._replace(u=recording.u + held_back[:, None]))
    kept = []
    for data in (toy_dataset, others):
        run = new_run(config)
        train(config, data, run)
        kept.append(load_checkpoint(run.last).model)
    assert weights_equal(*kept)
