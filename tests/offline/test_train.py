"""A run is repeatable, survives being stopped, and never loses its best model."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from offline.batch import scale
from offline.checkpoint import load_checkpoint
from offline.config import PRESETS
from offline.dataset import PARTS
from offline.learner import Learner
from offline.model import sizes_of
from offline.scaling import fit_scaling
from offline.train import TrainingDivergedError, train
from rt_controller.contract.errors import DatasetError


@pytest.fixture(params=["paper", "recommended"])
def config(request, tiny_config, tiny_recommended):
    return {"paper": tiny_config, "recommended": tiny_recommended}[request.param]


def weights_equal(one, other) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)


def history(run):
    return [json.loads(line) for line in run.history.read_text().splitlines()]


def stop_after(steps):
    asked = itertools.count()
    return lambda: next(asked) >= steps


def test_a_run_evaluates_after_the_first_step_every_so_many_and_at_the_end(
    config, toy_dataset, new_run
):
    run = new_run(config)
    outcome = train(config, toy_dataset, run)
    assert outcome.is_finished
    assert [line["step"] for line in history(run)] == [0, 5, 10, 11]
    assert load_checkpoint(run.last).step == 12


def test_training_lowers_the_validation_loss(tiny_config, toy_dataset, new_run):
    config = tiny_config.model_copy(update={"steps": 150, "evaluate_every": 50})
    run = new_run(config)
    train(config, toy_dataset, run)
    losses = [line["validation"]["total"] for line in history(run)]
    assert losses[-1] < 0.3 * losses[0]


def test_a_rate_that_was_halved_ten_times_ends_a_run(tiny_config, toy_dataset, new_run):
    """A rate of next to nothing: the loss stays what it is, and every evaluation halves."""
    still = {"learning_rate": 1e-30, "patience": 1, "evaluate_every": 1, "steps": 50}
    run = new_run(tiny_config.model_copy(update=still))
    outcome = train(run.config, toy_dataset, run)
    assert outcome.is_finished
    assert outcome.step == 11
    assert history(run)[-1]["learning_rate"] == pytest.approx(1e-30 / 1024)
    again = train(run.config, toy_dataset, run, resume_from=load_checkpoint(run.last))
    assert (again.is_finished, again.step) == (True, 11)


def test_a_cosine_has_no_rate_too_low_to_go_on(tiny_recommended, toy_dataset, new_run):
    run = new_run(tiny_recommended)
    assert train(run.config, toy_dataset, run).step == run.config.steps


def test_training_on_the_horizon_lowers_every_kind_of_error_it_is_about(
    tiny_recommended, toy_dataset, new_run
):
    """The loss is a logarithm: one less is errors of a third."""
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
def test_a_stopped_run_resumes_as_if_it_had_never_stopped(
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
    assert torch.equal(one.batch_rng, other.batch_rng)
    assert weights_equal(load_checkpoint(whole.best).model, load_checkpoint(halved.best).model)


def test_best_checkpoint_is_the_one_of_the_lowest_validation_loss(
    tiny_config, toy_dataset, new_run
):
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
    learner = Learner(config, sizes_of(schema, roles), checkpoint.scaling, toy_dataset.sha256)
    learner.restore(checkpoint)
    validation = toy_dataset.select("validation")
    batch = scale(validation, checkpoint.scaling, schema, roles, config.history_steps)
    assert learner.evaluate(batch)[0] == min(losses)


def test_loss_that_is_told_as_the_best_is_the_one_of_the_model_that_was_kept(
    tiny_config, toy_dataset, new_run
):
    """As printed, a loss below its neighbour's is kept, though a lower one was met before."""
    config = tiny_config.model_copy(update={"best_rule": "as-printed"})
    run = new_run(config)
    train(config, toy_dataset, run, stop_requested=stop_after(8))
    halfway = replace(load_checkpoint(run.last), validation_losses=[1e-9, 1e9])

    heard = []
    outcome = train(config, toy_dataset, run, resume_from=halfway, on_progress=heard.append)
    kept = load_checkpoint(run.best).validation_losses[-1]
    assert 1e-9 < kept < 1e9
    assert outcome.best_validation_loss == kept
    assert heard[0].best_validation_loss == 1e-9
    assert heard[-1].best_validation_loss == kept


def test_a_run_that_was_stopped_at_once_has_no_best_loss(tiny_config, toy_dataset, new_run):
    outcome = train(tiny_config, toy_dataset, new_run(tiny_config), stop_requested=lambda: True)
    assert outcome.best_validation_loss is None


def test_scaling_is_fitted_on_the_training_part_only(config, toy_dataset, new_run):
    schema, roles = toy_dataset.schema, toy_dataset.roles
    expected = fit_scaling(toy_dataset.select("train"), schema, roles)
    run = new_run(config)
    train(config, toy_dataset, run)
    kept = load_checkpoint(run.best).scaling
    for name in ("x_centre", "x_scale", "u_scale", "w_scale", "past_centre", "past_scale"):
        assert np.array_equal(getattr(kept, name), getattr(expected, name)), name


