"""Batches: scaling, instants, and which windows on which roads are drawn."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from offline.config import PAST_STEPS, PRESETS, STEPS
from offline.data import sampling as source_module
from offline.data.dataset import Dataset
from offline.data.recording import Starts, cut, possible_starts
from offline.data.sampling import (
    Batch,
    MirroringSource,
    NoisySource,
    SliceSource,
    WindowSource,
    open_source,
    rarity,
    scale,
)
from offline.data.signals import (
    STANDARD_DEVIATIONS,
    VEHICLE_ROLES,
    Scaling,
    Trajectories,
    fit_scaling,
    mirror_signs,
    past_names,
    signal_range,
)
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import VEHICLE, Signal

HISTORY, SHORT = 3, 12


def rng(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def a_config(windows: str, is_mirrored: bool):
    symmetry = "trained" if is_mirrored else "none"
    changes = {"windows": windows, "symmetry": symmetry, "noise": 0.0, "history_steps": HISTORY}
    return PRESETS["recommended"].model_copy(update=changes)


def columns(batch: Batch) -> list[Batch]:
    """The trajectories of a batch as a list."""
    return [Batch(*(series[:, i] for series in batch)) for i in range(batch.x.shape[1])]


def equal(one: Batch, other: Batch) -> bool:
    return all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.fixture
def cuts(monkeypatch):
    """The starts of every call of `cut`."""
    seen = []

    def listen(recording, starts, *rest, **options):
        seen.append(starts)
        return cut(recording, starts, *rest, **options)

    monkeypatch.setattr(source_module, "cut", listen)
    return seen


def only(part: str, dataset: Dataset) -> set[int]:
    return set(dataset.episodes(part).tolist())


def test_every_slice_of_the_training_part_is_drawn_and_no_other(toy_dataset, scaling):
    train = toy_dataset.select("train")
    stored = scale(train, scaling, VEHICLE, VEHICLE_ROLES, HISTORY)
    known = {each.x.numpy().tobytes(): each for each in columns(stored)}
    drawn = columns(SliceSource(toy_dataset, scaling, HISTORY).draw(1500, rng()))
    assert all(equal(each, known[each.x.numpy().tobytes()]) for each in drawn)
    assert {each.x.numpy().tobytes() for each in drawn} == set(known)


def test_windows_start_anywhere_in_the_training_episodes(toy_dataset, scaling, cuts):
    WindowSource(toy_dataset, scaling, HISTORY).draw(4000, rng())
    rows = cuts[0].row
    possible = possible_starts(toy_dataset.recording, toy_dataset.episodes("train"), HISTORY)
    assert np.isin(rows, possible).all()
    drives = np.searchsorted(toy_dataset.recording.first, rows, side="right") - 1
    assert set(drives.tolist()) == only("train", toy_dataset)
    into = rows - toy_dataset.recording.first[drives]
    assert into.min() == HISTORY
    assert len(set(into.tolist())) > 300


def test_a_drawn_window_equals_the_cut_at_its_start(toy_dataset, scaling, cuts):
    batch = WindowSource(toy_dataset, scaling, HISTORY).draw(7, rng())
    windows = cut(toy_dataset.recording, cuts[0], VEHICLE, VEHICLE_ROLES)
    assert equal(batch, scale(windows, scaling, VEHICLE, VEHICLE_ROLES, HISTORY))


def with_a_slide(dataset: Dataset) -> tuple[Dataset, int]:
    """The data with one row of extreme lateral velocity in the first training episode."""
    row = int(dataset.recording.first[dataset.episodes("train")[0]]) + 150
    x = dataset.recording.x.copy()
    x[row, 1] = 50.0 * np.abs(x[:, 1]).max()
    return replace(dataset, recording=dataset.recording._replace(x=x)), row


def test_rarity_is_that_of_the_window_ahead_and_of_no_other(toy_dataset, scaling):
    data, row = with_a_slide(toy_dataset)
    found, before = rarity(data, scaling), rarity(toy_dataset, scaling)
    assert set(np.flatnonzero(found != before)) == set(range(row - STEPS, row + 1))


def test_weighted_means_over_the_draws_are_means_over_all_windows(toy_dataset, scaling):
    data, _ = with_a_slide(toy_dataset)
    possible = possible_starts(data.recording, data.episodes("train"), HISTORY)
    vx = (data.recording.x[possible, 0] - scaling.x_centre[0]) / scaling.x_scale[0]
    truth = vx.mean()
    batch = WindowSource(data, scaling, HISTORY, 0.5).draw(20_000, rng())
    drawn, weight = batch.x[0, :, 0].numpy(), batch.weight[0, :, 0].numpy()
    assert weight.mean() == pytest.approx(1.0, abs=0.02)
    assert (drawn * weight).mean() == pytest.approx(truth, abs=0.04)
    assert abs(drawn.mean() - truth) > 0.1
    assert weight.max() <= 2.0 + 1e-6


def test_roads_have_a_curvature_of_the_library_and_errors_of_the_whole_range(
    toy_dataset, scaling, cuts
):
    WindowSource(toy_dataset, scaling, HISTORY).draw(3000, rng())
    roads, anchor = toy_dataset.manifest.roads, cuts[0].anchor
    assert set(anchor.curvature_per_m.tolist()) == set(roads.curvatures_per_m)
    for errors, bound in ((anchor.ey_m, roads.ey_m), (anchor.epsi_rad, roads.epsi_rad)):
        assert 0.99 * bound < errors.max() <= bound
        assert -bound <= errors.min() < -0.99 * bound
        assert abs(errors.mean()) < 0.1 * bound
    assert abs(np.corrcoef(anchor.ey_m, anchor.epsi_rad)[0, 1]) < 0.1


def test_episodes_without_any_window_are_refused(toy_dataset, scaling):
    few = toy_dataset.recording._replace(first=np.arange(0, len(toy_dataset.recording.x), 60))
    short = replace(toy_dataset, recording=few, part=np.zeros(len(few.first), dtype=np.int8))
    with pytest.raises(DatasetError, match="Record longer episodes"):
        WindowSource(short, scaling, HISTORY)


class Prepared:
    """A source that always returns the same trajectories."""

    def __init__(self, batch: Batch) -> None:
        self.batch = batch

    def draw(self, size: int, rng: torch.Generator) -> Batch:
        assert size == self.batch.x.shape[1]
        return self.batch


def signs_of(names: tuple[str, ...]) -> torch.Tensor:
    return torch.from_numpy(mirror_signs(names, VEHICLE_ROLES)).float()


def test_half_of_the_trajectories_are_mirrored_each_as_a_whole(toy_dataset, scaling):
    plain = SliceSource(toy_dataset, scaling, HISTORY).draw(400, rng())
    found = MirroringSource(Prepared(plain), toy_dataset).draw(400, rng(1))
    signs = [
        signs_of(names)
        for names in (
            VEHICLE.state_names,
            VEHICLE.input_names,
            VEHICLE.exogenous_names,
            VEHICLE_ROLES.past,
        )
    ]
    series = (each * sign for each, sign in zip(plain[:-1], signs, strict=True))
    in_mirror = Batch(*series, plain.weight)
    kinds = [
        (equal(one, original), equal(one, turned))
        for one, original, turned in zip(
            columns(found), columns(plain), columns(in_mirror), strict=True
        )
    ]
    assert set(kinds) == {(True, False), (False, True)}
    assert 150 < sum(is_mirrored for _, is_mirrored in kinds) < 250


def test_without_odd_signals_nothing_is_mirrored(toy_dataset, scaling):
    lopsided = replace(VEHICLE_ROLES, odd=None)
    data = replace(toy_dataset, manifest=replace(toy_dataset.manifest, roles=lopsided))
    opened = open_source(a_config("slices", is_mirrored=True), data, scaling)
    plain = SliceSource(toy_dataset, scaling, HISTORY)
    assert equal(opened.draw(64, rng()), plain.draw(64, rng()))


def test_noise_acts_on_the_first_state_and_the_past_alone(toy_dataset, scaling):
    source = WindowSource(toy_dataset, scaling, HISTORY)
    clean = source.draw(3000, rng())
    noisy = NoisySource(source, toy_dataset, scaling, 2.0).draw(3000, rng())
    assert torch.equal(noisy.x[1:], clean.x[1:])
    assert torch.equal(noisy.memory[HISTORY:], clean.memory[HISTORY:])
    assert torch.equal(noisy.u, clean.u)
    assert torch.equal(noisy.w, clean.w)
    at_start = (noisy.x - clean.x)[0].numpy() * scaling.x_scale
    before = (noisy.memory - clean.memory)[:HISTORY].numpy() * scaling.past_scale
    heard = past_names(VEHICLE, VEHICLE_ROLES)
    for name, deviation in STANDARD_DEVIATIONS.items():
        # uniform levels from 0 to 2: the mean square is 4 / 3 of that of level 1
        expected = pytest.approx(deviation * (4.0 / 3.0) ** 0.5, rel=0.06)
        assert at_start[:, VEHICLE.state_names.index(name)].std() == expected
        if name in heard:
            assert before[..., heard.index(name)].std() == expected
    assert not before[..., heard.index("steer_rad")].any()


@pytest.fixture(scope="module")
def starts(toy_dataset) -> Starts:
    """Starts in two episodes, right after their past."""
    return toy_dataset.slices.take(np.array([0, 35]))


def cut_later(dataset, starts: Starts, by: int, past_steps: int = PAST_STEPS) -> Trajectories:
    """Windows that begin `by` steps after the starts, with the anchors of the starts."""
    later = starts._replace(row=starts.row + by)
    return cut(dataset.recording, later, VEHICLE, VEHICLE_ROLES, SHORT, past_steps)


def show(trajectories: Trajectories, scaling: Scaling, past_steps: int = HISTORY) -> Batch:
    return scale(trajectories, scaling, VEHICLE, VEHICLE_ROLES, past_steps)


@pytest.mark.parametrize("t", [0, 1, HISTORY, SHORT])
def test_history_at_an_instant_equals_that_of_a_window_starting_there(
    toy_dataset, starts, scaling, t
):
    batch = show(cut_later(toy_dataset, starts, 0), scaling)
    begun_there = show(cut_later(toy_dataset, starts, t), scaling)
    found = batch.at(torch.tensor([t])).past[0]
    assert torch.equal(found, begun_there.at(torch.tensor([0])).past[0])
    assert torch.equal(found, begun_there.memory[:HISTORY].swapaxes(0, 1))


def fit(trajectories: Trajectories) -> Scaling:
    return fit_scaling(trajectories, VEHICLE, VEHICLE_ROLES)


@pytest.fixture(scope="module")
def train(toy_dataset) -> Trajectories:
    return toy_dataset.select("train")


def root_mean_square(rows: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(rows.reshape(-1, rows.shape[-1]).astype(float) ** 2, axis=0))


def test_scaled_training_data_have_unit_spread(train):
    scaling = fit(train)
    assert np.allclose(root_mean_square(scaling.normalise_states(train.x)), 1.0, rtol=1e-6)
    assert np.allclose(root_mean_square(train.u / scaling.u_scale), 1.0, rtol=1e-6)
    assert np.allclose(root_mean_square(train.w / scaling.w_scale), 1.0, rtol=1e-6)


def test_only_speed_and_progress_are_centred(train):
    scaling = fit(train)
    assert np.flatnonzero(scaling.x_centre).tolist() == [0, 3]
    assert scaling.x_centre[0] == pytest.approx(train.x[..., 0].mean(), rel=1e-5)


@pytest.fixture(scope="module")
def scaling(train) -> Scaling:
    return fit(train)


@pytest.mark.parametrize(
    ("windows", "objective", "is_weighted"),
    [("all", "horizon", True), ("all", "paper", False), ("slices", "horizon", False)],
)
def test_only_windows_for_the_horizon_objective_are_weighted(
    toy_dataset, scaling, windows, objective, is_weighted
):
    config = a_config(windows, True).model_copy(update={"objective": objective})
    weight = open_source(config, toy_dataset, scaling).draw(50, rng()).weight
    assert weight.shape == (1, 50, 1)
    assert (weight.std().item() > 0.01) == is_weighted
    assert is_weighted or torch.equal(weight, torch.ones(1, 50, 1))


def test_scales_are_not_below_a_share_of_the_peak_and_one_for_a_constant(train):
    x, u, w = 0.0 * train.x, 0.0 * train.u, 0.0 * train.w
    x[..., 0], x[0, 0, 1], u[0, 0, 1], w[0, 0, 0] = 20.0, 5.0, -120.0, 0.03
    scaling = fit(train._replace(x=x, u=u, w=w))
    assert (scaling.x_centre[0], scaling.x_scale[0]) == (20.0, 1.0)
    assert scaling.x_scale[1] == pytest.approx(0.5)
    assert scaling.u_scale.tolist() == pytest.approx([1.0, 40.0, 1.0])
    assert scaling.w_scale[0] == pytest.approx(0.01)


def test_the_range_of_other_inputs_is_found(train):
    other = replace(VEHICLE, inputs=(Signal("valve", "1"), *VEHICLE.inputs[1:]))
    lowest, highest = signal_range(train, other)
    assert lowest.tolist() == [*train.u.min(axis=(0, 1)), train.w.min()]
    assert highest.tolist() == [*train.u.max(axis=(0, 1)), train.w.max()]
    assert signal_range(train._replace(w=train.w[..., :0]), VEHICLE).shape == (2, 3)
