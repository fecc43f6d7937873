"""A comparison of variants is repeatable, resumable, and loses nothing to a death."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from dask_cluster import dask_cluster

from offline import cli
from offline.ablation import Question, ablate, parse_seeds
from offline.backend import Backend
from offline.campaign import attempt as attempt_module
from offline.campaign.attempt import Attempt
from offline.campaign.claim import FILE as CLAIM_FILE
from offline.campaign.result import FILE as RESULT_FILE
from offline.campaign.trainings import Training, run_training
from offline.checkpoint import load_checkpoint
from offline.config import TrainingConfig
from rt_controller.contract.errors import ConfigError

LISTS = """
[tiny]
why = "what a test has time for"
base = "recommended"
common = { steps = 12, batch = 8, evaluate_every = 5, hidden = [8], latents = 4, history_steps = 3 }

[[tiny.variant]]
name = "whole"
why = "nothing left out"

[[tiny.variant]]
name = "without-bilinear"
why = "a constant B"
changes = { bilinear_rank = 0 }

[wild]
why = "one that cannot work, and one that can"
base = "recommended"
common = { steps = 12, batch = 8, evaluate_every = 5, hidden = [8], latents = 4 }

[[wild.variant]]
name = "too-fast"
why = "a rate at which no number lasts"
changes = { learning_rate = 1e30, gradient_clip = "none" }

