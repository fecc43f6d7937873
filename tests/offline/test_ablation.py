"""The shipped lists have the configurations that they describe; a comparison is repeatable."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from fitted_network import fitted

from benchmarks.ablation import training as training_module
from benchmarks.ablation.__main__ import Row, app, figures_of, markdown_of
from benchmarks.ablation.training import (
    Result,
    SharedData,
    checkpoint_mse,
    mean_squared_errors,
    measure_linear_model,
)
from benchmarks.ablation.variants import BUDGET, SHIPPED_FILE, Training, Variant, read_variants
from offline.baselines.linear import fit_linear
from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import open_source
from offline.data.signals import fit_scaling
from offline.model.bundle_predictor import BundlePredictor
from offline.model.losses import total_loss
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.training.export import export_checkpoint
from offline.training.run import load_checkpoint
from offline.training.train import train
from rt_controller.contract.errors import ConfigError
from rt_controller.terminal.command_line import run_command

NOT_LEARNED = {"preset", "threads"}
"""fields without influence on the model"""
LISTS = ("ladder", "leave-one-out", "paper-readings")


@pytest.fixture(scope="module", autouse=True)
def empty_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def differences(one: TrainingConfig, other: TrainingConfig) -> set[str]:
    fields = set(TrainingConfig.model_fields) - NOT_LEARNED
    return {name for name in fields if getattr(one, name) != getattr(other, name)}


@pytest.mark.parametrize(
    ("name", "variant", "preset"),
    [
        ("ladder", "symmetric", "recommended"),
        ("leave-one-out", "recommended", "recommended"),
        ("leave-one-out", "without-bilinear", "linear"),
        ("paper-readings", "paper", "paper"),
        ("paper-readings", "paper-literal", "paper-literal"),
    ],
)
def test_variant_that_is_a_preset_equals_the_preset(name, variant, preset):
    (found,) = read_variants(name, SHIPPED_FILE, {}, [variant])[1]
    assert differences(found.config, PRESETS[preset]) == set()


@pytest.mark.parametrize("name", LISTS)
def test_variants_differ_in_exactly_their_changes_and_cost_the_same(name):
    variants = read_variants(name, SHIPPED_FILE, {})[1]
    first = variants[0]
    pairs = pairwise(variants) if name == "ladder" else ((first, each) for each in variants[1:])
    for below, above in pairs:
        assert above.variant.changes
        assert differences(below.config, above.config) == set(above.variant.changes)
        assert all(getattr(first.config, f) == getattr(above.config, f) for f in BUDGET[:2])


@pytest.mark.parametrize("name", LISTS)
def test_every_variant_can_be_trained(name, toy_dataset):
    """Each field may be valid and the combination still fit no network or loss."""
    few = {"batch": 4, "threads": 1}
    for variant in read_variants(name, SHIPPED_FILE, few)[1]:
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
    ladder = read_variants("ladder", SHIPPED_FILE, {"steps": 7})[1]
    assert {each.config.steps for each in ladder} == {7}
    ((_, alone),) = read_variants("linear", SHIPPED_FILE, {"steps": 7})[1]
    assert alone == PRESETS["linear"].model_copy(update={"steps": 7})


LIST = '[mine]\nwhy = "w"\nbase = "paper"\n'


def variant(name: str, changes: str = "") -> str:
    return f'[[mine.variant]]\nname = "{name}"\nwhy = "w"\nchanges = {{ {changes} }}\n'


def test_text_none_in_the_file_is_no_value(tmp_path):
    file = tmp_path / "lists.toml"
    file.write_text(LIST + variant("a", 'gradient_clip = "none"'))
    (found,) = read_variants("mine", file, {})[1]
    assert found.config.gradient_clip is None


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("", "mine"),
        ("mine = 3", "mine"),
        ("[mine", "lists.toml"),
        (LIST.replace("paper", "papre") + variant("a"), "papre"),
        (LIST, "mine.variant"),
        (LIST + variant("A b"), "A b"),
        (LIST + 2 * variant("a"), "a again"),
        (LIST + variant("a", "latnets = 3"), "variant a: latnets"),
        (LIST + variant("a", "latents = -3"), "variant a: latents"),
    ],
)
def test_mistake_in_the_file_is_reported(tmp_path, text, field):
    file = tmp_path / "lists.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=field):
        read_variants("mine", file, {})


WHOLE = Variant(name="whole", why="nothing left out")
LINEAR = Variant(name="linear", why="a constant B", changes={"mirror": False})
DATA = SharedData(Path("data"), "0" * 64, {"vx_mps": 2.0, "ey_m": 0.5})


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
    figures = figures_of("mine: a question", DATA, rows)
    whole, linear = figures["variants"]
    assert whole["geometric_mean_ratio"] == pytest.approx(8.0)
    assert whole["mse_ratio"] == pytest.approx({"vx_mps": 4.0, "ey_m": 16.0})
    assert linear["geometric_mean_ratio"] is None
    text = markdown_of(figures)
    for line in (
        "| whole | – | 8 | 4 | 16 | 4 | 16 | 1234 |",
        "| whole | 1 | finished | 8 | 32 | 16 | 0.5 | 8 | 30 |",
        "| linear | `mirror = false` | – | – | – | – | – | – |",
        "| linear | 0 | refused | – | – | – | 1.2 | 9 | 5 |",
        "| linear | 1 | diverged | – | – | – | – | 2 | 1 |",
    ):
        assert line in text


def test_fair_linear_model_is_at_least_as_good_as_least_squares(toy_folder, toy_dataset):
    shared = measure_linear_model(toy_folder, toy_dataset)
    plain = mean_squared_errors(fit_linear(toy_dataset), toy_dataset)
    assert list(shared.linear_mse) == list(toy_dataset.schema.state_names)
    assert np.all(np.array([*shared.linear_mse.values()]) <= plain * (1 + 1e-9))


def test_checkpoint_has_the_errors_of_the_bundle_that_is_exported_from_it(
    tiny_recommended, toy_dataset, new_run, monkeypatch
):
    monkeypatch.setattr(training_module, "CHUNK", 7)
    run = new_run(tiny_recommended)
    train(tiny_recommended, toy_dataset, run)
    checkpoint = fitted(load_checkpoint(run.best), toy_dataset)
    bundle, _ = export_checkpoint(checkpoint, toy_dataset)
    exported = mean_squared_errors(BundlePredictor(bundle), toy_dataset)
    assert checkpoint_mse(checkpoint, toy_dataset) == pytest.approx(exported, rel=1e-4)


SMALL = "steps = 12, batch = 8, evaluate_every = 5, hidden = [8], latents = 4"
TINY = f"""
[tiny]
why = "small enough for a test"
base = "recommended"
common = {{ {SMALL}, history_steps = 3, stability = "gelfand" }}
variant = [
  {{ name = "whole", why = "nothing left out" }},
  {{ name = "without-bilinear", why = "a constant B", changes = {{ bilinear_rank = 0 }} }},
]
[wild]
why = "it diverges"
base = "recommended"
common = {{ {SMALL}, learning_rate = 1e30, gradient_clip = "none" }}
variant = [{{ name = "too-fast", why = "a learning rate that diverges" }}]
"""


def histories(folder: Path) -> dict[str, bytes]:
    """History file of each training, by its path."""
    found = folder.glob("*/seed-*/latest/history.jsonl")
    return {str(file.relative_to(folder)): file.read_bytes() for file in found}


@pytest.fixture(scope="module")
def ablate(tmp_path_factory, toy_folder):
    """Runs the command on the toy data set, and gives its exit code."""
    lists = tmp_path_factory.mktemp("lists") / "lists.toml"
    lists.write_text(TINY)

    def run(*arguments: str) -> int:
        common = ("--lists", str(lists), "--data", str(toy_folder), "--jobs", "1")
        with pytest.raises(SystemExit) as ended:
            run_command(app, (*arguments, *common))
        return ended.value.code or 0

    return run


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, ablate) -> Path:
    """Two variants and two seeds, trained by one process without interruption."""
    folder = tmp_path_factory.mktemp("undisturbed")
    options = ("--folder", str(folder), "--json", str(folder / "out.json"))
    assert ablate("tiny", "--seeds", "0", "1", *options) == 0
    return folder


def test_table_has_every_training_and_the_pooled_seeds(undisturbed, toy_dataset):
    figures = json.loads((undisturbed / "out.json").read_text())
    assert figures["data_sha256"] == toy_dataset.sha256
    assert set(figures["baseline_mse_si"]) == set(toy_dataset.schema.state_names)
    assert [v["name"] for v in figures["variants"]] == ["whole", "without-bilinear"]
    for variant in figures["variants"]:
        assert [training["seed"] for training in variant["trainings"]] == [0, 1]
        for training in variant["trainings"]:
            assert training["ending"] == "finished"
            assert training["spectral_radius"] <= 1.05
    assert len(set(histories(undisturbed).values())) == 4


def test_seeds_may_be_added_and_no_training_is_repeated(tmp_path, ablate, undisturbed):
    folder = ("--folder", str(tmp_path))
    assert ablate("tiny", "--only", "whole", *folder) == 0
    (run,) = tmp_path.glob("whole/seed-0/latest")
    first = run.resolve()
    assert ablate("tiny", "--seeds", "0", "1", *folder) == 0
    assert run.resolve() == first
    assert histories(tmp_path) == histories(undisturbed)
    assert ablate("tiny", "--only", "whole", "--steps", "9", *folder) == 0
    assert run.resolve() != first, "another configuration is another training"


def test_diverged_training_is_a_row_of_the_table(tmp_path, ablate):
    file = tmp_path / "out.json"
    assert ablate("wild", "--folder", str(tmp_path), "--json", str(file)) == 0
    (wild,) = json.loads(file.read_text())["variants"]
    assert wild["trainings"][0]["ending"] == "diverged"
    assert "--learning-rate" in wild["trainings"][0]["reason"]
    assert wild["geometric_mean_ratio"] is None


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (("ladderr",), "ladderr"),
        (("tiny", "--seeds", "one"), "--seeds"),
        (("tiny", "--only", "papre"), "--only"),
        (("tiny", "--bilinear-rank", "2"), "--bilinear-rank"),
        (("tiny", "--seed", "3"), "--seed"),
        (("tiny", "--preset", "paper"), "--preset"),
        (("tiny", "--json", "/no-such-folder/figures.json"), "--json"),
    ],
)
def test_wrong_option_is_refused(tmp_path, monkeypatch, capsys, ablate, arguments, field):
    monkeypatch.chdir(tmp_path)
    assert ablate(*arguments) == 2
    assert field in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "runs").exists()
