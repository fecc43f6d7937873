"""A run is repeatable, survives being stopped, and never loses its best model."""

import itertools
import json
from dataclasses import replace
from datetime import datetime

import pytest
import torch

from offline.checkpoint import load_checkpoint, save_checkpoint
from offline.config import PRESETS
from offline.learner import Learner, normalise
from offline.run_folder import create_run, cut_history, open_run
from offline.scaling import fit_scaling
from offline.train import TrainingDivergedError, train
from rt_controller.contract.errors import ArtifactError, RtControllerError

NOW = datetime(2026, 1, 2, 3, 4, 5)


@pytest.fixture
def new_run(tmp_path, toy_folder, toy_dataset):
    numbers = itertools.count()

    def create(config):
        base = tmp_path / str(next(numbers))
        return create_run(base, config, toy_folder, toy_dataset.sha256, NOW)

    return create


def weights_equal(one, other) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)


def history(run):
    return [json.loads(line) for line in run.history.read_text().splitlines()]


def test_a_run_evaluates_after_the_first_step_every_so_many_and_at_the_end(
    tiny_config, toy_dataset, new_run
):
    run = new_run(tiny_config)
    outcome = train(tiny_config, toy_dataset, run)
    assert outcome.is_finished
    assert [line["step"] for line in history(run)] == [0, 5, 10, 11]
    assert load_checkpoint(run.last).step == 12


def test_training_lowers_the_validation_loss(tiny_config, toy_dataset, new_run):
    config = tiny_config.model_copy(update={"steps": 150, "evaluate_every": 50})
    run = new_run(config)
    train(config, toy_dataset, run)
    losses = [line["validation"]["total"] for line in history(run)]
    assert losses[-1] < 0.3 * losses[0]


def test_equal_seeds_write_equal_histories_and_models(tiny_config, toy_dataset, new_run):
    first, second = new_run(tiny_config), new_run(tiny_config)
    for run in (first, second):
        train(tiny_config, toy_dataset, run)
    assert first.history.read_bytes() == second.history.read_bytes()
    assert weights_equal(load_checkpoint(first.last).model, load_checkpoint(second.last).model)


def test_another_seed_trains_another_model(tiny_config, toy_dataset, new_run):
    first, second = new_run(tiny_config), new_run(tiny_config)
    train(tiny_config, toy_dataset, first)
    train(tiny_config.model_copy(update={"seed": 1}), toy_dataset, second)
    assert not weights_equal(load_checkpoint(first.last).model, load_checkpoint(second.last).model)


@pytest.mark.parametrize("stop_after", [0, 3, 6, 8])
def test_a_stopped_run_resumes_as_if_it_had_never_stopped(
    tiny_config, toy_dataset, new_run, stop_after
):
    whole, halved = new_run(tiny_config), new_run(tiny_config)
    train(tiny_config, toy_dataset, whole)

    asked = itertools.count()
    stopped = train(
        tiny_config, toy_dataset, halved, stop_requested=lambda: next(asked) >= stop_after
    )
    assert (stopped.step, stopped.is_finished) == (stop_after, False)
    torch.manual_seed(999)
    train(tiny_config, toy_dataset, halved, resume_from=load_checkpoint(halved.last))

    assert whole.history.read_bytes() == halved.history.read_bytes()
    one, other = load_checkpoint(whole.last), load_checkpoint(halved.last)
    assert weights_equal(one.model, other.model)
    assert torch.equal(one.batch_rng, other.batch_rng)
    assert weights_equal(load_checkpoint(whole.best).model, load_checkpoint(halved.best).model)


def test_evaluations_after_the_checkpoint_are_forgotten_on_resume(
    tiny_config, toy_dataset, new_run
):
    """A crash may leave history lines that the last checkpoint does not know."""
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    cut_history(run, 6)
    assert [line["step"] for line in history(run)] == [0, 5]


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
    learner = Learner(config, checkpoint.scaling, toy_dataset.sha256)
    learner.restore(checkpoint)
    x, u = normalise(toy_dataset.select("validation"), checkpoint.scaling)
    assert learner.evaluate(x, u)[0] == min(losses)


def test_loss_that_is_told_as_the_best_is_the_one_of_the_model_that_was_kept(
    tiny_config, toy_dataset, new_run
):
    """As printed, a loss below its neighbour's is kept, though a lower one was met before."""
    config = tiny_config.model_copy(update={"best_rule": "as-printed"})
    run = new_run(config)
    asked = itertools.count()
    train(config, toy_dataset, run, stop_requested=lambda: next(asked) >= 8)
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


