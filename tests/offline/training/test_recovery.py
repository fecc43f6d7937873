"""A training whose numbers are not finite returns to its last evaluation, or ends."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from run_contents import history

from offline.data.recording import Recording
from offline.data.signals import fit_scaling
from offline.training import train as training
from offline.training.run import load_checkpoint, save_checkpoint
from offline.training.state import MOST_RECOVERIES, TrainingDivergedError, largest_step
from offline.training.train import train


def stop_after(steps):
    asked = itertools.count()
    return lambda: next(asked) >= steps


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
@pytest.mark.parametrize("stopped_after", [8, 10])
def test_a_loss_that_is_never_finite_ends_the_run_and_keeps_the_best_model(
    config, toy_dataset, new_run, poison, stopped_after
):
    run = new_run(config)
    train(config, toy_dataset, run, stop_requested=stop_after(stopped_after))
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
        on_progress=lambda state: rates.append((state.rate_share, state.learning_rate)),
    )
    assert result.is_finished
    lines = history(run)
    assert [line["step"] for line in lines] == [0, 5, 10, 11]
    assert [line["rate_share"] for line in lines] == [1.0, 1.0, 0.5, 0.5]
    assert all(np.isfinite(line["validation"]["total"]) for line in lines)
    assert rates[-1][0] == 0.5
    assert sound.training["rate_share"] == 1.0
    assert load_checkpoint(run.last).training["rate_share"] == 0.5


def test_a_run_ends_if_the_gradient_is_never_finite(config, toy_dataset, new_run, monkeypatch):
    monkeypatch.setattr(training, "clip_grad_norm_", lambda *ignored: torch.tensor(torch.inf))
    config = config.model_copy(update={"steps": 1000, "patience": 1000})
    with pytest.raises(TrainingDivergedError, match="the gradient"):
        train(config, toy_dataset, new_run(config))


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
