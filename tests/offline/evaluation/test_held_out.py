"""No model is evaluated on episodes that it may have been trained on."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from offline.config import PAPER
from offline.data.dataset import cache, save_dataset, split_episodes
from offline.data.generate import generate
from offline.data.manifest import Imported, Simulated, describe_training, is_held_out
from offline.data.recipe import Recipe
from offline.data.recording import Recording
from offline.data.variation import VARIED
from offline.evaluation import held_out
from offline.evaluation.held_out import choose_test_data, find_objection
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import VEHICLE, Signal
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.lift import Lift
from sim_bridge.campaign import Backend

NO_RUN = "no/such/run"


def choose(bundles, data, run, notify=lambda text: None):
    return choose_test_data(bundles, data, run, notify)


@pytest.fixture
def save(monkeypatch, tmp_path, toy_dataset):
    """Saves data sets in an empty cache; the full one has 40 episodes of seed 3."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(held_out, "full_folder", lambda: cache() / "full")

    def save_as(name, episodes, seed=3, **changes):
        recording, slices = first_episodes(toy_dataset, episodes)
        manifest = replace(toy_dataset.manifest, **changes)
        return save_dataset(
            cache() / name,
            recording,
            slices,
            split_episodes(episodes, seed),
            schema=manifest.schema,
            roles=manifest.roles,
            roads=manifest.roads,
            origin=replace(toy_dataset.origin, episodes=episodes, seed=seed),
        )

    return save_as


def first_episodes(dataset, episodes):
    samples = int(dataset.recording.lengths[:episodes].sum())
    *arrays, first, _ = dataset.recording
    slices = dataset.slices.take(dataset.slices.episode < episodes)
    return Recording(*(array[:samples] for array in arrays), first[:episodes]), slices


def trained_on(dataset):
    """A bundle that was trained on this data set."""
    return replace(
        load_bundle(shipped_model("lti")),
        training=describe_training({}, dataset.origin),
        data_sha256=dataset.sha256,
    )


def test_data_sets_of_one_seed_begin_with_the_same_episodes():
    few, more = (
        generate(Recipe(), episodes, seed=5, backend=Backend(jobs=1)) for episodes in (2, 3)
    )
    assert np.array_equal(few.recording.x, more.recording.x[: len(few.recording.x)])


def test_a_model_is_not_evaluated_on_data_of_other_signals(save, tmp_path):
    states = (Signal("speed_mps", "m/s"), *VEHICLE.states[1:])
    other = save("other", 20, seed=4, schema=replace(VEHICLE, states=states))
    stranger = replace(trained_on(other), data_sha256="0" * 64)
    only = r"model only: vx_mps in m/s, in the data only: speed_mps in m/s\."
    with pytest.raises(DatasetError, match=f"other signals: in the {only}"):
        choose([stranger], cache() / "other", tmp_path / NO_RUN)
    full = save("full", 40, seed=5)
    assert choose([stranger], None, tmp_path / NO_RUN).sha256 == full.sha256


def test_a_model_is_not_evaluated_on_data_without_its_past(toy_dataset):
    manifest = toy_dataset.manifest
    fitting = Lift(False, 4, manifest.roles.past)
    long = replace(fitting, history_steps=21)
    other = replace(fitting, history_fields=("ey_m",))
    for lift, is_fine in ((fitting, True), (long, False), (other, False)):
        bundle = replace(trained_on(toy_dataset), lift=lift)
        objection = find_objection([bundle], manifest)
        assert (objection is None) is is_fine
        read = f"reads {lift.history_steps} periods of {', '.join(lift.history_fields)}, the data"
        assert is_fine or f"{read} have 20 of vx_mps, vy_mps" in str(objection)


def test_the_objection_to_another_period_or_order_of_the_signals_names_it(toy_dataset):
    model = trained_on(toy_dataset)
    slower = replace(model, schema=replace(VEHICLE, dt_s=0.05))
    assert "in the model only: a period of 0.05 s" in find_objection([slower], toy_dataset.manifest)
    turned = replace(model, schema=replace(VEHICLE, states=VEHICLE.states[::-1]))
    assert "in another order" in find_objection([turned], toy_dataset.manifest)


