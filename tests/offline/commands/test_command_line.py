"""The offline commands: output, files and exit codes."""

import json
import os
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

from offline import cli
from offline.commands import bundle, terminal, training_run
from offline.config import TrainingConfig
from offline.data.dataset import load_dataset
from offline.data.manifest import Imported, SourceFile
from offline.training.run import load_checkpoint, save_checkpoint
from rt_controller.model.artifact import load_bundle

ENTRY_POINTS = (
    cli.data_main,
    cli.import_main,
    cli.train_main,
    cli.export_main,
    cli.evaluate_main,
    cli.report_main,
    cli.replay_main,
    cli.ablate_main,
    cli.tune_main,
)
SMALL = ("--hidden", "8", "--latents", "4", "--batch", "16", "--threads", "1")


def make_exportable(data: Path | str) -> None:
    """Give the latest run a model that is better than persistence, as a long training would."""
    best = Path("runs", "latest", "best.pt")
    save_checkpoint(best, fitted(load_checkpoint(best), load_dataset(Path(data))))


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Run a command in an empty folder; return exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def run(main, *arguments):
        monkeypatch.setattr(sys, "argv", ["offline", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_info:
            main()
        printed = capsys.readouterr()
        return exit_info.value.code, " ".join(printed.out.split()), " ".join(printed.err.split())

    return run


def test_the_commands_make_data_train_export_and_evaluate(command, tmp_path):
    code, out, _ = command(cli.data_main, "--episodes", 20, "--jobs", 1, "--json", "data.json")
    assert code in (0, None)
    data = json.loads((tmp_path / "data.json").read_text())
    assert data["n_trajectories"] == 100
    assert str(tmp_path / "cache") in data["folder"]

    train = ("--steps", 30, "--evaluate-every", 10, "--episodes", 20, *SMALL)
    code, out, _ = command(cli.train_main, *train, "--json", "train.json")
    assert code in (0, None)
    assert "offline-export" in out
    assert json.loads((tmp_path / "train.json").read_text())["step"] == 30

    make_exportable(data["folder"])
    code, out, _ = command(cli.export_main, "--json", "export.json")
    assert code in (0, None)
    assert "rt-controller --bus virtual --model" in out
    exported = json.loads((tmp_path / "export.json").read_text())
    assert exported["size_bytes"] < 300_000
    assert exported["car"] == "simulated c_class_150kw_awd"
    assert "car: simulated c_class_150kw_awd" in out
    card = Path(exported["bundle"], "card.md").read_text(encoding="utf-8")
    assert "| car | simulated c_class_150kw_awd |" in card
    assert exported["driven_radius"]["unsaturated"] <= 1.001
    assert exported["driven_radius"].keys() == exported["driven_growth_80"].keys()
    assert min(exported["persistence_mse_over_model_mse"].values()) > 1.0

    code, out, _ = command(cli.evaluate_main, "--sets", "library", "--json", "table.json")
    assert code in (0, None)
    table = json.loads((tmp_path / "table.json").read_text())
    library = table["sets"]["library"]
    assert library["n_trajectories"] == 10
    assert {"lti", "lti-per-curvature", "persistence"} < set(library["models"])
    for model in library["models"].values():
        assert len(model["mse"]) == 6
        assert "yaw_rate_degps_squared" in model["mse"]
    assert list(table["model_sha256"].values()) == [exported["model_sha256"]]
    assert table["revision"] == exported["revision"]

    code, out, _ = command(cli.export_main, "--baseline", "lti", "--output", "fitted")
    assert code in (0, None)
    few = ("--sets", "library", "--baselines", "none")
    code, out, _ = command(cli.evaluate_main, "--model", "fitted", *few)
    assert code in (0, None)


def test_the_export_of_a_model_of_logs_says_that_its_car_is_another(
    command, monkeypatch, toy_folder, toy_dataset
):
    train = ("--steps", 6, "--evaluate-every", 3, "--data", toy_folder, *SMALL)
    assert command(cli.train_main, *train)[0] in (0, None)
    make_exportable(toy_folder)
    origin = Imported((SourceFile("log.csv", "ab" * 32),), "mapping", 40, seed=3)
    of_logs = replace(toy_dataset, manifest=replace(toy_dataset.manifest, origin=origin))
    monkeypatch.setattr(bundle, "load_dataset", lambda folder: of_logs)
    code, out, _ = command(cli.export_main, "--json", "export.json")
    assert code in (0, None)
    figures = json.loads(Path("export.json").read_text())
    assert "not the simulated one: rt-controller --bus virtual drives another" in figures["car"]
    card = Path(figures["bundle"], "card.md").read_text(encoding="utf-8")
    assert f"car: {figures['car']}" in out
    assert f"| car | {figures['car']} |" in card


def test_a_run_is_resumed_and_refuses_another_configuration(command, toy_folder):
    train = ("--steps", 6, "--evaluate-every", 3, "--data", toy_folder, "--runs", "r", *SMALL)
    assert command(cli.train_main, *train, "--rate-schedule", "plateau")[0] in (0, None)
    resume = ("--resume", "r/latest", "--steps", 9, "--json", "train.json")
    code, _, _ = command(cli.train_main, *resume)
    assert code in (0, None)
    with open("train.json", encoding="utf-8") as file:
        assert json.load(file)["step"] == 9
    code, _, err = command(cli.train_main, "--resume", "r/latest", "--batch", 8)
    assert code == 2
    assert "batch" in err


def test_an_unwritable_folder_is_found_before_the_work(command, toy_folder, tmp_path):
    (tmp_path / "file").touch()
    train = ("--steps", 3, "--data", toy_folder, "--runs", "file/runs", *SMALL)
    code, _, err = command(cli.train_main, *train)
    assert code == 2
    assert "--runs" in err


def test_the_figures_of_a_run_without_evaluation_are_valid_json(
    command, toy_folder, monkeypatch, tmp_path
):
    """Stopped before its first step, a run has an infinite best loss, which JSON cannot express."""
    monkeypatch.setattr(training_run, "stop_on_signals", lambda: nullcontext(lambda: True))
    train = ("--steps", 3, "--data", toy_folder, *SMALL, "--json", "train.json")
    assert command(cli.train_main, *train)[0] == 130
    assert json.loads((tmp_path / "train.json").read_text())["best_validation_loss"] is None


def test_the_card_shows_the_validation_loss_of_the_exported_model(command, toy_folder, tmp_path):
    """It need not be the lowest of the run."""
    train = ("--steps", 3, "--evaluate-every", 3, "--data", toy_folder, *SMALL)
    assert command(cli.train_main, *train)[0] in (0, None)
    make_exportable(toy_folder)
    best = tmp_path / "runs" / "latest" / "best.pt"
    save_checkpoint(best, replace(load_checkpoint(best), validation_losses=[0.125, 0.5, 0.25]))
    assert command(cli.export_main)[0] in (0, None)
    folder = tmp_path / "runs" / "latest" / "bundle"
    assert "| validation loss | 0.25000 |" in (folder / "card.md").read_text()
    assert load_bundle(folder).plans is not None


def test_the_configuration_takes_episodes_and_seed_from_the_given_data_set(
    command, toy_folder, tmp_path
):
    train = ("--steps", 3, "--evaluate-every", 3, "--data", toy_folder, *SMALL)
    assert command(cli.train_main, *train)[0] in (0, None)
    config = json.loads((tmp_path / "runs" / "latest" / "config.json").read_text())["config"]
    assert (config["episodes"], config["data_seed"]) == (40, 3)
    code, _, err = command(cli.train_main, *train, "--data-seed", 4)
    assert code == 2
    assert "40 episodes of seed 3" in err


def test_a_model_is_not_evaluated_on_data_it_may_have_been_trained_on(
    command, toy_folder, tmp_path
):
    train = ("--steps", 3, "--evaluate-every", 3, "--data", toy_folder, *SMALL)
    assert command(cli.train_main, *train)[0] in (0, None)
    make_exportable(toy_folder)
    assert command(cli.export_main)[0] in (0, None)
    library = ("--sets", "library", "--baselines", "none")
    code, _, _ = command(cli.evaluate_main, "--data", toy_folder, *library)
    assert code in (0, None)
    few = ("--episodes", 10, "--seed", 3, "--jobs", 1, "--data", "few")
    assert command(cli.data_main, *few)[0] in (0, None)
    code, _, err = command(cli.evaluate_main, "--data", "few", *library)
    assert code == 2
    assert "10 episodes of seed 3" in err
    code, _, err = command(cli.export_main, "--data", "few")
    assert code == 2
    assert "trained on" in err


def test_a_run_refuses_to_resume_with_another_data_set(command, toy_folder):
    train = ("--steps", 3, "--evaluate-every", 3, "--data", toy_folder, *SMALL)
    assert command(cli.train_main, *train)[0] in (0, None)
    other = ("--episodes", 10, "--jobs", 1, "--data", "other")
    assert command(cli.data_main, *other)[0] in (0, None)
    code, _, err = command(cli.train_main, "--resume", "runs/latest", "--data", "other")
    assert code == 2
    assert "expected the data set" in err


def test_a_model_that_is_worse_than_persistence_is_not_exported(command, toy_folder, tmp_path):
    train = ("--steps", 3, "--evaluate-every", 3, "--data", toy_folder, *SMALL)
    assert command(cli.train_main, *train)[0] in (0, None)
    make_exportable(toy_folder)
    best = tmp_path / "runs" / "latest" / "best.pt"
    crabbing = load_checkpoint(best)
    crabbing.model["B_rows"][4, 2] += 1.0  # the steering moves the car sideways at once
    save_checkpoint(best, crabbing)
    code, _, err = command(cli.export_main, "--json", "export.json")
    assert code == 2
    assert "better than the last measured state" in err
    assert "ey_m (mean squared error" in err
    assert not (tmp_path / "export.json").exists()
    assert not (tmp_path / "runs" / "latest" / "bundle").exists()


def test_an_evaluation_without_a_bundle_says_where_it_looked_and_what_makes_one(command, tmp_path):
    (tmp_path / "runs" / "latest").mkdir(parents=True)
    code, _, err = command(cli.evaluate_main)
    assert code == 2
    assert "runs/latest/bundle" in err
    assert "Make it with offline-export, or name models" in err


def test_the_progress_ends_with_a_new_line_when_it_is_written_to_a_file(capfd):
    with terminal.progress_bar("training", 3) as show:
        show(3, "loss 0.5")
    assert capfd.readouterr().err.endswith("loss 0.5\n")


@pytest.mark.parametrize(
    ("main", "arguments", "complaint"),
    [
        (cli.export_main, ("nowhere",), "offline-train"),
        (cli.evaluate_main, ("--model", "nowhere"), "offline-export"),
        (cli.evaluate_main, ("--model", "lti", "--noise", "1", "0"), "--noise"),
        (cli.evaluate_main, ("--model", "lti", "--sets", "holdout"), "--sets"),
        (cli.train_main, ("--preset", "papre"), "paper, paper-literal, quick"),
        (cli.train_main, ("--resume", "nowhere"), "offline-train"),
        (cli.data_main, ("--episodes", "3"), "--episodes"),
        (cli.data_main, ("--data", "file/data", "--episodes", "10", "--jobs", "1"), "--data"),
    ],
)
def test_a_usage_error_exits_2_with_its_remedy_and_no_figures(
    command, tmp_path, main, arguments, complaint
):
    (tmp_path / "file").touch()
    code, _, err = command(main, *arguments, "--json", "figures.json")
    assert code == 2
    assert complaint in err
    assert not (tmp_path / "figures.json").exists()


def test_figures_in_a_missing_folder_are_refused(command):
    code, _, err = command(cli.data_main, "--json", "no/such/folder.json")
    assert code == 2
    assert "--json" in err


def test_a_varied_data_set_reports_what_was_drawn_and_is_found_again(command, tmp_path):
    varied = ("--recipe", "varied", "--episodes", 10, "--jobs", 1, "--data", "varied")
    code, out, _ = command(cli.data_main, *varied, "--json", "data.json")
    assert code in (0, None)
    assert "friction 0.5 to 1" in out
    assert "cg_ahead_m" in out
    made = json.loads((tmp_path / "data.json").read_text())
    assert made["recipe"]["friction"] == [0.5, 1.0]
    assert set(made["conditions"]["bank_rad"]) == {"minimum", "mean", "maximum"}
    assert command(cli.data_main, *varied, "--json", "again.json")[0] in (0, None)
    again = json.loads((tmp_path / "again.json").read_text())
    assert {**made, "wall_s": 0.0} == {**again, "wall_s": 0.0}

    code, _, err = command(cli.data_main, *varied, "--friction", 0.6, 0.9)
    assert code == 2
    assert "friction 0.6 to 0.9" in err
    code, _, err = command(cli.data_main, "--episodes", 10, "--data", "varied")
    assert code == 2
    assert "recipe nominal" in err


@pytest.mark.parametrize(
    ("options", "complaints"),
    [
        (("--friction", 0.0, 1.0, "--payload-kg", -1, 5), ("--friction", "--payload-kg")),
        (("--bank-rad", 0.1, -0.1), ("--bank-rad: expected the lower end first",)),
        (("--gust-mps", 3), ("--changing-share", "--gust-mps")),
        (("--recipe", "variable"), ("nominal", "varied")),
        (("--largest-steer-deg", 20), ("--largest-steer-deg: expected 40 to 180",)),
        (("--recipe", "varied", "--nominal-share", 0.9), ("--nominal-share", "at most 1")),
    ],
)
def test_ranges_that_do_not_fit_are_refused_by_their_options(command, options, complaints):
    code, _, err = command(cli.data_main, "--data", "data", *options)
    assert code == 2
    for complaint in complaints:
        assert complaint in err


@pytest.mark.parametrize(
    ("main", "arguments"),
    [(cli.train_main, ()), (cli.ablate_main, ("recommended",)), (cli.tune_main, ())],
)
def test_a_named_data_set_that_does_not_exist_is_refused(command, tmp_path, main, arguments):
    """A misspelt name must not start minutes of simulation."""
    code, _, err = command(main, *arguments, "--data", "typo", "--episodes", 10)
    assert code == 2
    assert "typo" in err
    assert "offline-data" in err
    assert not (tmp_path / "typo").exists()


def test_interrupted_making_of_data_leaves_no_data_set(tmp_path):
    script = "from offline.entry import data_main; data_main()"
    process = subprocess.Popen(
        [sys.executable, "-c", script, "--episodes", "20000", "--jobs", "1", "--data", "data"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert "making a data set" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert (out, "Traceback" in err) == ("", False)
    assert not (tmp_path / "data" / "manifest.json").exists()


def test_options_that_contradict_an_existing_data_set_are_refused(command, toy_folder):
    code, _, err = command(cli.data_main, "--episodes", 50, "--data", toy_folder)
    assert code == 2
    assert "40 episodes of seed 3" in err


@pytest.mark.parametrize("package", ["torch", "onnx", "joblib"])
def test_a_missing_package_exits_3_with_its_install_command(command, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    code, _, err = command(cli.train_main)
    assert code == 3
    assert package in err
    assert 'pip install -e ".[offline]"' in err


def test_the_options_of_the_commands_import_no_heavy_package():
    script = (
        "import sys, offline.cli; "
        "print([m for m in ('torch', 'onnx', 'onnxruntime', 'numpy') if m in sys.modules])"
    )
    answer = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "[]"


@pytest.mark.parametrize("main", ENTRY_POINTS)
def test_every_command_prints_the_version_of_the_distribution(command, main):
    code, out, _ = command(main, "--version")
    assert code in (0, None)
    assert out == version("rt-controller")


def test_all_refused_options_are_named_at_once(command):
    code, _, err = command(cli.train_main, "--steps", 0, "--patience", -1)
    assert code == 2
    assert "--steps" in err
    assert "--patience" in err


def test_every_field_of_the_configuration_is_an_option(command):
    code, out, _ = command(cli.train_main, "--help-all")
    assert code in (0, None)
    for name in TrainingConfig.model_fields:
        assert f"--{name.replace('_', '-')}" in out


def test_ctrl_c_ends_a_run_with_a_checkpoint_and_the_command_to_resume(toy_folder, tmp_path):
    script = "from offline.cli import train_main; train_main()"
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
