"""The shipped lists have the configurations that they describe; a comparison is repeatable."""

import json
import sys
import tomllib
from importlib import resources
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from fitted_network import fitted

from offline import cli
from offline.baselines.linear import fit_linear
from offline.commands.ablation import ablate
from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import open_source
from offline.data.signals import fit_scaling
from offline.experiments import training_task
from offline.experiments.backend import Backend
from offline.experiments.comparison import (
    BUDGET,
    SHIPPED,
    Row,
    Training,
    Variant,
    comparison_figures,
    comparison_markdown,
    read_variants,
)
from offline.experiments.training_task import (
    CampaignData,
    Result,
    checkpoint_mse,
    mean_squared_errors,
)
from offline.model.bundle_predictor import BundlePredictor
from offline.model.losses import total_loss
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.training.export import export_checkpoint
from offline.training.run import load_checkpoint
from offline.training.train import train
from rt_controller.contract.errors import ConfigError

NOT_LEARNED = {"preset", "threads"}
"""fields without influence on the model"""
LISTS = tuple(tomllib.loads((resources.files("offline.experiments") / SHIPPED).read_text("utf-8")))


def differences(one: TrainingConfig, other: TrainingConfig) -> set[str]:
    fields = set(TrainingConfig.model_fields) - NOT_LEARNED
    return {name for name in fields if getattr(one, name) != getattr(other, name)}


@pytest.mark.parametrize(
    ("name", "variant", "preset"),
    [
        ("ladder", "noise", "recommended"),
        ("leave-one-out", "recommended", "recommended"),
        ("leave-one-out", "without-bilinear", "linear"),
        ("sizes", "recommended", "recommended"),
        ("paper-readings", "paper", "paper"),
        ("paper-readings", "paper-literal", "paper-literal"),
    ],
)
def test_variant_that_is_a_preset_equals_the_preset(name, variant, preset):
    (found,) = read_variants(name, None, {}, [variant])[1]
    assert differences(found.config, PRESETS[preset]) == set()


def test_each_variant_of_the_ladder_makes_exactly_its_changes():
    for below, above in pairwise(read_variants("ladder", None, {})[1]):
        assert differences(below.config, above.config) == set(above.variant.changes)
        assert above.variant.changes


@pytest.mark.parametrize("name", LISTS)
def test_variants_of_a_list_differ_in_their_changes_and_cost_the_same(name):
    whole, *others = read_variants(name, None, {})[1]
    for each in others:
        if name != "ladder":
            assert differences(whole.config, each.config) == set(each.variant.changes)
        assert all(getattr(whole.config, f) == getattr(each.config, f) for f in BUDGET[:2])


@pytest.mark.parametrize("name", LISTS)
def test_every_variant_can_be_trained(name, toy_dataset):
    """Each field may be valid and the combination still fit no network or loss."""
    few = {"batch": 4, "threads": 1}
    for variant in read_variants(name, None, few)[1]:
        scaling = fit_scaling(toy_dataset.select("train"), toy_dataset.schema, toy_dataset.roles)
        source = open_source(variant.config, toy_dataset, scaling)
        sizes = sizes_of(toy_dataset.schema, toy_dataset.roles)
        torch.manual_seed(0)
        model = MdkNet(variant.config, sizes)
        losses = total_loss(model, variant.config, source.draw(4, torch.Generator()))
        losses.total.backward()
        gradients = [each.grad for each in model.parameters() if each.numel()]
        assert all(torch.isfinite(gradient).all() for gradient in gradients), variant.variant


def test_options_hold_for_all_variants_and_a_preset_is_a_list_of_one():
    assert {each.config.steps for each in read_variants("ladder", None, {"steps": 7})[1]} == {7}
    ((_, alone),) = read_variants("linear", None, {"steps": 7})[1]
    assert alone == PRESETS["linear"].model_copy(update={"steps": 7})


LIST = '[mine]\nwhy = "w"\nbase = "{base}"\n'
VARIANT = '[[mine.variant]]\nname = "{name}"\nwhy = "w"\nchanges = {{ {changes} }}\n'


