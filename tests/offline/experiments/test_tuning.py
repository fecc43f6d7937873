"""A study is repeatable; a trial that was interrupted is a failed one."""

import json
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from offline import cli
from offline.cli import train_app
from offline.commands.tuning import tune
from offline.config import TrainingConfig, resolve
from offline.experiments import training_task
from offline.experiments.backend import Backend
from offline.training.run import load_checkpoint
from rt_controller.contract.errors import ConfigError

optuna = pytest.importorskip("optuna")
COMPLETE, FAIL, PRUNED = (
    getattr(optuna.trial.TrialState, name) for name in ("COMPLETE", "FAIL", "PRUNED")
)

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
    ) -> None:
        tune(
            name,
            config=common,
            trials=n_trials,
            search_seed=seed,
            spaces=spaces,
            folder=folder,
            data=toy_folder,
            backend=backend,
            json_file=json_file,
        )

    return run


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, run_tune) -> Path:
    """The study of one process without interruption."""
    folder = tmp_path_factory.mktemp("undisturbed")
    run_tune(folder, json_file=folder / "out.json")
    return folder


def open_study(folder: Path) -> optuna.Study:
    backend = optuna.storages.journal.JournalFileBackend(str(folder / "study.journal"))
    storage = optuna.storages.JournalStorage(backend)
    return optuna.load_study(study_name="study", storage=storage)


def trials(folder: Path) -> list[optuna.trial.FrozenTrial]:
    return open_study(folder).get_trials()


def contents(folder: Path) -> list[tuple[object, ...]]:
    """Everything about the trials except their times."""
    return [(t.number, t.state, t.params, t.values, t.intermediate_values) for t in trials(folder)]


def runs(folder: Path) -> list[int]:
    """Number of runs that were started in the folder of each trial."""
    return [len(list(trial.glob("*-recommended"))) for trial in folder.glob("trials/*")]


def test_best_trial_is_printed_as_the_command_that_trains_it(undisturbed):
    figures = json.loads((undisturbed / "out.json").read_text())
    assert figures["n_trials"] == N_TRIALS
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
            assert trial.value == result["geometric_mean_ratio"]
            assert list(trial.intermediate_values) == [1, 4, 7, 10, 12]
        else:
            assert result["ending"] == "pruned"
            assert trial.last_step < 12


def test_study_of_another_seed_has_other_trials(tmp_path, run_tune, undisturbed):
    run_tune(tmp_path, 1, seed=1)
    assert trials(tmp_path)[0].params != trials(undisturbed)[0].params


def test_same_seed_gives_the_same_study_also_in_two_parts(tmp_path, run_tune, undisturbed):
    run_tune(tmp_path, 3)
    assert contents(tmp_path) == contents(undisturbed)[:3]
    run_tune(tmp_path)
    assert contents(tmp_path) == contents(undisturbed)


def test_interrupted_trial_is_a_failed_one_and_others_take_its_place(
    tmp_path, run_tune, monkeypatch
):
    """Ctrl-C in the second trial."""
    asked, train = [], training_task.train

    def interrupt_the_second(*arguments, **options):
        asked.append(None)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return train(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(training_task, "train", interrupt_the_second)
        with pytest.raises(KeyboardInterrupt):
            run_tune(tmp_path, 3)
    run_tune(tmp_path, 3)
    assert [t.state for t in trials(tmp_path)] == [COMPLETE, FAIL, COMPLETE, COMPLETE]


def test_trial_of_a_killed_process_is_a_failed_one(tmp_path, run_tune, undisturbed):
    shutil.copy(undisturbed / "study.journal", tmp_path)
    open_study(tmp_path).ask()
    run_tune(tmp_path)
    assert [t.state for t in trials(tmp_path)[N_TRIALS:]] == [FAIL]


def test_two_workers_run_every_trial_once(tmp_path, run_tune):
    """Two threads, each with a storage of its own, as two processes have."""
    run_tune(tmp_path, 4, backend=Backend("threading", jobs=2))
    found = trials(tmp_path)
    assert [trial.number for trial in found] == list(range(4))
    assert all(trial.state.is_finished() for trial in found)
    assert len({json.dumps(trial.params) for trial in found}) == 4, "the same random numbers"
    assert runs(tmp_path) == [1] * 4


def test_diverged_trial_has_the_value_zero(tmp_path, run_tune):
    run_tune(tmp_path, 1, name="wild")
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