def test_a_loss_that_is_no_number_stops_the_run_and_keeps_the_best_model(
    tiny_config, toy_dataset, new_run
):
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    best = run.best.read_bytes()
    poisoned = load_checkpoint(run.last)
    poisoned.model["A_rows"].fill_(torch.nan)
    longer = tiny_config.model_copy(update={"steps": 20})
    with pytest.raises(TrainingDivergedError, match="smaller --learning-rate"):
        train(longer, toy_dataset, run, resume_from=poisoned)
    assert run.best.read_bytes() == best
    assert all(torch.isfinite(tensor).all() for tensor in load_checkpoint(run.best).model.values())


def test_a_gradient_that_is_no_number_is_skipped_and_counted(tiny_config, toy_dataset):
    train_part = toy_dataset.select("train")
    scaling = fit_scaling(train_part.x, train_part.u, train_part.kappa)
    learner = Learner(tiny_config, scaling, toy_dataset.sha256)
    losses = learner.losses_on_random_batch(*normalise(train_part, scaling))
    before = {name: tensor.clone() for name, tensor in learner.model.state_dict().items()}
    assert not learner.update(losses._replace(total=losses.total * torch.inf))
    assert learner.skipped == 1
    assert weights_equal(before, learner.model.state_dict())


def test_validation_loss_does_not_depend_on_how_it_is_cut_into_chunks(
    tiny_config, toy_dataset, monkeypatch
):
    train_part = toy_dataset.select("train")
    scaling = fit_scaling(train_part.x, train_part.u, train_part.kappa)
    learner = Learner(tiny_config, scaling, toy_dataset.sha256)
    x, u = normalise(train_part, scaling)
    whole = learner.evaluate(x, u)
    monkeypatch.setattr("offline.learner.EVALUATION_CHUNK", 37)
    assert learner.evaluate(x, u) == pytest.approx(whole, rel=1e-5)


def test_the_literal_preset_trains_too(tiny_config, toy_dataset, new_run):
    small = tiny_config.model_dump(include={"batch", "hidden", "latents", "threads"})
    config = PRESETS["paper-literal"].model_copy(
        update={**small, "steps": 60, "evaluate_every": 30}
    )
    run = new_run(config)
    outcome = train(config, toy_dataset, run)
    assert outcome.best_validation_loss < history(run)[0]["validation"]["total"]


def test_latest_points_to_the_newest_run(tiny_config, tmp_path, toy_folder, toy_dataset):
    for second in (5, 6):
        now = NOW.replace(second=second)
        newest = create_run(tmp_path, tiny_config, toy_folder, toy_dataset.sha256, now)
    opened = open_run(tmp_path / "latest")
    assert opened.path == newest.path.resolve()
    assert opened.config == tiny_config
    assert opened.data_sha256 == toy_dataset.sha256
    assert "torch" in opened.versions


@pytest.mark.parametrize("content", [None, "{", '{"config": {}}', '{"config": {"steps": -1}}'])
def test_a_folder_that_is_no_run_is_refused(tmp_path, content):
    if content is not None:
        (tmp_path / "config.json").write_text(content)
    with pytest.raises(ArtifactError, match="offline-train"):
        open_run(tmp_path)


@pytest.mark.parametrize("keep", [None, 0, 1000])
def test_a_damaged_checkpoint_is_refused(keep, tiny_config, toy_dataset, new_run):
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    whole = run.last.read_bytes()
    run.last.unlink()
    if keep is not None:
        run.last.write_bytes(whole[:keep])
    with pytest.raises(ArtifactError, match="expected a checkpoint"):
        load_checkpoint(run.last)


def test_a_checkpoint_that_cannot_be_written_leaves_the_old_one(
    tiny_config, toy_dataset, new_run, monkeypatch
):
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    before = run.last.read_bytes()

    def full_disk(fields, path):
        path.write_bytes(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("offline.checkpoint.torch.save", full_disk)
    with pytest.raises(RtControllerError, match="No space left"):
        save_checkpoint(run.last, load_checkpoint(run.last))
    assert run.last.read_bytes() == before
    assert sorted(path.suffix for path in run.path.iterdir()) == [".json", ".jsonl", ".pt", ".pt"]
