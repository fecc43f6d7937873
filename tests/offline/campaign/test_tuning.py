"""A search is repeatable alone, may be joined by many, and survives being stopped and killed."""

import json
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from offline import cli
from offline.backend import Backend
from offline.campaign.attempt import Attempt
from offline.campaign.claim import FILE as CLAIM_FILE
from offline.checkpoint import load_checkpoint
from offline.cli import train_app
from offline.config import TrainingConfig, resolve
from offline.tuning import Search, tune
from rt_controller.contract.errors import ConfigError

pytest.importorskip("optuna")

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

SPACES = """
[tiny]
why = "what a test has time for"
base = "recommended"
common = { steps = 12, batch = 8, evaluate_every = 3, latents = 4, history_steps = 3 }

[[tiny.parameter]]
field = "learning_rate"
low = 1e-4
high = 1e-1
scale = "log"

[[tiny.parameter]]
field = "hidden"
choices = [[4], [8], [8, 8]]

[[tiny.parameter]]
field = "bilinear_rank"
low = 0
high = 3

[wild]
why = "rates at which no number lasts"
base = "recommended"
common = { steps = 12, batch = 8, hidden = [4], latents = 4, gradient_clip = "none" }

[[wild.parameter]]
field = "learning_rate"
low = 1e29
high = 1e30
"""

HERE = Backend(jobs=1)
TRIALS = 8