def test_text_none_in_the_file_is_no_value(tmp_path):
    file = tmp_path / "lists.toml"
    file.write_text(
        LIST.format(base="paper") + VARIANT.format(name="a", changes='gradient_clip = "none"')
    )
    (variant,) = read_variants("mine", file, {})[1]
    assert variant.config.gradient_clip is None


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", r"expected one of the lists of the file, which has none, or .*found 'mine'"),
        ("mine = 3", "mine: expected a table"),
        ("[mine", "expected a TOML file"),
        (LIST.format(base="papre") + VARIANT.format(name="a", changes=""), "found 'papre'"),
        (LIST.format(base="paper"), r"mine\.variant: expected a value"),
        (LIST.format(base="paper") + VARIANT.format(name="A b", changes=""), "found 'A b'"),
        (LIST.format(base="paper") + 2 * VARIANT.format(name="a", changes=""), "found a again"),
        (
            LIST.format(base="paper") + VARIANT.format(name="a", changes="latnets = 3"),
            "variant a: latnets: no such setting.*latents",
        ),
        (
            LIST.format(base="paper") + VARIANT.format(name="a", changes="latents = -3"),
            "variant a: latents: expected more than 0, found -3",
        ),
    ],
)
def test_mistake_in_the_file_is_reported(tmp_path, text, complaint):
    file = tmp_path / "lists.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint):
        read_variants("mine", file, {})


WHOLE = Variant(name="whole", why="nothing left out")
LINEAR = Variant(name="linear", why="a constant B", changes={"mirror": False})
DATA = CampaignData(Path("data"), "0" * 64, {"vx_mps": 2.0, "ey_m": 0.5})


def row(variant: Variant, seed: int, *result: object) -> Row:
    return Row(Training(variant, TrainingConfig(steps=9, batch=3, seed=seed)), Result(*result))


def test_seeds_are_pooled_by_geometric_means_and_one_without_a_model_is_only_a_row():
    first, second = {"vx_mps": 2.0, "ey_m": 8.0}, {"vx_mps": 8.0, "ey_m": 32.0}
    rows = [
        row(WHOLE, 0, "finished", 8, 10.0, "", first, 4.0, 0.5, 1234),
        row(WHOLE, 1, "finished", 8, 30.0, "", second, 16.0, 0.5, 1234),
        row(LINEAR, 0, "refused", 9, 5.0, "it grows", None, None, 1.2, 1111),
        row(LINEAR, 1, "diverged", 2, 1.0, "not finite"),
    ]
    figures = comparison_figures("mine: a question", DATA, rows)
    whole, linear = figures["variants"]
    assert whole["geometric_mean_ratio"] == pytest.approx(8.0)
    assert whole["mse_ratio"] == pytest.approx({"vx_mps": 4.0, "ey_m": 16.0})
    assert linear["geometric_mean_ratio"] is None
    text = comparison_markdown(figures)
    for line in (
        "| whole | 8 | 4 | 16 | 4 | 16 | 1234 | 20 |",
        "| whole | 1 | finished | 8 | 32 | 16 | 0.5 | 8 | 30 |",
        "| whole | – | nothing left out | 9 | 3 |",
        "| linear | – | – | – | – | – | – | – |",
        "| linear | `mirror = false` | a constant B | 9 | 3 |",
        "| linear | 0 | refused | – | – | – | 1.2 | 9 | 5 |",
        "| linear | 1 | diverged | – | – | – | – | 2 | 1 |",
    ):
        assert line in text


class ShiftedTruth:
    """Predicts the true states plus a constant in each state."""

    def __init__(self, dataset, shift):
        self.truth, self.shift = dataset.select("validation").x.astype(np.float64), shift

    def predict(self, x0, past, U, W):
        assert len(x0) == len(self.truth)
        return self.truth + self.shift


def test_errors_are_mean_squares_and_infinite_where_a_prediction_is_not_finite(toy_dataset):
    model = ShiftedTruth(toy_dataset, np.array([np.nan, 2.0, np.inf, 0.0, 3.0, 0.1]))
    expected = [np.inf, 4.0, np.inf, 0.0, 9.0, 0.01]
    assert mean_squared_errors(model, toy_dataset) == pytest.approx(expected, abs=1e-12)


def test_fair_linear_model_is_at_least_as_good_as_least_squares(shared, toy_dataset):
    plain = mean_squared_errors(fit_linear(toy_dataset), toy_dataset)
    assert list(shared.linear_mse) == list(toy_dataset.schema.state_names)
    assert np.all(np.array([*shared.linear_mse.values()]) <= plain * (1 + 1e-9))


def test_checkpoint_has_the_errors_of_the_bundle_that_is_exported_from_it(
    tiny_recommended, toy_dataset, new_run, monkeypatch
):
    monkeypatch.setattr(training_task, "CHUNK", 7)
    run = new_run(tiny_recommended)
    train(tiny_recommended, toy_dataset, run)
    checkpoint = fitted(load_checkpoint(run.best), toy_dataset)
    bundle, _ = export_checkpoint(checkpoint, toy_dataset)
    exported = mean_squared_errors(BundlePredictor(bundle), toy_dataset)
    assert checkpoint_mse(checkpoint, toy_dataset) == pytest.approx(exported, rel=1e-4)


