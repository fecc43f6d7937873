"""The offline commands: output, files, signals and exit codes."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest
from fitted_network import fitted

from offline.commands import data, evaluate, export, import_logs, replay, terminal
from offline.commands import train as training
from offline.commands.terminal import stop_on_signals
from offline.config import TrainingConfig
from offline.data import dataset
from offline.data.dataset import load_dataset
from offline.data.manifest import Imported, SourceFile
from offline.training.run import load_checkpoint, open_run, save_checkpoint, training_lock
from offline.training.train import train
from rt_controller.bundle_checks.plan_check import require_stored_plans
from rt_controller.contract.revision import source_revision
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.artifact import load_bundle, save_bundle, shipped_model

SMALL = ("--hidden", "8", "--latents", "4", "--batch", "16", "--threads", "1")


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Runs a command in an empty folder, which must end with the exit code.

    Returns stdout after success, otherwise stderr.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def run(main, *arguments, code=0):
        monkeypatch.setattr(sys, "argv", ["offline", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_info:
            main()
        printed = capsys.readouterr()
        assert exit_info.value.code == code, printed.err
        return " ".join((printed.err if code else printed.out).split())

    return run


def test_the_figures_of_a_run_without_evaluation_are_valid_json(
    command, toy_folder, monkeypatch, tmp_path
):
    """Stopped before its first step, a run has an infinite best loss, which JSON cannot express."""
    monkeypatch.setattr(training, "stop_on_signals", lambda: nullcontext(lambda: True))
    train = ("--steps", 3, "--data", toy_folder, *SMALL, "--json", "train.json")
    command(training.main, *train, code=130)
    assert json.loads((tmp_path / "train.json").read_text())["best_validation_loss"] is None


def test_the_progress_ends_with_a_new_line_when_it_is_written_to_a_file(capfd):
    with terminal.progress_bar("training", 3) as show:
        show(3, "loss 0.5")
    assert capfd.readouterr().err.endswith("loss 0.5\n")


def test_a_varied_data_set_reports_what_was_drawn_and_is_found_again(command, tmp_path):
    varied = ("--recipe", "varied", "--episodes", 10, "--jobs", 1, "--data", "varied")
    out = command(data.main, *varied, "--json", "data.json")
    assert "friction 0.5 to 1" in out
    made = json.loads((tmp_path / "data.json").read_text())
    assert made["recipe"]["friction"] == [0.5, 1.0]
    command(data.main, *varied, "--json", "again.json")
    again = json.loads((tmp_path / "again.json").read_text())
    assert {**made, "wall_s": 0.0} == {**again, "wall_s": 0.0}

    assert "friction 0.6 to 0.9" in command(data.main, *varied, "--friction", 0.6, 0.9, code=2)
    assert "recipe nominal" in command(data.main, "--episodes", 10, "--data", "varied", code=2)


@pytest.mark.parametrize("package", ["torch", "onnx", "joblib"])
def test_a_missing_package_exits_3_with_its_install_command(command, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    err = command(training.main, code=3)
    assert package in err
    assert 'pip install -e ".[offline]"' in err


def test_the_options_of_the_commands_import_no_heavy_package():
    script = (
        "import sys, offline.entry; from importlib import import_module; "
        "[import_module(getattr(offline.entry, name).args[1]) "
        "for name in dir(offline.entry) if name.endswith('_main')]; "
        "print([m for m in ('torch', 'onnx', 'onnxruntime', 'numpy') if m in sys.modules])"
    )
    answer = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "[]"


def test_every_field_of_the_configuration_is_an_option(command):
    out = command(training.main, "--help-all")
    for name in TrainingConfig.model_fields:
        assert f"--{name.replace('_', '-')}" in out


def test_ctrl_c_ends_a_run_with_a_checkpoint_and_the_command_to_resume(toy_folder, tmp_path):
    script = "from offline.entry import train_main; train_main()"
    steps = ("--steps", "1000000", "--evaluate-every", "5")
    process = subprocess.Popen(
        [sys.executable, "-c", script, *steps, "--data", str(toy_folder), *SMALL],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    history = tmp_path / "runs" / "latest" / "history.jsonl"
    while process.poll() is None and not (history.exists() and history.stat().st_size):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "offline-train --resume" in out
    assert (tmp_path / "runs" / "latest" / "last.pt").exists()


pytestmark = pytest.mark.usefixtures("default_hang_up")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_requests_the_end_and_its_handler_is_put_back(number):
    before = signal.getsignal(number)
    requests = []
    with stop_on_signals(lambda: requests.append(number)) as is_requested:
        assert not is_requested()
        os.kill(os.getpid(), number)
        assert is_requested()
    assert requests == [number]
    assert signal.getsignal(number) is before


def test_a_hang_up_that_was_ignored_at_the_start_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_on_signals() as is_requested:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not is_requested()
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.fixture(scope="module")
def trained(tiny_config, toy_dataset, new_run):
    """The folder of a run to step 6, with a model as after a long training: it can be exported."""
    config = tiny_config.model_copy(update={"steps": 6, "episodes": 40, "data_seed": 3})
    run = new_run(config)
    train(config, toy_dataset, run)
    checkpoint = replace(load_checkpoint(run.best), validation_losses=[0.125, 0.5, 0.25])
    save_checkpoint(run.best, fitted(checkpoint, toy_dataset))
    return run.path.parent


@pytest.fixture
def run(trained, tmp_path):
    """The latest run in the folder of the command."""
    shutil.copytree(trained, tmp_path / "runs", symlinks=True)
    return tmp_path / "runs" / "latest"


def test_the_commands_make_data_train_export_and_evaluate(command, tmp_path):
    small = ("--largest-steer-deg", 40)  # a linear model of larger angles is not exported
    few = ("--episodes", 20, "--jobs", 1, *small, "--json", "data.json")
    out = command(data.main, *few)
    made = json.loads((tmp_path / "data.json").read_text())
    assert made["n_trajectories"] == 100
    assert str(tmp_path / "cache") in made["folder"]

    train = ("--steps", 30, "--evaluate-every", 10, "--episodes", 20, *small, *SMALL)
    out = command(training.main, *train, "--json", "train.json")
    assert "offline-export" in out
    assert json.loads((tmp_path / "train.json").read_text())["step"] == 30

    best = tmp_path / "runs" / "latest" / "best.pt"
    save_checkpoint(best, fitted(load_checkpoint(best), load_dataset(Path(made["folder"]))))
    out = command(export.main, "--json", "export.json")
    assert "rt-controller --bus virtual --model" in out
    exported = json.loads((tmp_path / "export.json").read_text())
    assert exported["size_bytes"] < 300_000
    assert exported["car"] == "simulated c_class_150kw_awd"
    assert "car: simulated c_class_150kw_awd" in out
    card = Path(exported["bundle"], "card.md").read_text(encoding="utf-8")
    assert "| car | simulated c_class_150kw_awd |" in card
    assert "| trial | holds the simulated car: ey_peak_m " in card
    assert exported["trial"]["ey_peak_m"] < 0.75
    assert exported["driven_radius"]["unsaturated"] <= 1.001
    assert exported["driven_radius"].keys() == exported["driven_growth_80"].keys()
    assert min(exported["persistence_mse_over_model_mse"].values()) > 1.0

    baselines = ("--baselines", "lti", "persistence")
    library = ("--sets", "library", *baselines, "--json", "table.json")
    command(evaluate.main, *library)
    table = json.loads((tmp_path / "table.json").read_text())
    assert table["parts"][0]["trajectories"] == 10
    rows = [row for row in table["rows"] if row["part"] == "library"]
    assert {"lti", "persistence"} < {row["model"] for row in rows}
    assert [row["unit"] for row in rows[:6]] == ["km/h", "km/h", "deg/s", "m", "m", "deg"]
    assert list(table["model_sha256"].values()) == [exported["model_sha256"]]
    assert table["revision"] == exported["revision"]
    command(export.main, "--baseline", "lti", "--output", "fitted")
    assert load_bundle(tmp_path / "fitted").plans is not None


def test_an_exported_model_is_not_evaluated_on_data_it_may_have_been_trained_on(
    command, run, toy_folder
):
    """Its card shows its validation loss, which need not be the lowest of the run."""
    err = command(evaluate.main, code=2)
    assert "runs/latest/bundle" in err
    assert "Make it with offline-export, or name models" in err
    err = command(export.main, code=2)
    assert "--model-trial off" in err  # the toy car is another than the simulated one
    assert not (run / "bundle").exists()
    command(export.main, "--model-trial", "off")
    assert "| validation loss | 0.25000 |" in (run / "bundle" / "card.md").read_text()
    assert load_bundle(run / "bundle").plans is not None
    library = ("--sets", "library", "--baselines", "none")
    command(evaluate.main, "--data", toy_folder, *library)
    few = ("--episodes", 10, "--seed", 3, "--jobs", 1, "--data", "few")
    command(data.main, *few)
    for main, options, words in (
        (evaluate.main, library, "10 episodes of seed 3"),
        (export.main, (), "trained on"),
        (training.main, ("--resume", "runs/latest"), "expected the data set"),
    ):
        err = command(main, "--data", "few", *options, code=2)
        assert words in err


def test_the_export_of_a_model_of_logs_says_that_its_car_is_another(
    command, run, monkeypatch, toy_dataset
):
    origin = Imported((SourceFile("log.csv", "ab" * 32),), "mapping", 40, seed=3)
    of_logs = replace(toy_dataset, manifest=replace(toy_dataset.manifest, origin=origin))
    monkeypatch.setattr(dataset, "load_dataset", lambda folder: of_logs)
    out = command(export.main, "--json", "export.json")
    figures = json.loads(Path("export.json").read_text())
    assert "not the simulated one: rt-controller --bus virtual drives another" in figures["car"]
    card = Path(figures["bundle"], "card.md").read_text(encoding="utf-8")
    assert f"car: {figures['car']}" in out
    assert f"| car | {figures['car']} |" in card


def test_a_run_is_resumed_with_its_data_and_refuses_another_configuration(command, toy_folder):
    train = ("--steps", 6, "--evaluate-every", 3, "--data", toy_folder, *SMALL)
    command(training.main, *train, "--rate-schedule", "plateau")
    config = json.loads(Path("runs/latest/config.json").read_text())["config"]
    assert (config["episodes"], config["data_seed"]) == (40, 3)
    with training_lock(open_run(Path("runs/latest"))):
        assert "a training is running" in command(export.main, code=2)
    resume = ("--resume", "runs/latest", "--steps", 9, "--json", "train.json")
    command(training.main, *resume)
    assert json.loads(Path("train.json").read_text())["step"] == 9
    assert "batch" in command(training.main, "--resume", "runs/latest", "--batch", 8, code=2)


TOY = "the folder of the toy data"
NO_DATA = ("--data", "typo", "--episodes", 10)
REFUSED = [
    (export.main, ("nowhere",), "offline-train"),
    (evaluate.main, ("--model", "nowhere"), "offline-export"),
    (evaluate.main, ("--model", "lti", "--sets", "holdout"), "--sets"),
    (evaluate.main, ("--model", "lti", "--baselines", "grue"), "--baselines.*grue"),
    (evaluate.main, ("--html", "."), "--html"),
    (evaluate.main, ("--html", "page.pdf"), r"page\.pdf: expected a file name that ends in \.html"),
    (evaluate.main, ("--html", "no/such/folder/page.html"), "--html"),
    (export.main, ("--json", "no/such/folder.json"), "--json"),
    (export.main, ("--output", "file/bundle"), "--output file/bundle"),
    (export.main, ("--baseline", "gru"), "--baseline gru"),
    (export.main, ("--name", "lti"), "--name.*'lti'"),
    (export.main, ("--name", "mdk-net"), "--name.*'mdk-net'"),
    (training.main, ("--preset", "papre"), "paper, paper-literal, quick"),
    (training.main, ("--resume", "nowhere"), "offline-train"),
    (training.main, ("--steps", 0, "--patience", -1), "--steps.*--patience"),
    (training.main, ("--data", TOY, "--data-seed", 4, "--steps", 3), "40 episodes of seed 3"),
    (training.main, ("--data", "typo", "--runs", "file/runs"), "--runs file/runs: expected"),
    # A misspelt name must not start minutes of simulation.
    (training.main, NO_DATA, "typo.*offline-data"),
    (data.main, ("--episodes", "3"), "--episodes"),
    (data.main, ("--data", "file/data"), "^offline-data: --data file/data"),
    (import_logs.main, ("map.toml", "a.csv", "--data", "file/data"), "--data file/data: expected"),
    (import_logs.main, ("map.toml", "file", "--json", "file"), "a file that this command reads"),
    (replay.main, ("map.toml", "file", "--json", "file"), "a file that this command reads"),
    (data.main, ("--episodes", 50, "--data", TOY), "40 episodes of seed 3"),
    (data.main, ("--friction", 0.0, 1.0, "--payload-kg", -1, 5), "--friction.*--payload-kg"),
    (data.main, ("--gust-mps", 3), "(?=.*--changing-share).*--gust-mps"),
    (data.main, ("--recipe", "variable"), "nominal.*varied"),
    (data.main, ("--jobs", 0), "--jobs"),
    (data.main, ("--jobs", -2), "--jobs"),
    (data.main, ("--address", "127.0.0.1:8786"), "--address"),
    (data.main, ("--largest-steer-deg", 20), "--largest-steer-deg"),
]


@pytest.mark.parametrize(("main", "arguments", "words"), REFUSED)
def test_a_usage_error_exits_2_with_its_remedy_and_no_figures(
    command, tmp_path, toy_folder, main, arguments, words
):
    (tmp_path / "file").touch()
    arguments = [toy_folder if argument == TOY else argument for argument in arguments]
    json_file = () if "--json" in arguments else ("--json", "figures.json")
    err = command(main, *arguments, *json_file, code=2)
    assert re.search(words, err)
    assert {path.name for path in tmp_path.iterdir()} <= {"file", "cache"}


def test_a_command_prints_the_version_of_the_distribution(command):
    shown = command(import_logs.main, "--version").partition(" ")
    assert shown[0] == version("rt-controller")
    assert shown[2] == f"({source_revision()})"


def test_interrupted_making_of_data_leaves_no_data_set(tmp_path):
    script = "from offline.entry import data_main; data_main()"
    options = ("--episodes", "20000", "--jobs", "1", "--data", "data")
    process = subprocess.Popen(
        [sys.executable, "-c", script, *options], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    try:
        assert "making a data set" in process.stderr.readline()
        while process.poll() is None:  # a shell may have told it to ignore the first one
            process.send_signal(signal.SIGINT)
            time.sleep(0.2)
        err = process.stderr.read()
    finally:
        process.kill()
    assert process.returncode == 130
    assert "Traceback" not in err
    assert not (tmp_path / "data" / "manifest.json").exists()


@pytest.fixture
def without_plans(tmp_path):
    """A bundle that was exported without stored plans."""
    lti = replace(load_bundle(shipped_model("lti")), plans=None)
    save_bundle(tmp_path / "old", lti, "# a card")
    return lti


def test_a_bundle_gets_plans_in_its_folder_and_stays_the_same_model(command, without_plans):
    command(export.main, "--bundle", "old", "--json", "figures.json")
    after = load_bundle(Path("old"))
    require_stored_plans(after)
    assert after.sha256 == without_plans.sha256
    assert Path("old", "card.md").read_text() == "# a card"
    assert json.loads(Path("figures.json").read_text())["plans"] == len(after.plans.inputs)

    other = replace(after, B_uc=1.5 * after.B_uc)
    save_bundle(Path("old"), other, "# a card")
    to_new = ("--bundle", "old", "--output", "new")
    err = command(export.main, *to_new, code=2)
    assert not Path("new").exists()
    assert "expected it to hold and to predict the simulated car" in err
    out = command(export.main, *to_new, "--model-trial", "off")
    assert "its own plans were replaced" in out
    require_stored_plans(load_bundle(Path("new")))

    save_bundle(Path("old"), replace(other, schema=replace(VEHICLE, dt_s=0.05)), "card")
    command(export.main, "--bundle", "old", code=2)
    for option in (("--baseline", "lti"), ("--data", "d"), ("runs/mine",)):
        command(export.main, *option, "--bundle", "old", code=2)


@pytest.mark.parametrize("name", ["lti", "mdk-net", "mdk-net-small", "mdk-net-paper"])
def test_the_shipped_models_have_stored_plans(name):
    """Without them: offline-export --bundle NAME."""
    assert load_bundle(shipped_model(name)).plans is not None
