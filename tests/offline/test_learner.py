"""One step of training: what it draws, what it changes, and at which rate."""

import pytest
import torch

from offline.batch import scale
from offline.learner import Learner
from offline.model import sizes_of
from offline.scaling import fit_scaling
from offline.schedule import cosine_rate
from offline.source import SliceSource, open_source


@pytest.fixture(params=["paper", "recommended"])
def config(request, tiny_config, tiny_recommended):
    return {"paper": tiny_config, "recommended": tiny_recommended}[request.param]


@pytest.fixture
def scaling(toy_dataset):
    return fit_scaling(toy_dataset.select("train"), toy_dataset.schema, toy_dataset.roles)


def a_learner(config, dataset, scaling) -> Learner:
    return Learner(config, sizes_of(dataset.schema, dataset.roles), scaling, dataset.sha256)


def weights_equal(one, other) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)


def test_a_gradient_that_is_no_number_is_skipped_and_counted(config, toy_dataset, scaling):
    learner = a_learner(config, toy_dataset, scaling)
    losses = learner.losses_on_random_batch(open_source(config, toy_dataset, scaling))
    before = {name: tensor.clone() for name, tensor in learner.model.state_dict().items()}
    assert not learner.update(losses._replace(total=losses.total * torch.inf))
    assert learner.skipped == 1
    assert weights_equal(before, learner.model.state_dict())


def test_validation_loss_does_not_depend_on_how_it_is_cut_into_chunks(
    tiny_config, toy_dataset, scaling, monkeypatch
):
    learner = a_learner(tiny_config, toy_dataset, scaling)
    schema, roles = toy_dataset.schema, toy_dataset.roles
    batch = scale(toy_dataset.select("train"), scaling, schema, roles, past_steps=0)
    whole = learner.evaluate(batch)
    monkeypatch.setattr("offline.learner.EVALUATION_CHUNK", 37)
    assert learner.evaluate(batch) == pytest.approx(whole, rel=1e-5)


def test_the_rate_follows_the_cosine_and_the_operators_is_a_share_of_it(
    tiny_recommended, toy_dataset, scaling
):
    learner = a_learner(tiny_recommended, toy_dataset, scaling)
    source = open_source(tiny_recommended, toy_dataset, scaling)
    for step in range(4):
        learner.set_learning_rate()
        expected = cosine_rate(step, 12, tiny_recommended.learning_rate)
        rest, operator = (group["lr"] for group in learner.optimizer.param_groups)
        assert rest == learner.learning_rate == expected
        assert operator == pytest.approx(0.1 * expected)
        learner.update(learner.losses_on_random_batch(source))
    assert learner.model.A_rows is learner.optimizer.param_groups[1]["params"][0]
    everything = sum(len(group["params"]) for group in learner.optimizer.param_groups)
    assert everything == len(list(learner.model.parameters()))


def test_a_rate_on_a_plateau_is_halved_for_every_parameter(tiny_config, toy_dataset, scaling):
    learner = a_learner(tiny_config.model_copy(update={"operator_rate": 0.2}), toy_dataset, scaling)
    learner.set_learning_rate()
    learner.halve_learning_rate()
    learner.halve_learning_rate()
    rates = [group["lr"] for group in learner.optimizer.param_groups]
    assert rates == pytest.approx([1e-3 / 4, 0.2e-3 / 4])


def test_the_first_roll_outs_are_as_short_as_the_horizon_is_then(
    tiny_recommended, toy_dataset, scaling
):
    """What happens behind the horizon is not seen: it may be anything."""
    config = tiny_recommended.model_copy(update={"horizon_start": 8, "windows": "slices"})
    learner = a_learner(config, toy_dataset, scaling)
    source = SliceSource(toy_dataset, scaling, config.history_steps)
    source._all.x[9:] = torch.nan
    assert torch.isfinite(learner.losses_on_random_batch(source).total)
    source._all.x[8:] = torch.nan
    assert not torch.isfinite(learner.losses_on_random_batch(source).total)