[[wild.variant]]
name = "sane"
why = "as it should be"
"""

HERE = Backend(jobs=1)


@pytest.fixture(autouse=True)
def empty_cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture(scope="session")
def lists(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("lists") / "lists.toml"
    file.write_text(LISTS)
    return file


@pytest.fixture(scope="session")
def ask(lists):
    def question(name="tiny", seeds=(0,), only=(), common=None) -> Question:
        return Question(name, seeds, only, lists, common)

    return question


@pytest.fixture(scope="module")
def alone(tmp_path_factory, ask, toy_folder) -> Path:
    """The campaign of two variants and two seeds as one undisturbed process does it."""
    folder = tmp_path_factory.mktemp("alone")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
        assert ablate(ask(seeds=(0, 1)), folder, toy_folder, HERE, folder / "out.json") == 0
    return folder


def histories(folder: Path) -> dict[str, bytes]:
    found = folder.glob("*/seed-*/latest/history.jsonl")
    return {str(file.relative_to(folder)): file.read_bytes() for file in found}


def ratios(folder: Path) -> dict[tuple[str, int], dict[str, float]]:
    table = json.loads((folder / "table.json").read_text())
    return {
        (variant["name"], training["seed"]): training["mse_ratio"]
        for variant in table["variants"]
        for training in variant["trainings"]
    }


def test_the_table_has_every_training_and_what_its_seeds_have_in_common(alone, toy_dataset):
    figures = json.loads((alone / "out.json").read_text())
    assert figures == json.loads((alone / "table.json").read_text())
    assert figures["is_finished"] is True
    assert figures["data_sha256"] == toy_dataset.sha256
    assert set(figures["rival_mse_si"]) == set(toy_dataset.schema.state_names)
    assert [v["name"] for v in figures["variants"]] == ["whole", "without-bilinear"]
    for variant in figures["variants"]:
        assert [training["seed"] for training in variant["trainings"]] == [0, 1]
        means = [training["geometric_mean_ratio"] for training in variant["trainings"]]
        assert variant["geometric_mean_ratio"] == pytest.approx((means[0] * means[1]) ** 0.5)
        for training in variant["trainings"]:
            assert training["ending"] == "finished"
            assert training["training_cpu_s"] > 0
            assert training["spectral_radius"] <= 1.0005
            product = 1.0
            for ratio in training["mse_ratio"].values():
                product *= ratio
            assert training["geometric_mean_ratio"] == pytest.approx(product ** (1 / 6))
    text = (alone / "table.md").read_text()
    assert "| without-bilinear | `bilinear_rank = 0` |" in text
    assert "Every training has 12 steps of 8 trajectories." in text


def test_seeds_and_variants_train_different_models(alone):
    assert len(set(histories(alone).values())) == 4


def test_processes_write_the_same_histories_and_ratios(tmp_path, ask, toy_folder, alone):
    assert ablate(ask(seeds=(0, 1)), tmp_path, toy_folder, Backend(jobs=2), None) == 0
    assert histories(tmp_path) == histories(alone)
    assert ratios(tmp_path) == ratios(alone)


def test_threads_share_a_process_and_still_write_the_same_histories(
    tmp_path, ask, toy_folder, alone
):
    """torch has one set of dice a process: trainings in it wait for each other."""
    backend = Backend("threading", jobs=2)
    assert ablate(ask(seeds=(0, 1)), tmp_path, toy_folder, backend, None) == 0
    assert histories(tmp_path) == histories(alone)


def test_what_has_ended_is_not_done_again(tmp_path, ask, toy_folder):
    assert ablate(ask(), tmp_path, toy_folder, HERE, None) == 0
    before = {file: file.stat().st_mtime_ns for file in tmp_path.glob("*/seed-0/latest/*")}
    assert len(before) > 4
    assert ablate(ask(seeds=(0, 1)), tmp_path, toy_folder, HERE, None) == 0
    assert before == {file: file.stat().st_mtime_ns for file in before}
    assert len(ratios(tmp_path)) == 4


def test_a_stopped_training_goes_on_as_if_it_had_never_stopped(
    tmp_path, ask, toy_folder, alone, monkeypatch
):
    """Stopped after seven steps of twelve; the second command finds the checkpoint."""
    asked = []

    def should_stop(attempt):
        def ask_after_seven_steps() -> bool:
            asked.append(None)
            return len(asked) > 8

        return ask_after_seven_steps

    with monkeypatch.context() as patch:
        patch.setattr(Attempt, "should_stop", should_stop)
        assert ablate(ask(), tmp_path, toy_folder, HERE, None) == 130
    assert 0 < load_checkpoint(tmp_path / "whole" / "seed-0" / "latest" / "last.pt").step < 12
    assert json.loads((tmp_path / "table.json").read_text())["is_finished"] is False
    assert "| not ended |" in (tmp_path / "table.md").read_text()
    assert ablate(ask(), tmp_path, toy_folder, HERE, None) == 0
    undisturbed = {k: v for k, v in histories(alone).items() if "seed-0" in k}
    assert histories(tmp_path) == undisturbed


def test_a_killed_worker_costs_its_training_only_and_that_goes_on(tmp_path, ask, toy_folder):
    """Two real workers train one variant each; the first is killed between two checkpoints."""
    long = TrainingConfig(steps=100, evaluate_every=10)
    undisturbed, shot_at = tmp_path / "undisturbed", tmp_path / "shot-at"
    assert ablate(ask(common=long), undisturbed, toy_folder, HERE, None) == 0
    victim = shot_at / "whole" / "seed-0"
    killed: list[int] = []
    step_at_death: list[int] = []

    def kill_the_worker_of_the_first() -> None:
        while not (victim / "latest" / "last.pt").exists():
            time.sleep(0.01)
        killed.append(int((victim / CLAIM_FILE).read_text().split()[0]))
        os.kill(killed[0], signal.SIGKILL)
        step_at_death.append(load_checkpoint(victim / "latest" / "last.pt").step)

    killer = threading.Thread(target=kill_the_worker_of_the_first, daemon=True)
    killer.start()
    with dask_cluster(tmp_path) as cluster:
        backend = Backend("dask", cluster.address)
        assert ablate(ask(common=long), shot_at, toy_folder, backend, None) == 0
        survivors = [worker.pid for worker in cluster.workers if worker.poll() is None]
        assert {worker.pid for worker in cluster.workers} == {*survivors, killed[0]}
    assert 0 < step_at_death[0] < 100
    assert histories(shot_at) == histories(undisturbed)
    assert ratios(shot_at) == ratios(undisturbed)
    assert len(list(victim.glob("*-recommended"))) == 1, "it began anew"


def test_a_training_that_diverges_is_a_finding_and_no_end(tmp_path, ask, toy_folder):
    assert ablate(ask("wild"), tmp_path, toy_folder, HERE, None) == 0
    wild, sane = json.loads((tmp_path / "table.json").read_text())["variants"]
    assert wild["trainings"][0]["ending"] == "diverged"
    assert "--learning-rate" in wild["trainings"][0]["reason"]
    assert wild["geometric_mean_ratio"] is None
    assert sane["trainings"][0]["ending"] == "finished"


def test_a_folder_of_other_settings_is_refused_before_anything_is_trained(
    tmp_path, ask, toy_folder
):
    assert ablate(ask(only=("without-bilinear",)), tmp_path, toy_folder, HERE, None) == 0
    with pytest.raises(ConfigError, match=r"differs in steps\. Choose another --folder"):
        ablate(ask(common=TrainingConfig(steps=9)), tmp_path, toy_folder, HERE, None)
    assert not (tmp_path / "whole").exists()


def test_a_worker_that_does_not_see_the_folder_says_so(tmp_path):
    elsewhere = tmp_path / "not-mounted" / "attempts" / "token"
    training = Training(tmp_path / "t", TrainingConfig(), tmp_path, "", ())
    with pytest.raises(ConfigError, match="a folder that every worker sees"):
        run_training(training, Attempt(elsewhere), os.getpid())


def test_an_attempt_ends_with_its_context_and_with_a_signal(tmp_path):
    with attempt_module.attempt(tmp_path) as current:
        assert current.is_wanted()
    assert not current.is_wanted()
    with attempt_module.attempt(tmp_path) as current:
        os.kill(os.getpid(), signal.SIGTERM)
        while current.file.exists():
            time.sleep(0.01)
        assert current.should_stop()()


def test_two_commands_on_one_folder_share_the_work(tmp_path, lists, toy_folder, alone):
    script = "from offline.cli import ablate_main; ablate_main()"
    arguments = ["tiny", "--lists", str(lists), "--data", str(toy_folder), "--folder", "f"]
    command = [sys.executable, "-c", script, *arguments, "--seeds", "0,1", "--jobs", "1"]
    both = [subprocess.Popen(command, cwd=tmp_path) for _ in range(2)]
    assert [process.wait(timeout=280) for process in both] == [0, 0]
    assert histories(tmp_path / "f") == histories(alone)
    for training in (tmp_path / "f").glob("*/seed-*"):
        assert len(list(training.glob("*-recommended"))) == 1


@pytest.mark.parametrize("backend", ["loky", "dask"])
def test_ctrl_c_ends_a_comparison_of_several_processes_with_the_way_back(
    tmp_path, lists, toy_folder, backend
):
    """As a terminal does it: the signal goes to the command and to all its workers."""
    script = "from offline.cli import ablate_main; ablate_main()"
    arguments = ["tiny", "--lists", str(lists), "--data", str(toy_folder), "--folder", "f"]
    endless = ["--only", "whole", "--steps", "1000000", "--backend", backend, "--jobs", "2"]
    process = subprocess.Popen(
        [sys.executable, "-c", script, *arguments, *endless],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    checkpoint = tmp_path / "f" / "whole" / "seed-0" / "latest" / "last.pt"
    while process.poll() is None and not checkpoint.exists():
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    assert "Run the same command again" in out
    assert "Traceback" not in err
    assert not list((tmp_path / "f" / "attempts").iterdir())
    assert not list(tmp_path.glob(f"f/*/seed-0/{RESULT_FILE}"))


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
def test_a_mistake_ends_with_its_remedy(
    tmp_path, monkeypatch, capsys, toy_folder, arguments, complaint
):
    monkeypatch.chdir(tmp_path)
    command = ["offline-ablate", "--data", str(toy_folder), *arguments]
    monkeypatch.setattr(sys, "argv", command)
    with pytest.raises(SystemExit) as exit_info:
        cli.ablate_main()
    assert exit_info.value.code == 2
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "runs").exists()


def test_seeds_are_a_list_without_repetition():
    assert parse_seeds("2,0,2") == (2, 0)