def histories(folder: Path) -> dict[str, bytes]:
    """History file of each training, by its path."""
    found = folder.glob("*/seed-*/latest/history.jsonl")
    return {str(file.relative_to(folder)): file.read_bytes() for file in found}


@pytest.fixture(scope="session")
def run_ablate(lists, toy_folder, one_process):
    """Runs the command `offline-ablate` on the toy data set, in this process."""

    def run(folder: Path, name="tiny", **options) -> None:
        ablate(
            name, **{"backend": one_process, **options}, lists=lists, folder=folder, data=toy_folder
        )

    return run


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, run_ablate) -> Path:
    """Two variants and two seeds, trained by one process without interruption."""
    folder = tmp_path_factory.mktemp("undisturbed")
    run_ablate(folder, seeds="0,1", json_file=folder / "out.json")
    return folder


def test_table_has_every_training_and_the_pooled_seeds(undisturbed, toy_dataset):
    figures = json.loads((undisturbed / "out.json").read_text())
    assert figures == json.loads((undisturbed / "table.json").read_text())
    assert figures["data_sha256"] == toy_dataset.sha256
    assert set(figures["baseline_mse_si"]) == set(toy_dataset.schema.state_names)
    assert [v["name"] for v in figures["variants"]] == ["whole", "without-bilinear"]
    for variant in figures["variants"]:
        assert [training["seed"] for training in variant["trainings"]] == [0, 1]
        for training in variant["trainings"]:
            assert training["ending"] == "finished"
            assert training["spectral_radius"] <= 1.05
    assert len(set(histories(undisturbed).values())) == 4


def test_threads_write_the_same_histories_as_one_process(tmp_path, run_ablate, undisturbed):
    run_ablate(tmp_path, seeds="0,1", backend=Backend("threading", jobs=2))
    assert histories(tmp_path) == histories(undisturbed)


def test_same_command_repeats_no_training_that_has_ended(
    tmp_path, run_ablate, undisturbed, monkeypatch
):
    """Ctrl-C in the second training."""
    asked = []

    def interrupt_the_second(*arguments, **options):
        asked.append(None)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return train(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(training_task, "train", interrupt_the_second)
        with pytest.raises(KeyboardInterrupt):
            run_ablate(tmp_path)
    finished = {file: file.stat().st_mtime_ns for file in tmp_path.glob("whole/seed-0/latest/*")}
    run_ablate(tmp_path, seeds="0,1")
    assert len(finished) == 4
    assert finished == {file: file.stat().st_mtime_ns for file in finished}, "trained again"
    assert histories(tmp_path) == histories(undisturbed)


def test_diverged_training_is_a_row_of_the_table(tmp_path, run_ablate):
    run_ablate(tmp_path, "wild")
    wild, sane = json.loads((tmp_path / "table.json").read_text())["variants"]
    assert wild["trainings"][0]["ending"] == "diverged"
    assert "--learning-rate" in wild["trainings"][0]["reason"]
    assert wild["geometric_mean_ratio"] is None
    assert sane["trainings"][0]["ending"] == "finished"


def test_folder_of_other_settings_is_refused_before_any_training(undisturbed, run_ablate):
    before = histories(undisturbed)
    with pytest.raises(ConfigError, match=r"differs in steps\. Choose another --folder"):
        run_ablate(undisturbed, seeds="2,0", config=TrainingConfig(steps=9))
    assert histories(undisturbed) == before


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("ladderr",), "ladder, leave-one-out"),
        (("--seeds", "one"), "--seeds"),
        (("--only", "papre"), "names among paper"),
        (("--history-steps", "2"), "expected no option"),
        (("--seed", "3"), "--seeds in its place"),
        (("--preset", "paper"), "the name of the list in its place"),
        (("--address", "127.0.0.1:1"), "--backend dask or ray"),
        (("--lists", "nowhere.toml"), "nowhere.toml"),
    ],
)
def test_wrong_option_is_refused_with_its_remedy(
    tmp_path, monkeypatch, capsys, toy_folder, arguments, complaint
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["offline-ablate", "--data", str(toy_folder), *arguments])
    with pytest.raises(SystemExit) as exit_info:
        cli.ablate_main()
    assert exit_info.value.code == 2
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "runs").exists()
