"""A study is repeatable, may be joined by several processes, and survives a stop and a kill."""

import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from worker_tasks import DIE_FILE, deadly_command

from offline import cli
from offline.cli import train_app
from offline.commands.tuning import tune
from offline.config import TrainingConfig, resolve
from offline.experiments import tuning
from offline.experiments.backend import Backend
from offline.experiments.running_command import RunningCommand
from offline.training.checkpoint import load_checkpoint
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import write_figures

optuna = pytest.importorskip("optuna")
COMPLETE, PRUNED = optuna.trial.TrialState.COMPLETE, optuna.trial.TrialState.PRUNED

N_TRIALS = 8


@pytest.fixture(scope="session")
def run_tune(spaces, toy_folder):
    """Runs the command `offline-tune` on the toy data set."""

    def run(
        folder: Path,
        n_trials=N_TRIALS,
        name="tiny",
        seed=0,
        common=None,
        backend=Backend(jobs=1),  # noqa: B008
        json_file=None,
    ) -> int:
        figures, exit_code = tune(name, spaces, seed, n_trials, common, folder, toy_folder, backend)
        write_figures(json_file, figures)
        return exit_code

    return run


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, run_tune) -> Path:
    """The study of one process without interruption."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert run_tune(folder, json_file=folder / "out.json") == 0
    return folder


def trials(folder: Path) -> list[optuna.trial.FrozenTrial]:
    backend = optuna.storages.journal.JournalFileBackend(str(folder / "study.journal"))
    storage = optuna.storages.JournalStorage(backend)
    return optuna.load_study(study_name="study", storage=storage).get_trials()


def contents(folder: Path) -> list[tuple[object, ...]]:
    """Everything about the trials except their times."""
    return [(t.number, t.state, t.params, t.values, t.intermediate_values) for t in trials(folder)]


def runs(folder: Path) -> list[int]:
    """Number of runs that were started in the folder of each trial."""
    return [len(list(trial.glob("*-recommended"))) for trial in folder.glob("trials/*")]


def test_best_trial_is_printed_as_the_command_that_trains_it(undisturbed):
    figures = json.loads((undisturbed / "out.json").read_text())
    assert figures["n_trials"] == N_TRIALS
    assert figures["is_finished"] is True
    best = max((t for t in trials(undisturbed) if t.state is COMPLETE), key=lambda t: t.value)
    assert figures["best_trial"] == best.number
    assert figures["geometric_mean_ratio"] == best.value > 0
    _, *arguments = shlex.split(figures["command"])
    _, bound, _ = train_app.parse_args(arguments, exit_on_error=False)
    best_file = undisturbed / "trials" / f"{best.number:04d}" / "latest" / "best.pt"
    trained = load_checkpoint(best_file).config
    of_the_data = {"episodes": trained.episodes, "data_seed": trained.data_seed}
    assert resolve(bound.arguments["config"]).model_copy(update=of_the_data) == trained


def test_trial_has_the_value_of_its_training_or_is_pruned_below_the_median(undisturbed):
    assert {trial.state for trial in trials(undisturbed)} == {COMPLETE, PRUNED}
    for trial in trials(undisturbed):
        file = undisturbed / "trials" / f"{trial.number:04d}" / "result.json"
        result = json.loads(file.read_text())
        if trial.state is COMPLETE:
            assert trial.value == result["ratios"]["geometric_mean"]
            assert list(trial.intermediate_values) == [1, 4, 7, 10, 12]
        else:
            assert result["ending"] == "pruned"
            assert trial.last_step < 12


def test_study_of_another_seed_has_other_trials(tmp_path, run_tune, undisturbed):
    assert run_tune(tmp_path, 1, seed=1) == 0
    assert trials(tmp_path)[0].params != trials(undisturbed)[0].params


def test_same_seed_gives_the_same_study_also_in_two_parts(tmp_path, run_tune, undisturbed):
    assert run_tune(tmp_path, 3) == 0
    assert contents(tmp_path) == contents(undisturbed)[:3]
    assert run_tune(tmp_path) == 0
    assert contents(tmp_path) == contents(undisturbed)


def test_interrupted_study_continues_to_the_same_result(
    tmp_path, run_tune, undisturbed, monkeypatch, capfd
):
    """Ctrl-C in the middle of the second trial."""
    asked = []
    is_stopped = RunningCommand.is_stopped

    def interrupt_later(command: RunningCommand) -> bool:
        asked.append(None)
        if len(asked) == 20:
            os.kill(os.getpid(), signal.SIGINT)
        return is_stopped(command)

    with monkeypatch.context() as patch:
        patch.setattr(RunningCommand, "is_stopped", interrupt_later)
        assert run_tune(tmp_path, 3) == 130
    assert "Run the same command again" in capfd.readouterr().out
    assert [t.state for t in trials(tmp_path)] == [COMPLETE, optuna.trial.TrialState.RUNNING]
    assert run_tune(tmp_path, 3) == 0
    assert contents(tmp_path) == contents(undisturbed)[:3]
    assert set(runs(tmp_path)) == {1}


def test_study_that_is_joined_by_another_worker_repeats_no_trial(tmp_path, run_tune):
    """Two threads, each with a storage of its own, as two processes have."""
    assert run_tune(tmp_path, 4, backend=Backend("threading", jobs=2)) == 0
    found = trials(tmp_path)
    assert [trial.number for trial in found] == list(range(4))
    assert all(trial.state.is_finished() for trial in found)
    assert len({json.dumps(trial.params) for trial in found}) == 4, "the same random numbers"
    assert runs(tmp_path) == [1] * 4


TUNE = "from offline.cli import tune_main; tune_main()"


@pytest.mark.nightly
def test_two_commands_share_a_study_and_no_trial(tmp_path, spaces, toy_folder):
    options = ["--spaces", str(spaces), "--data", str(toy_folder), "--folder", "study"]
    command = [sys.executable, "-c", TUNE, "tiny", *options, "--trials", "6", "--jobs", "1"]
    both = [subprocess.Popen(command, cwd=tmp_path) for _ in range(2)]
    assert [process.wait(timeout=280) for process in both] == [0, 0]
    found = trials(tmp_path / "study")
    assert [trial.number for trial in found] == list(range(6))
    assert all(trial.state.is_finished() for trial in found)
    assert runs(tmp_path / "study") == [1] * 6


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["loky", "dask"])
def test_trial_of_a_killed_worker_is_continued_by_another(tmp_path, run_tune, monkeypatch, name):
    monkeypatch.setattr(tuning, "running_command", deadly_command)
    assert run_tune(tmp_path, 4, backend=Backend(name, jobs=2)) == 0
    assert not (tmp_path / DIE_FILE).exists(), "no worker was killed"
    found = trials(tmp_path)
    assert [trial.number for trial in found] == list(range(4))
    assert all(trial.state.is_finished() for trial in found)
    assert runs(tmp_path) == [1] * 4


def test_diverged_trial_has_the_value_zero(tmp_path, run_tune):
    assert run_tune(tmp_path, 1, name="wild") == 0
    (trial,) = trials(tmp_path)
    assert trial.value == 0.0
    assert trial.user_attrs["ending"] == "diverged"


@pytest.mark.parametrize(
    ("more", "difference"),
    [({"seed": 3}, "search_seed"), ({"common": TrainingConfig(steps=99)}, "base")],
)
def test_folder_of_another_question_is_refused(run_tune, undisturbed, more, difference):
    with pytest.raises(ConfigError, match=rf"differs in {difference}\. Choose another --folder"):
        run_tune(undisturbed, **more)


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
def test_wrong_option_is_refused_with_its_remedy(
    tmp_path, monkeypatch, capsys, toy_folder, arguments, complaint
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["offline-tune", "--data", str(toy_folder), *arguments])
    with pytest.raises(SystemExit) as exit_info:
        cli.tune_main()
    assert exit_info.value.code == 2
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "runs").exists()


def test_missing_optuna_is_an_error_with_the_line_that_installs_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "optuna", None)
    monkeypatch.setattr(sys, "argv", ["offline-tune"])
    with pytest.raises(SystemExit) as exit_info:
        cli.tune_main()
    assert exit_info.value.code == 3
    assert "[offline,tune]" in " ".join(capsys.readouterr().err.split())