@pytest.fixture(scope="session")
def spaces(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("spaces") / "spaces.toml"
    file.write_text(SPACES)
    return file


@pytest.fixture(scope="session", autouse=True)
def empty_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
        yield


@pytest.fixture(scope="session")
def ask(spaces):
    def search(trials=TRIALS, space="tiny", seed=0, common=None) -> Search:
        return Search(space, spaces, seed, trials, common)

    return search


@pytest.fixture(scope="module")
def alone(tmp_path_factory, ask, toy_folder) -> Path:
    """The study of one undisturbed process."""
    folder = tmp_path_factory.mktemp("alone")
    assert tune(ask(), folder, toy_folder, HERE, folder / "out.json") == 0
    return folder


def trials(folder: Path) -> list[optuna.trial.FrozenTrial]:
    storage = JournalStorage(JournalFileBackend(str(folder / "study.journal")))
    return optuna.load_study(study_name="study", storage=storage).get_trials()


def essence(folder: Path) -> list[tuple[object, ...]]:
    """Everything about the trials but when they ran."""
    return [(t.number, t.state, t.params, t.values, t.intermediate_values) for t in trials(folder)]


def test_the_best_trial_is_a_command_line_that_trains_it(alone):
    figures = json.loads((alone / "out.json").read_text())
    assert figures["n_trials"] == TRIALS
    assert figures["is_finished"] is True
    complete = [t for t in trials(alone) if t.state is optuna.trial.TrialState.COMPLETE]
    best = max(complete, key=lambda trial: trial.value)
    assert figures["best_trial"] == best.number
    assert figures["geometric_mean_ratio"] == best.value > 0
    _, *arguments = shlex.split(figures["command"])
    _, bound, _ = train_app.parse_args(arguments, exit_on_error=False)
    trained = load_checkpoint(
        alone / "trials" / f"{best.number:04d}" / "training" / "latest" / "best.pt"
    ).config
    said = resolve(bound.arguments["config"])
    of_the_data = {"episodes": trained.episodes, "data_seed": trained.data_seed}
    assert said.model_copy(update=of_the_data) == trained


def test_the_value_of_a_trial_is_the_one_of_its_training(alone):
    for trial in trials(alone):
        file = alone / "trials" / f"{trial.number:04d}" / "training" / "result.json"
        result = json.loads(file.read_text())
        if trial.state is optuna.trial.TrialState.COMPLETE:
            assert trial.value == result["score"]["geometric_mean"]
            assert list(trial.intermediate_values) == [1, 4, 7, 10, 12]
        else:
            assert trial.state is optuna.trial.TrialState.PRUNED
            assert result["ending"] == "pruned"


def test_a_trial_that_falls_behind_the_median_is_pruned(alone):
    pruned = [t for t in trials(alone) if t.state is optuna.trial.TrialState.PRUNED]
    assert pruned
    assert all(t.last_step < 12 for t in pruned)


def test_a_study_of_one_process_follows_from_its_seed(tmp_path, ask, toy_folder, alone):
    assert tune(ask(), tmp_path / "again", toy_folder, HERE, None) == 0
    assert essence(tmp_path / "again") == essence(alone)
    assert tune(ask(2, seed=1), tmp_path / "other", toy_folder, HERE, None) == 0
    assert trials(tmp_path / "other")[0].params != trials(alone)[0].params


def test_more_trials_go_on_where_fewer_ended(tmp_path, ask, toy_folder, alone):
    assert tune(ask(3), tmp_path, toy_folder, HERE, None) == 0
    assert essence(tmp_path) == essence(alone)[:3]
    assert tune(ask(), tmp_path, toy_folder, HERE, None) == 0
    assert essence(tmp_path) == essence(alone)


def test_a_stopped_study_goes_on_as_if_it_had_never_stopped(
    tmp_path, ask, toy_folder, alone, monkeypatch
):
    """Stopped in the middle of its second trial."""
    asked = []

    def should_stop(attempt):
        def ask_after_a_while() -> bool:
            asked.append(None)
            return len(asked) > 20

        return ask_after_a_while

    with monkeypatch.context() as patch:
        patch.setattr(Attempt, "should_stop", should_stop)
        patch.setattr(Attempt, "is_wanted", lambda attempt: len(asked) <= 20)
        assert tune(ask(), tmp_path, toy_folder, HERE, None) == 130
    states = [trial.state for trial in trials(tmp_path)]
    assert states == [optuna.trial.TrialState.COMPLETE, optuna.trial.TrialState.RUNNING]
    assert tune(ask(), tmp_path, toy_folder, HERE, None) == 0
    assert essence(tmp_path) == essence(alone)


def command(spaces: Path, toy_folder: Path, trials: int, *more: str) -> list[str]:
    script = "from offline.cli import tune_main; tune_main()"
    options = ["--spaces", str(spaces), "--data", str(toy_folder), "--folder", "study"]
    options += ["--trials", str(trials), "--jobs", "1", *more]
    return [sys.executable, "-c", script, "tiny", *options]


def test_a_killed_process_leaves_its_trial_to_the_next(tmp_path, spaces, toy_folder):
    """SIGKILL: nothing could be said or put away. The trial goes on at its checkpoint."""
    slow = ("--steps", "100000", "--evaluate-every", "10")
    killed = subprocess.Popen(command(spaces, toy_folder, 1, *slow), cwd=tmp_path)
    training = tmp_path / "study" / "trials" / "0000" / "training"
    last = training / "latest" / "last.pt"
    while killed.poll() is None and not last.exists():
        time.sleep(0.05)
    killed.kill()
    assert killed.wait() == -signal.SIGKILL
    reached = load_checkpoint(last).step

    second = subprocess.Popen(
        command(spaces, toy_folder, 1, *slow), cwd=tmp_path, stdout=subprocess.PIPE, text=True
    )
    while second.poll() is None and load_checkpoint(last).step <= reached:
        time.sleep(0.05)
    assert (training / CLAIM_FILE).read_text().startswith(f"{second.pid} on ")
    second.send_signal(signal.SIGINT)
    out, _ = second.communicate(timeout=120)
    assert second.returncode == 130
    assert "Run the same command again" in out
    (trial,) = trials(tmp_path / "study")
    assert trial.state is optuna.trial.TrialState.RUNNING
    assert list(trial.intermediate_values)[:2] == [1, 11]
    assert len(list(training.glob("*-recommended"))) == 1, "it began anew"


def test_two_processes_share_a_study_and_no_trial(tmp_path, spaces, toy_folder):
    both = [
        subprocess.Popen(command(spaces, toy_folder, 6, "--json", f"{i}.json"), cwd=tmp_path)
        for i in range(2)
    ]
    assert [process.wait(timeout=280) for process in both] == [0, 0]
    found = trials(tmp_path / "study")
    assert [trial.number for trial in found] == list(range(6))
    assert all(trial.state.is_finished() for trial in found)
    assert len({json.dumps(trial.params) for trial in found}) == 6, "the same dice in both"
    for trial in found:
        runs = (tmp_path / "study" / "trials" / f"{trial.number:04d}" / "training").glob("*-rec*")
        assert len(list(runs)) == 1


def test_workers_of_a_cluster_share_a_study(tmp_path, ask, toy_folder, cluster):
    backend = Backend("dask", cluster.address)
    assert tune(ask(4), tmp_path, toy_folder, backend, None) == 0
    assert len(trials(tmp_path)) == 4
    claims = tmp_path.glob(f"trials/*/{CLAIM_FILE}")
    pids = {int(claim.read_text().split()[0]) for claim in claims}
    assert pids <= {worker.pid for worker in cluster.workers}


def test_a_trial_that_diverges_counts_as_worthless(tmp_path, ask, toy_folder):
    assert tune(ask(1, space="wild"), tmp_path, toy_folder, HERE, None) == 0
    (trial,) = trials(tmp_path)
    assert trial.value == 0.0
    assert trial.user_attrs["ending"] == "diverged"


@pytest.mark.parametrize(
    ("more", "complaint"),
    [({"seed": 3}, "search_seed"), ({"common": TrainingConfig(steps=99)}, "base")],
)
def test_another_question_is_refused_in_the_same_folder(
    tmp_path, ask, toy_folder, alone, more, complaint
):
    with pytest.raises(ConfigError, match=rf"differs in {complaint}\. Choose another --folder"):
        tune(ask(**more), alone, toy_folder, HERE, None)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("methd",), "method, structure, paper-weights"),
        (("--trials", "0"), "--trials"),
        (("--learning-rate", "1e-3"), "found --learning-rate"),
        (("--preset", "paper"), "a space with another base in its place"),
        (("--address", "127.0.0.1:1"), "--backend dask or ray"),
    ],
)
def test_a_mistake_ends_with_its_remedy(
    tmp_path, monkeypatch, capsys, toy_folder, arguments, complaint
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["offline-tune", "--data", str(toy_folder), *arguments])
    with pytest.raises(SystemExit) as exit_info:
        cli.tune_main()
    assert exit_info.value.code == 2
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "runs").exists()


def test_a_missing_package_ends_with_the_line_that_installs_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "optuna", None)
    monkeypatch.setattr(sys, "argv", ["offline-tune"])
    with pytest.raises(SystemExit) as exit_info:
        cli.tune_main()
    assert exit_info.value.code == 3
    assert 'pip install -e ".[offline,tune]"' in " ".join(capsys.readouterr().err.split())