def test_a_model_of_logs_is_held_out_from_drives_and_not_from_other_logs(toy_dataset):
    manifest = toy_dataset.manifest
    logs = replace(manifest, sha256="logs", origin=Imported((), "", 3, 9))
    more_logs = replace(manifest, sha256="more", origin=Imported((), "", 5, 8))
    of_logs = replace(
        trained_on(toy_dataset), training=describe_training({}, logs.origin), data_sha256="logs"
    )
    assert is_held_out(of_logs, logs)
    assert is_held_out(of_logs, manifest)
    assert is_held_out(trained_on(toy_dataset), logs)
    assert not is_held_out(of_logs, more_logs)


@pytest.mark.parametrize("training", ["{}", "no JSON", "[]", json.dumps({"data_seed": None})])
def test_a_bundle_of_unknown_origin_is_evaluated_on_its_own_data_only(toy_dataset, training):
    unknown = replace(trained_on(toy_dataset), training=training)
    assert is_held_out(unknown, toy_dataset.manifest)
    assert not is_held_out(unknown, replace(toy_dataset.manifest, sha256="other"))


def test_the_learned_models_can_be_compared_on_the_test_part_of_the_full_data_set():
    """The episodes of every recipe are split alike, so none of them was trained with."""
    shipped = [load_bundle(shipped_model(name)) for name in ("mdk-net", "mdk-net-paper")]
    origin = Simulated(Recipe(), PAPER.episodes, PAPER.data_seed, "any car")
    manifest = SimpleNamespace(sha256="another recipe", origin=origin)
    assert all(is_held_out(bundle, manifest) for bundle in shipped)


def test_models_are_evaluated_on_data_held_out_from_all_of_them(save, tmp_path):
    full, small, other = save("full", 40), save("small", 20), save("other", 20, seed=4)
    of_full, of_small, of_other = (trained_on(each) for each in (full, small, other))
    said = []
    for models, expected in (
        ([of_full], full),
        ([of_other], full),
        ([of_other, of_full], full),
        ([of_small], small),
    ):
        found = choose(models, None, tmp_path / NO_RUN, said.append)
        assert found.sha256 == expected.sha256
    assert any("may have been trained on" in text for text in said)
    with pytest.raises(DatasetError, match="none of the models was trained on"):
        choose([of_full, of_small], None, tmp_path / NO_RUN)
    with pytest.raises(DatasetError, match="trained on its test episodes") as error:
        choose([of_full, of_small], cache() / "full", tmp_path / NO_RUN)
    assert "40 episodes of seed 3" in str(error.value)
    assert small.sha256[:16] in str(error.value)
    for file in (cache() / "small").iterdir():
        file.unlink()
    with pytest.raises(DatasetError, match="offline-data"):
        choose([of_small], None, tmp_path / NO_RUN)


@pytest.mark.parametrize("variation", [None, VARIED])
@pytest.mark.parametrize(
    ("sha256", "seed", "episodes", "expected"),
    [
        (None, 3, 40, True),
        ("other digits, from another processor", 3, 40, True),
        ("other", 4, 40, True),
        ("other", 4, 50, True),
        ("other", 3, 50, False),
    ],
)
def test_only_the_same_seed_with_another_length_is_not_held_out(
    toy_dataset, variation, sha256, seed, episodes, expected
):
    """Other conditions do not make episodes of the same seed held out."""
    manifest = toy_dataset.manifest
    recipe = replace(manifest.origin.recipe, variation=variation)
    origin = replace(manifest.origin, recipe=recipe, episodes=episodes, seed=seed)
    other = replace(manifest, sha256=sha256 or manifest.sha256, origin=origin)
    assert is_held_out(trained_on(toy_dataset), other) is expected
