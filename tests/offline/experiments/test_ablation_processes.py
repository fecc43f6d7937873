"""Trainings in several processes: killed, stopped from a terminal, shared by two commands."""

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from dask_cluster import dask_cluster
from tiny_comparison import compare, histories, runs, tiny_training
from worker_tasks import DIE_FILE, deadly_command

from offline.experiments import ablation
from offline.experiments.backend import Backend
from offline.experiments.running_command import RunningCommand, running_command
from offline.experiments.training_task import LOCK_FILE, RESULT_FILE
from offline.training.checkpoint import load_checkpoint

TRAIN_AND_DIE = """
import pickle, sys
from worker_tasks import deadly_command
from offline.experiments.ablation import train_locked
training, folder = pickle.load(sys.stdin.buffer)
with deadly_command(folder) as command:
    train_locked(training, command)
"""
HOLD_LOCK = """
import sys
import time
from filelock import FileLock
with FileLock(sys.argv[1]):
    print("locked", flush=True)
    sys.stdin.read()
"""
ABLATE = "from offline.cli import ablate_main; ablate_main()"


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, lists, shared, one_process) -> Path:
    """Two variants and two seeds, trained by one process without interruption."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert compare(lists, shared, folder, one_process)
    return folder


def test_training_of_a_killed_process_continues_from_its_checkpoint(
    tmp_path, lists, shared, one_process, undisturbed
):
    training = tiny_training(lists, shared, tmp_path)
    path = os.pathsep.join(filter(None, sys.path))
    killed = subprocess.run(
        [sys.executable, "-c", TRAIN_AND_DIE],
        input=pickle.dumps((training, tmp_path)),
        env={**os.environ, "PYTHONPATH": path},
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL
    assert 0 < load_checkpoint(training.folder / "latest" / "last.pt").step < 12
    assert compare(lists, shared, tmp_path, one_process)
    assert histories(tmp_path) == histories(undisturbed)
    assert runs(tmp_path) == [1, 1, 1, 1], "it started again from its first step"


def test_training_that_another_process_runs_is_waited_for(tmp_path, lists, shared):
    training = tiny_training(lists, shared, tmp_path)
    training.folder.mkdir(parents=True)
    asked = []
    with subprocess.Popen(
        [sys.executable, "-c", HOLD_LOCK, str(training.folder / LOCK_FILE)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"

        class Waiting(RunningCommand):
            """Kills the other process when this one has waited twice."""

            def is_stopped(self) -> bool:
                asked.append(None)
                if len(asked) == 3:
                    assert not (training.folder / "latest").exists(), "trained without the lock"
                    other.kill()
                return super().is_stopped()

        with running_command(tmp_path) as command:
            result = ablation.train_locked(training, Waiting(command.file, command.pid))
    assert result is not None
    assert result.ending == "finished"


@pytest.mark.nightly
def test_killed_loky_worker_costs_no_training_and_changes_no_history(
    tmp_path, lists, shared, undisturbed, monkeypatch
):
    monkeypatch.setattr(ablation, "running_command", deadly_command)
    assert compare(lists, shared, tmp_path, Backend(jobs=2))
    assert not (tmp_path / DIE_FILE).exists(), "no worker was killed"
    assert histories(tmp_path) == histories(undisturbed)
    assert runs(tmp_path) == [1, 1, 1, 1]


@pytest.mark.nightly
def test_killed_dask_worker_costs_only_its_training(
    tmp_path, lists, shared, undisturbed, monkeypatch
):
    monkeypatch.setattr(ablation, "running_command", deadly_command)
    folder = tmp_path / "campaign"
    with dask_cluster(tmp_path) as cluster:
        assert compare(lists, shared, folder, Backend("dask", cluster.address))
        assert sum(worker.poll() is None for worker in cluster.workers) == 1
    assert histories(folder) == histories(undisturbed)
    assert runs(folder) == [1, 1, 1, 1]


@pytest.mark.nightly
def test_two_commands_on_one_folder_share_the_trainings(tmp_path, lists, toy_folder, undisturbed):
    arguments = ["tiny", "--lists", str(lists), "--data", str(toy_folder), "--folder", "f"]
    command = [sys.executable, "-c", ABLATE, *arguments, "--seeds", "0,1", "--jobs", "1"]
    both = [subprocess.Popen(command, cwd=tmp_path) for _ in range(2)]
    assert [process.wait(timeout=280) for process in both] == [0, 0]
    assert histories(tmp_path / "f") == histories(undisturbed)
    assert runs(tmp_path / "f") == [1, 1, 1, 1]


@pytest.mark.nightly
@pytest.mark.parametrize("backend", ["loky", "dask"])
def test_ctrl_c_in_a_terminal_stops_the_command_and_its_worker_processes(
    tmp_path, lists, toy_folder, backend
):
    """A terminal sends the signal to the command and to all its workers."""
    arguments = ["tiny", "--lists", str(lists), "--data", str(toy_folder), "--folder", "f"]
    endless = ["--only", "whole", "--steps", "1000000", "--backend", backend, "--jobs", "2"]
    process = subprocess.Popen(
        [sys.executable, "-c", ABLATE, *arguments, *endless],
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
    assert not list((tmp_path / "f" / "commands").iterdir())
    assert not list(tmp_path.glob(f"f/*/seed-0/{RESULT_FILE}"))
