"""The shipped spaces contain their presets; a study is repeatable."""

import json
import shlex
import sys
from pathlib import Path

import pytest

from offline import cli
from offline.cli import train_app
from offline.commands.tuning import tune
from offline.config import PRESETS, TrainingConfig, resolve
from offline.experiments import training_task
from offline.experiments.backend import Backend
from offline.experiments.settings import train_command
from offline.model.export_checks import DrivenStability
from offline.training.run import load_checkpoint
from rt_controller.contract.errors import ConfigError
from rt_controller.model.follow import Follow

optuna = pytest.importorskip("optuna")
read_space = pytest.importorskip("offline.experiments.tuning").read_space

COMPLETE, FAIL, PRUNED = (
    getattr(optuna.trial.TrialState, name) for name in ("COMPLETE", "FAIL", "PRUNED")
)

N_TRIALS = 8


@pytest.fixture(scope="session")
def run_tune(spaces, toy_folder):
    """Runs the command `offline-tune` on the toy data set."""

    def run(folder: Path, trials=N_TRIALS, name="tiny", **options) -> None:
        places = {"spaces": spaces, "folder": folder, "data": toy_folder}
        tune(name, trials=trials, **{"backend": Backend(jobs=1), **options}, **places)

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


def test_a_search_without_a_usable_trial_recommends_none(tmp_path, run_tune, monkeypatch, capsys):
    nothing = DrivenStability(radius=0.0, growth=0.0)
    monkeypatch.setattr(training_task, "limits_of", lambda config: nothing)
    run_tune(tmp_path, trials=1, json_file=tmp_path / "out.json")
    figures = json.loads((tmp_path / "out.json").read_text())
    assert (figures["best_trial"], figures["command"]) == (None, None)
    assert "Expected a trial with a model that can be exported" in capsys.readouterr().out


def test_trial_has_the_value_of_its_training_or_is_pruned_below_the_median(undisturbed):
    assert {trial.state for trial in trials(undisturbed)} == {COMPLETE, PRUNED}
    for trial in trials(undisturbed):
        if trial.state is PRUNED:
            assert trial.last_step < 12
            continue
        file = undisturbed / "trials" / f"{trial.number:04d}" / "result.json"
        assert trial.value == json.loads(file.read_text())["geometric_mean_ratio"]
        assert list(trial.intermediate_values) == [1, 4, 7, 10, 12]


def test_study_of_another_seed_has_other_trials(tmp_path, run_tune, undisturbed):
    run_tune(tmp_path, 1, search_seed=1)
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


def test_two_workers_run_every_trial_once(tmp_path, run_tune):
    """Two threads, each with a storage of its own, as two processes have."""
    run_tune(tmp_path, 4, backend=Backend("threading", jobs=2))
    found = trials(tmp_path)
    assert [trial.number for trial in found] == list(range(4))
    assert all(trial.state.is_finished() for trial in found)
    assert len({json.dumps(trial.params) for trial in found}) == 4, "the same random numbers"


def test_diverged_trial_has_the_value_zero(tmp_path, run_tune):
    run_tune(tmp_path, 1, name="wild")
    (trial,) = trials(tmp_path)
    assert trial.value == 0.0
    assert trial.user_attrs["ending"] == "diverged"


@pytest.mark.parametrize(
    ("more", "difference"),
    [({"search_seed": 3}, "search_seed"), ({"config": TrainingConfig(steps=99)}, "base")],
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


@pytest.mark.parametrize("name", ["method", "structure", "paper-weights"])
def test_shipped_space_contains_its_preset(name):
    """Otherwise a search could not find that the preset is the best already."""
    space, base = read_space(name, None, {})
    for parameter in space.parameter:
        value = getattr(base, parameter.field)
        if parameter.choices is not None:
            said = list(value) if isinstance(value, tuple) else value
            assert said in parameter.choices
        else:
            assert parameter.low <= value <= parameter.high


def test_range_between_integers_is_of_integers():
    space, _ = read_space("method", None, {})
    found = {parameter.field: parameter.distribution for parameter in space.parameter}
    assert found["horizon_start"] == optuna.distributions.IntDistribution(2, 80, log=True)
    assert found["horizon_growth"] == optuna.distributions.FloatDistribution(0.1, 0.9)


SPACE = '[mine]\nwhy = "w"\nbase = "recommended"\n[[mine.parameter]]\n'


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", r"expected one of .*which has none, found 'mine'"),
        ("[mine", "expected a TOML file"),
        ('[mine]\nwhy = "w"\nbase = "recommended"\n', r"mine\.parameter: expected a value"),
        (SPACE.replace("recomm", "rec") + 'field = "batch"\nlow = 1\nhigh = 2\n', "'recended'"),
        (SPACE + 'field = "batch"\n', "either low and high, or choices"),
        (SPACE + 'field = "batch"\nchoices = []\n', "one or more elements"),
        (SPACE + 'field = "batch"\nlow = 1\nhigh = 2\nchoices = [1]\n', "either low and high"),
        (SPACE + 'field = "batch"\nlow = 3\nhigh = 2\n', "low below high, found 3 and 2"),
        (
            SPACE + 'field = "decay_encoder"\nlow = 0.0\nhigh = 1.0\nscale = "log"\n',
            "low > 0",
        ),
        (SPACE + 'field = "btach"\nlow = 1\nhigh = 2\n', "btach: no such setting.*batch"),
        (SPACE + 'field = "batch"\nlow = -1\nhigh = 2\n', "batch: expected more than 0, found -1"),
        (
            SPACE + 'field = "windows"\nchoices = ["all", "some"]\n',
            "windows: expected .*found 'some'",
        ),
        (
            SPACE + 'field = "batch"\nlow = 1\nhigh = 2\n' + "[[mine.parameter]]\n"
            'field = "batch"\nlow = 1\nhigh = 3\n',
            "found batch again",
        ),
    ],
)
def test_mistake_in_the_file_is_reported(tmp_path, text, complaint):
    file = tmp_path / "spaces.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint):
        read_space("mine", file, {})


@pytest.mark.parametrize(
    ("preset", "changes"),
    [
        ("recommended", {}),
        ("recommended", {"hidden": (64, 32), "mirror": False, "gradient_clip": None}),
        ("paper", {"mirror": True, "learning_rate": 0.00123456789012345, "windows": "all"}),
        ("recommended", {"weight_regularisation": 1e-7, "horizon_start": None, "seed": 4}),
        ("recommended", {"bilinear_follows": Follow.FREE_RESPONSE}),
    ],
)
def test_command_line_of_a_configuration_gives_that_configuration(preset, changes):
    config = PRESETS[preset].model_copy(update=changes)
    program, *arguments = shlex.split(train_command(config, Path("/data/of mine")))
    assert program == "offline-train"
    _, bound, _ = train_app.parse_args(arguments, exit_on_error=False)
    assert resolve(bound.arguments.get("config")) == config
    assert bound.arguments["data"] == Path("/data/of mine")
