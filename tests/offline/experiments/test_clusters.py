"""Tasks on Dask and Ray: the same results, also when a worker or the scheduler dies."""

import os
import shutil
import signal
import threading
import time
from pathlib import Path

import dask
import pytest
from dask_cluster import dask_cluster
from worker_tasks import fail, square, square_or_die, square_with_trace

from offline.data.tasks import WorkersLostError, run_tasks
from offline.experiments import backend as backend_module
from offline.experiments import dask_cluster as dask_module
from offline.experiments.backend import Backend
from rt_controller.contract.errors import ConfigError

SQUARES = {number: number * number for number in range(20)}


def squares(backend: Backend) -> dict[int, int]:
    with backend.active():
        return dict(run_tasks(square, [(number,) for number in SQUARES]))


@pytest.mark.parametrize("scheme", ["", "tcp://"])
def test_cluster_at_an_address_gives_every_result(cluster, scheme):
    assert squares(Backend("dask", f"{scheme}{cluster.address}")) == SQUARES


@pytest.mark.nightly
def test_new_cluster_with_one_worker_gives_every_result():
    assert squares(Backend("dask", jobs=1)) == SQUARES


def test_result_is_returned_before_the_last_task_ends(tmp_path, cluster):
    (tmp_path / "hold-1").touch()
    with Backend("dask", cluster.address).active():
        results = run_tasks(square_with_trace, [(0, tmp_path), (1, tmp_path)])
        assert next(results) == (0, 0)
        (tmp_path / "hold-1").unlink()
        assert list(results) == [(1, 1)]


def test_error_of_a_task_is_raised_with_its_text(cluster):
    with (
        Backend("dask", cluster.address).active(),
        pytest.raises(ValueError, match="is too much"),
    ):
        list(run_tasks(fail, [(1,), (2,)]))


def test_killed_dask_worker_costs_only_its_task(tmp_path):
    """Task 3 waits until all others are done; then the process that runs it is killed."""
    (tmp_path / "hold-3").touch()
    killed: list[int] = []

    def kill_the_worker_of_task_3() -> None:
        while len({trace.stem for trace in tmp_path.glob("*.*")}) < len(SQUARES):
            time.sleep(0.01)
        (trace,) = tmp_path.glob("3.*")
        killed.append(int(trace.suffix[1:]))
        os.kill(killed[0], signal.SIGKILL)
        (tmp_path / "hold-3").unlink()

    logs = tmp_path / "logs"
    logs.mkdir()
    with dask_cluster(logs) as cluster:
        killer = threading.Thread(target=kill_the_worker_of_task_3, daemon=True)
        killer.start()
        with Backend("dask", cluster.address).active():
            tasks = [(number, tmp_path) for number in SQUARES]
            assert dict(run_tasks(square_with_trace, tasks)) == SQUARES
        killer.join()
        assert {w.pid: w.poll() for w in cluster.workers}[killed[0]] == -signal.SIGKILL
    runs = {number: len(list(tmp_path.glob(f"{number}.*"))) for number in SQUARES}
    assert runs == {number: 2 if number == 3 else 1 for number in SQUARES}


@pytest.mark.nightly
def test_task_that_kills_every_dask_worker_ends_with_an_error(tmp_path):
    (tmp_path / "die-1").mkdir()
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        Backend("dask", jobs=2).active(),
        pytest.raises(WorkersLostError, match="Look for lack of memory"),
    ):
        list(run_tasks(square_or_die, [(number, tmp_path) for number in SQUARES]))


@pytest.mark.nightly
def test_scheduler_that_dies_ends_the_command_with_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(backend_module, "CONNECT_S", 1.0)  # it waits as long for another one
    (tmp_path / "hold-1").touch()
    with dask_cluster(tmp_path) as cluster, Backend("dask", cluster.address).active():
        results = run_tasks(square_with_trace, [(0, tmp_path), (1, tmp_path)])
        assert next(results) == (0, 0)
        cluster.scheduler.kill()
        with pytest.raises(WorkersLostError, match="run the command again"):
            list(results)


@pytest.mark.nightly
def test_dask_worker_of_another_version_is_refused(tmp_path):
    """Otherwise a data set could be made by two versions of the vehicle model."""
    root = Path(backend_module.__file__).parents[2]
    for package in ("rt_controller", "sim_bridge", "offline"):
        shutil.copytree(root / package, tmp_path / "code" / package)
    (tmp_path / "code" / "sim_bridge" / "plant" / "another.py").touch()
    with (
        dask_cluster(tmp_path, workers=1, first_on_path=tmp_path / "code") as cluster,
        Backend("dask", cluster.address).active(),
        pytest.raises(ConfigError, match="Install the same version on every worker"),
    ):
        list(run_tasks(square, [(1,), (2,)]))


@pytest.mark.nightly
def test_scheduler_without_workers_is_an_error_that_says_how_to_start_one(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_module, "FIRST_WORKER_S", 0.5)
    with (
        dask_cluster(tmp_path, workers=0) as cluster,
        pytest.raises(ConfigError, match="dask worker tcp://127"),
        Backend("dask", cluster.address).active(),
    ):
        pytest.fail("there are no workers")


def test_ray_gives_every_result_also_when_a_worker_is_killed(tmp_path, ray_environment):
    (tmp_path / "die-3").touch()
    with Backend("ray", jobs=2).active():
        tasks = [(number, tmp_path) for number in SQUARES]
        assert dict(run_tasks(square_or_die, tasks)) == SQUARES
    assert not (tmp_path / "die-3").exists()
