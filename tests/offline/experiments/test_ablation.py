"""A comparison of variants is repeatable; a finished training is not repeated."""

import json
import sys
from datetime import datetime
from pathlib import Path

import pytest
from tiny_comparison import compare, histories, runs

from offline import cli
from offline.commands.ablation import ablate, parse_seeds
from offline.experiments import training_task
from offline.experiments.backend import Backend
from offline.training.run import create_run
from rt_controller.contract.errors import ConfigError

EARLIER = datetime(2026, 1, 1)

OF_MOTION = ((3 + 3 * 6) * 8 + 8) + (8 * 2 + 2) + 6 * 2
"""speeds, yaw rate and three rows of history to two latents, products of every two of the three"""
OF_PATH = (7 * 64 + 64) + (64 * 64 + 64) + (64 + 1) + 28
"""the state and the curvature to one latent, products; the fourth latent is the constant"""
LINEAR = OF_MOTION + OF_PATH + 9 * 10 + 9 * 4
"""with A and B, without the row of the constant"""
EACH_GAIN = 9 + 10
"""a column of N and a row of S"""
DRIFT = 10
OF_INPUTS = (10 + 5) * 3 + 5
"""of the motion and of the path, and those of the curvature"""


@pytest.fixture(scope="session")
def run_ablate(lists, toy_folder, one_process):
    """Runs the command `offline-ablate` on the toy data set, in this process."""

    def run(folder: Path, name="tiny", seeds="0", json_file=None) -> None:
        ablate(
            name,
            seeds=seeds,
            lists=lists,
            folder=folder,
            data=toy_folder,
            backend=one_process,
            json_file=json_file,
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
        means = [training["geometric_mean_ratio"] for training in variant["trainings"]]
        assert variant["geometric_mean_ratio"] == pytest.approx((means[0] * means[1]) ** 0.5)
        for training in variant["trainings"]:
            assert training["ending"] == "finished"
            assert training["training_cpu_s"] > 0
            assert training["spectral_radius"] <= 1.05
    whole, without = LINEAR + EACH_GAIN * (DRIFT + OF_INPUTS), LINEAR + EACH_GAIN * DRIFT
    assert [v["n_parameters"] for v in figures["variants"]] == [whole, without]
    text = (undisturbed / "table.md").read_text()
    assert "| without-bilinear | `bilinear_rank = 0` |" in text
    assert "| a constant B | 12 | 8 |" in text


def test_each_seed_and_each_variant_trains_another_model(undisturbed):
    assert len(set(histories(undisturbed).values())) == 4


def test_threads_write_the_same_histories_as_one_process(tmp_path, lists, shared, undisturbed):
    compare(lists, shared, tmp_path, Backend("threading", jobs=2))
    assert histories(tmp_path) == histories(undisturbed)


def test_same_command_repeats_no_training_that_has_ended(
    tmp_path, run_ablate, undisturbed, monkeypatch
):
    """Ctrl-C in the second training."""
    asked, train = [], training_task.train

    def interrupt_the_second(*arguments, **options):
        asked.append(None)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return train(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(training_task, "train", interrupt_the_second)
        patch.setattr(training_task, "create_run", lambda *a: create_run(*a[:-1], EARLIER))
        with pytest.raises(KeyboardInterrupt):
            run_ablate(tmp_path)
    assert len(asked) == 2
    finished = {file: file.stat().st_mtime_ns for file in tmp_path.glob("whole/seed-0/latest/*")}

    run_ablate(tmp_path, seeds="0,1")
    assert len(finished) == 4
    assert finished == {file: file.stat().st_mtime_ns for file in finished}, "trained again"
    assert histories(tmp_path) == histories(undisturbed)
    assert sorted(runs(tmp_path)) == [1, 1, 1, 2]


def test_diverged_training_is_a_row_of_the_table(tmp_path, run_ablate):
    run_ablate(tmp_path, "wild")
    wild, sane = json.loads((tmp_path / "table.json").read_text())["variants"]
    assert wild["trainings"][0]["ending"] == "diverged"
    assert "--learning-rate" in wild["trainings"][0]["reason"]
    assert wild["geometric_mean_ratio"] is None
    assert sane["trainings"][0]["ending"] == "finished"


def test_folder_of_other_settings_is_refused_before_any_training(
    undisturbed, lists, shared, one_process
):
    before = histories(undisturbed)
    with pytest.raises(ConfigError, match=r"differs in steps\. Choose another --folder"):
        compare(lists, shared, undisturbed, one_process, seeds=(2, 0), steps=9)
    assert histories(undisturbed) == before


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("ladderr",), "ladder, leave-one-out"),
        (("--seeds", "one"), "--seeds"),
        (("--only", "papre"), "--only"),
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


def test_seeds_are_integers_each_once():
    assert parse_seeds("2,0,2") == [2, 0]
