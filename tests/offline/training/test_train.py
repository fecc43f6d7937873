"""Training: repeatable, resumable from any step, and sound where numbers are not."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from run_contents import history, weights_equal

from offline.config import PRESETS
from offline.data.dataset import Dataset
from offline.data.manifest import PARTS
from offline.data.recording import Recording
from offline.data.sampling import SliceSource, scale
from offline.data.signals import fit_scaling
from offline.model.bundle_predictor import BundlePredictor
from offline.model.losses import evaluate
from offline.training import export as export_module
from offline.training import train as training
from offline.training.export import export_checkpoint
from offline.training.initial import with_structure_of
from offline.training.optimizer import cosine_rate
from offline.training.run import load_checkpoint, restore_model, save_checkpoint
from offline.training.state import MOST_RECOVERIES, TrainingDivergedError, largest_step
from offline.training.train import train
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.model.bundle import Bundle


def stop_after(steps):
    asked = itertools.count()
    return lambda: next(asked) >= steps


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


def test_a_data_set_without_validation_episodes_is_refused(config, toy_dataset, new_run):
    """No model could be selected."""
    everything_trains = replace(toy_dataset, part=np.zeros_like(toy_dataset.part))
    with pytest.raises(DatasetError, match="validation"):
        train(config, everything_trains, new_run(config))


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


def poison_operator(checkpoint):
    checkpoint.model["A_rows"].fill_(torch.nan)


def poison_encoder(checkpoint):
    checkpoint.model["encoders.0.layers.0.weight"].fill_(torch.inf)


def poison_moments(checkpoint):
    """The gradient is finite, but the step is not."""
    for part in checkpoint.training["optimizer"]["parts"]:
        for each in part["state"].values():
            for moment in ("exp_avg", "momentum_buffer"):
                if moment in each:
                    each[moment].fill_(torch.nan)


poisons = pytest.mark.parametrize("poison", [poison_operator, poison_encoder, poison_moments])


@poisons
def test_a_run_goes_on_from_its_last_evaluation_with_half_the_rate(
    config, toy_dataset, new_run, poison
):
    run = new_run(config)
    train(config, toy_dataset, run, stop_requested=stop_after(8))
    sound = load_checkpoint(run.last)
    poisoned = load_checkpoint(run.last)
    poison(poisoned)
    rates = []
    result = train(
        config,
        toy_dataset,
        run,
        resume_from=poisoned,
        on_progress=lambda state: rates.append((state.rate_share, state.optimizer.rate)),
    )
    assert result.is_finished
    lines = history(run)
    assert [line["step"] for line in lines] == [0, 5, 10, 11]
    assert [line["rate_share"] for line in lines] == [1.0, 1.0, 0.5, 0.5]
    assert all(np.isfinite(line["validation"]["total"]) for line in lines)
    assert rates[-1][0] == 0.5
    assert sound.training["rate_share"] == 1.0
    assert load_checkpoint(run.last).training["rate_share"] == 0.5


def test_the_largest_step_in_the_data_is_named_with_its_episode(toy_dataset):
    recording = toy_dataset.recording
    scaling = fit_scaling(toy_dataset.select("train"), toy_dataset.schema, toy_dataset.roles)
    x = recording.x.copy()
    row = recording.first[7] + 12
    x[row + 1 :, 1] += 40.0 * scaling.x_scale[1]
    x[recording.first[8] :, 1] -= 40.0 * scaling.x_scale[1]
    jumping: Recording = recording._replace(x=x)
    found = largest_step(replace(toy_dataset, recording=jumping), scaling)
    assert "that of vy_mps after sample 12 of episode 7: " in found
    assert float(found.rsplit(": ")[1].split(" ")[0]) == pytest.approx(40.0, rel=0.1)


def other_inputs(dataset: Dataset) -> Dataset:
    """The same drives by a car with half the effect of every input."""
    recording = dataset.recording
    return replace(dataset, recording=recording._replace(u=2.0 * recording.u))


def predictions(bundle: Bundle, dataset: Dataset) -> np.ndarray:
    x, u, w, past = (part.astype(float) for part in dataset.select("validation")[:4])
    return BundlePredictor(bundle).predict(x[:, 0], past, u, w)


def test_a_run_evaluates_after_the_first_step_then_periodically_and_at_the_end(
    finished, toy_dataset
):
    """Scaling is fitted on the training part only."""
    assert [line["step"] for line in history(finished)] == [0, 5, 10, 11]
    last = load_checkpoint(finished.last)
    assert last.step == 12
    schema, roles = toy_dataset.schema, toy_dataset.roles
    expected = fit_scaling(toy_dataset.select("train"), schema, roles)
    for name in ("x_centre", "x_scale", "u_scale", "w_scale", "past_centre", "past_scale"):
        assert np.array_equal(getattr(last.scaling, name), getattr(expected, name)), name


def test_the_seed_determines_history_and_model(config, finished, toy_dataset, new_run):
    again, other = new_run(config), new_run(config)
    rates = []
    hear = {"on_progress": lambda state: rates.append(state.optimizer.rate)}
    train(config, toy_dataset, again, **hear)
    train(config.model_copy(update={"seed": 1}), toy_dataset, other)
    assert again.history.read_bytes() == finished.history.read_bytes()
    models = [load_checkpoint(run.last).model for run in (finished, again, other)]
    assert weights_equal(models[0], models[1])
    assert not weights_equal(models[0], models[2])
    if config.rate_schedule == "cosine":
        assert rates == [cosine_rate(step, 12, config.learning_rate) for step in range(12)]


@pytest.mark.parametrize("stopped_after", [0, 3, 6, 8])
def test_a_resumed_run_equals_an_uninterrupted_one_bit_by_bit(
    config, finished, toy_dataset, new_run, stopped_after
):
    halved = new_run(config)
    stopped = train(config, toy_dataset, halved, stop_requested=stop_after(stopped_after))
    assert (stopped.step, stopped.is_finished) == (stopped_after, False)
    assert (stopped.best_validation_loss == np.inf) is (stopped_after == 0)
    torch.manual_seed(999)
    train(config, toy_dataset, halved, resume_from=load_checkpoint(halved.last))

    assert finished.history.read_bytes() == halved.history.read_bytes()
    one, other = load_checkpoint(finished.last), load_checkpoint(halved.last)
    assert weights_equal(one.model, other.model)
    assert torch.equal(one.training["batch_rng"], other.training["batch_rng"])
    assert weights_equal(load_checkpoint(finished.best).model, load_checkpoint(halved.best).model)


@pytest.mark.parametrize("windows", ["slices", "all"])
def test_held_back_episodes_do_not_change_the_model(config, toy_dataset, new_run, windows):
    config = config.model_copy(update={"windows": windows, "steps": 4})
    recording = toy_dataset.recording
    held_back = np.repeat(toy_dataset.part != PARTS.index("train"), recording.lengths)
    others = replace(toy_dataset, recording=recording._replace(u=recording.u + held_back[:, None]))
    kept = []
    for data in (toy_dataset, others):
        run = new_run(config)
        train(config, data, run)
        kept.append(load_checkpoint(run.last).model)
    assert weights_equal(*kept)


def test_the_best_checkpoint_has_the_lowest_validation_loss(tiny_config, toy_dataset, new_run):
    run = new_run(tiny_config.model_copy(update={"learning_rate": 0.05, "steps": 150}))
    train(run.config, toy_dataset, run)
    lines = history(run)
    losses = [line["validation"]["total"] for line in lines]
    best = losses.index(min(losses))
    assert 0 < best < len(losses) - 1
    assert losses[best] < 0.7 * losses[0]
    checkpoint = load_checkpoint(run.best)
    assert checkpoint.step == lines[best]["step"] + 1
    schema, roles = toy_dataset.schema, toy_dataset.roles
    model = restore_model(checkpoint, schema, roles)
    part = toy_dataset.select("validation")
    batch = scale(part, checkpoint.scaling, schema, roles, run.config.history_steps)
    assert evaluate(model, run.config, batch, torch.device("cpu")).total == min(losses)


def test_training_with_the_literal_losses_lowers_the_validation_loss(
    tiny_config, toy_dataset, new_run
):
    small = tiny_config.model_dump(include={"batch", "hidden", "latents", "threads"})
    small |= {"steps": 100, "evaluate_every": 50}
    run = new_run(PRESETS["paper-literal"].model_copy(update=small))
    train(run.config, toy_dataset, run)
    first, *_, last = (line["validation"]["total"] for line in history(run))
    assert last < first


@poisons
def test_a_loss_that_is_never_finite_ends_the_run_and_keeps_the_best_model(
    config, toy_dataset, new_run, poison
):
    run = new_run(config)
    train(config, toy_dataset, run, stop_requested=stop_after(10))
    best = run.best.read_bytes()
    poisoned = load_checkpoint(run.last)
    poison(poisoned)
    save_checkpoint(run.last, poisoned)
    with pytest.raises(TrainingDivergedError, match="--learning-rate") as error:
        train(config, toy_dataset, run, resume_from=poisoned)
    assert f"also with {0.5**MOST_RECOVERIES:g} of the learning rate" in str(error.value)
    assert "The largest change within one period is that of" in str(error.value)
    assert run.best.read_bytes() == best
    assert all(torch.isfinite(tensor).all() for tensor in load_checkpoint(run.best).model.values())


def test_a_run_ends_if_the_gradient_is_never_finite(tiny_config, toy_dataset, new_run, monkeypatch):
    monkeypatch.setattr(training, "clip_grad_norm_", lambda *ignored: torch.tensor(torch.inf))
    config = tiny_config.model_copy(update={"steps": 1000, "patience": 1000, "hidden": (4,)})
    with pytest.raises(TrainingDivergedError, match="the gradient"):
        train(config, toy_dataset, new_run(config))


@pytest.fixture
def any_model_is_exported(monkeypatch):
    """A model that was trained for seconds does not pass the checks."""
    monkeypatch.setattr(export_module, "check_export", lambda *rest: None)


def test_a_training_begins_with_the_structure_and_the_predictions_of_a_bundle(
    any_model_is_exported, finished, config, toy_dataset, new_run
):
    bundle, _ = export_checkpoint(load_checkpoint(finished.best), toy_dataset)
    wider = config.model_copy(update={"hidden": (7,), "learning_rate": 1e-30})
    still = with_structure_of(bundle, wider, {})
    assert still.hidden == config.hidden
    data, run = other_inputs(toy_dataset), new_run(still)
    train(still, data, run, first_model=bundle)
    begun, _ = export_checkpoint(load_checkpoint(run.last), data)
    expected, found = (predictions(each, toy_dataset) for each in (bundle, begun))
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()

    with pytest.raises(ConfigError, match="hidden"):
        with_structure_of(replace(bundle, training="{}"), config, {})
    with pytest.raises(ConfigError, match="--hidden"):
        with_structure_of(bundle, config, {"hidden": (7,)})
    other = replace(bundle, schema=replace(bundle.schema, dt_s=0.05))
    with pytest.raises(ConfigError, match="every 0\\.05 s"):
        train(config, toy_dataset, new_run(config), first_model=other)


def test_a_training_begins_with_a_model_of_a_car_without_symmetry(
    any_model_is_exported, tiny_recommended, toy_dataset, new_run
):
    manifest, roles = toy_dataset.manifest, replace(toy_dataset.roles, odd=None)
    data = replace(toy_dataset, manifest=replace(manifest, roles=roles))
    run = new_run(tiny_recommended)
    train(tiny_recommended, data, run)
    bundle, _ = export_checkpoint(load_checkpoint(run.last), data)
    slow = tiny_recommended.model_copy(update={"init": "any", "learning_rate": 1e-30})
    still = with_structure_of(bundle, slow, {})
    run = new_run(still)
    train(still, data, run, first_model=bundle)
    begun, _ = export_checkpoint(load_checkpoint(run.last), data)
    expected, found = (predictions(each, data) for each in (bundle, begun))
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