def test_a_data_set_without_validation_episodes_is_refused(config, toy_dataset, new_run):
    """No model could be chosen: every loss would be the mean of nothing."""
    everything_trains = replace(toy_dataset, part=np.zeros_like(toy_dataset.part))
    with pytest.raises(DatasetError, match="validation"):
        train(config, everything_trains, new_run(config))


def poison_operator(checkpoint):
    checkpoint.model["A_rows"].fill_(torch.nan)


def poison_encoder(checkpoint):
    checkpoint.model["encoder.layers.0.weight"].fill_(torch.inf)


def poison_moments_of_operator(checkpoint):
    """The gradient is a number, and the step that Adam makes of it is none."""
    moments = checkpoint.optimizer["state"]
    for each in moments.values():
        each["exp_avg"].fill_(torch.nan)


@pytest.mark.parametrize("poison", [poison_operator, poison_encoder, poison_moments_of_operator])
@pytest.mark.parametrize("stopped_after", [8, 10])
def test_a_loss_that_is_no_number_stops_the_run_and_keeps_the_best_model(
    config, toy_dataset, new_run, poison, stopped_after
):
    run = new_run(config)
    train(config, toy_dataset, run, stop_requested=stop_after(stopped_after))
    best = run.best.read_bytes()
    poisoned = load_checkpoint(run.last)
    poison(poisoned)
    with pytest.raises(TrainingDivergedError, match="smaller --learning-rate"):
        train(config, toy_dataset, run, resume_from=poisoned)
    assert run.best.read_bytes() == best
    assert all(torch.isfinite(tensor).all() for tensor in load_checkpoint(run.best).model.values())


def test_a_run_whose_gradients_are_never_numbers_gives_up(
    config, toy_dataset, new_run, monkeypatch
):
    as_ever = Learner.update

    def update(learner, losses):
        return as_ever(learner, losses._replace(total=losses.total * torch.inf))

    monkeypatch.setattr(Learner, "update", update)
    with pytest.raises(TrainingDivergedError, match="the gradient"):
        train(config.model_copy(update={"steps": 1000}), toy_dataset, new_run(config))


def test_the_literal_preset_trains_too(tiny_config, toy_dataset, new_run):
    small = tiny_config.model_dump(include={"batch", "hidden", "latents", "threads"})
    config = PRESETS["paper-literal"].model_copy(
        update={**small, "steps": 60, "evaluate_every": 30}
    )
    run = new_run(config)
    outcome = train(config, toy_dataset, run)
    assert outcome.best_validation_loss < history(run)[0]["validation"]["total"]


def radii(config, dataset, run) -> list[float]:
    train(config, dataset, run)
    return [line["spectral_radius"] for line in history(run)]


def test_a_projected_operator_does_not_grow_where_a_free_one_does(
    tiny_recommended, toy_dataset, new_run
):
    """Every tenth step and the last are projected, and these are evaluated here."""
    projected = tiny_recommended.model_copy(update={"steps": 31, "evaluate_every": 10})
    free = projected.model_copy(update={"stability": "gelfand"})
    run = new_run(projected)
    assert max(radii(projected, toy_dataset, run)) <= 1.0 + 1e-5
    assert min(radii(free, toy_dataset, new_run(free))) > 1.0 + 1e-4
    A = load_checkpoint(run.last).model["A_rows"].double().numpy()
    assert np.abs(np.linalg.eigvals(A[:, : len(A)])).max() <= 1.0 + 1e-5


def test_a_projected_operator_stays_near_the_circle_whatever_the_gradient_wants(
    tiny_recommended, toy_dataset, new_run
):
    """Several eigenvalues that are put back meet at 1, and single precision parts them again."""
    wild = {"learning_rate": 0.05, "operator_rate": 1.0, "steps": 31, "evaluate_every": 10}
    projected = tiny_recommended.model_copy(update=wild)
    free = projected.model_copy(update={"stability": "gelfand"})
    assert max(radii(projected, toy_dataset, new_run(projected))) <= 1.0 + 1e-3
    assert max(radii(free, toy_dataset, new_run(free))) > 1.0 + 1e-2


@pytest.mark.parametrize("windows", ["slices", "all"])
def test_episodes_held_back_teach_the_model_nothing(config, toy_dataset, new_run, windows):
    config = config.model_copy(update={"windows": windows})
    recording = toy_dataset.recording
    held_back = np.repeat(toy_dataset.part != PARTS.index("train"), recording.lengths)
    u = recording.u.copy()
    u[held_back] += 1.0
    others = replace(toy_dataset, recording=recording._replace(u=u))
    kept = []
    for data in (toy_dataset, others):
        run = new_run(config)
        train(config, data, run)
        kept.append(load_checkpoint(run.last).model)
    assert weights_equal(*kept)
