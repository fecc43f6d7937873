"""Batches of scaled trajectories, and the instants in them."""

import numpy as np
import pytest
import torch

from offline.config import PAST_STEPS
from offline.data.recording import Starts, cut
from offline.data.sampling import Batch, scale
from offline.data.signals import VEHICLE_ROLES, Scaling, Trajectories
from rt_controller.contract.signals import VEHICLE

STEPS, HISTORY = 12, 4


@pytest.fixture(scope="module")
def starts(toy_dataset) -> Starts:
    """Starts in two episodes, right after their past."""
    return toy_dataset.slices.take(np.array([0, 35]))


def cut_later(dataset, starts: Starts, by: int, past_steps: int = PAST_STEPS) -> Trajectories:
    """Windows that begin `by` steps after the starts, with the anchors of the starts."""
    later = starts._replace(row=starts.row + by)
    return cut(dataset.recording, later, VEHICLE, VEHICLE_ROLES, STEPS, past_steps)


def show(trajectories: Trajectories, scaling: Scaling, past_steps: int = HISTORY) -> Batch:
    return scale(trajectories, scaling, VEHICLE, VEHICLE_ROLES, past_steps)


def test_arrays_are_time_first_and_in_single_precision(toy_dataset, starts, scaling):
    batch = show(cut_later(toy_dataset, starts, 0), scaling)
    assert [tuple(series.shape) for series in batch] == [
        (STEPS + 1, 2, 6),
        (STEPS, 2, 3),
        (STEPS, 2, 1),
        (HISTORY + STEPS, 2, 6),
        (1, 2, 1),
    ]
    assert all(series.dtype == torch.float32 for series in batch)
    assert batch.steps == STEPS
    assert torch.equal(batch.weight, torch.ones(1, 2, 1))


def test_signals_are_centred_and_scaled(toy_dataset, starts, scaling):
    windows = cut_later(toy_dataset, starts, 0)
    batch = show(windows, scaling)
    x = batch.x.numpy().swapaxes(0, 1) * scaling.x_scale + scaling.x_centre
    np.testing.assert_allclose(x, windows.x, rtol=1e-5, atol=1e-6)
    u = batch.u.numpy().swapaxes(0, 1) * scaling.u_scale
    np.testing.assert_allclose(u, windows.u, rtol=1e-6)
    w = batch.w.numpy().swapaxes(0, 1) * scaling.w_scale
    np.testing.assert_allclose(w, windows.w, rtol=1e-6)


@pytest.mark.parametrize("t", [0, 1, HISTORY, STEPS])
def test_history_at_an_instant_equals_that_of_a_window_starting_there(
    toy_dataset, starts, scaling, t
):
    batch = show(cut_later(toy_dataset, starts, 0), scaling)
    begun_there = show(cut_later(toy_dataset, starts, t), scaling)
    found = batch.at(torch.tensor([t])).past[0]
    assert torch.equal(found, begun_there.at(torch.tensor([0])).past[0])
    assert torch.equal(found, begun_there.memory[:HISTORY].swapaxes(0, 1))


def test_history_is_the_last_rows_of_the_past_in_their_order(toy_dataset, starts, scaling):
    windows = cut_later(toy_dataset, starts, 0)
    past = show(windows, scaling).at(torch.tensor([0])).past[0].numpy()
    expected = (windows.past[:, -HISTORY:] - scaling.past_centre) / scaling.past_scale
    np.testing.assert_allclose(past, expected, rtol=1e-5, atol=1e-6)


def test_instants_have_the_order_of_the_given_times(toy_dataset, starts, scaling):
    batch = show(cut_later(toy_dataset, starts, 0), scaling)
    together = batch.at(torch.tensor([7, 0, 7, 3]))
    for i, t in enumerate((7, 0, 7, 3)):
        alone = batch.at(torch.tensor([t]))
        for one, other in zip(together, alone, strict=True):
            assert torch.equal(one[i], other[0])
        assert torch.equal(alone.x[0], batch.x[t])


def test_exogenous_signals_at_the_end_are_those_of_the_last_step(toy_dataset, starts, scaling):
    batch = show(cut_later(toy_dataset, starts, 0), scaling)
    batch.w[:] = torch.arange(STEPS)[:, None, None]
    w = batch.at(torch.tensor([0, STEPS - 1, STEPS])).w
    assert w[:, 0, 0].tolist() == [0, STEPS - 1, STEPS - 1]


@pytest.mark.parametrize("past_steps", [0, HISTORY])
def test_a_shortened_batch_equals_the_batch_of_shorter_windows(
    toy_dataset, starts, scaling, past_steps
):
    windows = cut_later(toy_dataset, starts, 0)
    shorter = cut(toy_dataset.recording, starts, VEHICLE, VEHICLE_ROLES, 5)
    found = show(windows, scaling, past_steps).shorten(5)
    for one, other in zip(found, show(shorter, scaling, past_steps), strict=True):
        assert torch.equal(one, other)


def test_without_past_steps_the_history_is_empty(toy_dataset, starts, scaling):
    batch = show(cut_later(toy_dataset, starts, 0), scaling, past_steps=0)
    assert batch.at(torch.tensor([0, STEPS])).past.shape == (2, 2, 0, 6)


def test_rows_of_the_past_beyond_the_history_are_ignored(toy_dataset, starts, scaling):
    just_enough = show(cut_later(toy_dataset, starts, 0, HISTORY), scaling)
    for one, other in zip(
        just_enough, show(cut_later(toy_dataset, starts, 0, PAST_STEPS), scaling), strict=True
    ):
        assert torch.equal(one, other)
