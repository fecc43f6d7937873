"""The same tasks give the same results wherever they run, also when workers die on the way."""

import os
import shutil
import signal
import socket
import sys
import threading
import time
from pathlib import Path

import dask
import pytest
from dask_cluster import dask_cluster
from worker_tasks import fail, square, square_or_die, square_with_trace

from offline import address as address_module
from offline import dask_cluster as dask_module
from offline.address import UnreachableError
from offline.backend import Backend
from offline.parallel import WorkersLostError, in_order
from rt_controller.contract.errors import ConfigError, MissingExtraError

NUMBERS = [(number,) for number in range(20)]
SQUARES = [number * number for (number,) in NUMBERS]


def need(name: str, request: pytest.FixtureRequest) -> None:
    if name == "ray":
        request.getfixturevalue("ray_environment")


def squares(backend: Backend) -> list[int]:
    with backend.active():
        return list(in_order(square, NUMBERS))


@pytest.mark.parametrize(
    "backend",
    [
        Backend(jobs=1),
        Backend(jobs=2),
        Backend("threading", jobs=2),
        Backend("dask", jobs=1),
    ],
)
def test_results_come_in_the_order_of_the_tasks(backend):
    assert squares(backend) == SQUARES


def test_a_cluster_at_an_address_does_the_same(cluster):
    assert squares(Backend("dask", cluster.address)) == SQUARES
    assert squares(Backend("dask", f"tcp://{cluster.address}")) == SQUARES


def test_without_a_backend_the_number_of_processes_is_an_argument():
    assert list(in_order(square, NUMBERS, jobs=2)) == SQUARES


def test_a_result_is_handed_over_before_the_last_one_is_known(tmp_path, cluster):
    (tmp_path / "hold-1").touch()
    with Backend("dask", cluster.address).active():
        results = in_order(square_with_trace, [(0, tmp_path), (1, tmp_path)])
        assert next(results) == 0
        (tmp_path / "hold-1").unlink()
        assert list(results) == [1]


def test_an_error_in_a_task_keeps_its_words(cluster):
    for backend in (Backend(jobs=2), Backend("dask", cluster.address)):
        with backend.active(), pytest.raises(ValueError, match="is too much"):
            list(in_order(fail, NUMBERS))


def test_a_killed_dask_worker_costs_nothing_but_its_task(tmp_path):
    """Task 3 is held until all others are done, then the process that does it is killed."""
    (tmp_path / "hold-3").touch()
    killed: list[int] = []

    def kill_the_worker_of_task_3():
        while len({trace.stem for trace in tmp_path.glob("*.*")}) < len(NUMBERS):
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
            tasks = [(number, tmp_path) for (number,) in NUMBERS]
            assert list(in_order(square_with_trace, tasks)) == SQUARES
        killer.join()
        assert {w.pid: w.poll() for w in cluster.workers}[killed[0]] == -signal.SIGKILL
    runs = {number: len(list(tmp_path.glob(f"{number}.*"))) for (number,) in NUMBERS}
    assert runs == {number: 2 if number == 3 else 1 for (number,) in NUMBERS}


def test_a_killed_process_of_this_machine_costs_no_result(tmp_path):
    (tmp_path / "die-3").touch()
    with Backend(jobs=2).active():
        tasks = [(number, tmp_path) for (number,) in NUMBERS]
        assert list(in_order(square_or_die, tasks)) == SQUARES
    assert not (tmp_path / "die-3").exists()


def test_ray_does_the_same_also_when_a_worker_is_killed(tmp_path, ray_environment):
    (tmp_path / "die-3").touch()
    with Backend("ray", jobs=2).active():
        tasks = [(number, tmp_path) for (number,) in NUMBERS]
        assert list(in_order(square_or_die, tasks)) == SQUARES
    assert not (tmp_path / "die-3").exists()


@pytest.mark.parametrize("name", ["loky", "dask"])
def test_a_task_that_kills_every_worker_ends_in_words(tmp_path, name):
    (tmp_path / "die-1").mkdir()
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        Backend(name, jobs=2).active(),
        pytest.raises(WorkersLostError, match="Look for lack of memory"),
    ):
        list(in_order(square_or_die, [(number, tmp_path) for (number,) in NUMBERS]))


def test_a_scheduler_that_dies_in_mid_run_ends_in_words(tmp_path, monkeypatch):
    monkeypatch.setattr(address_module, "CONNECT_S", 1.0)  # as long it waits for another
    (tmp_path / "hold-1").touch()
    with dask_cluster(tmp_path) as cluster, Backend("dask", cluster.address).active():
        results = in_order(square_with_trace, [(0, tmp_path), (1, tmp_path)])
        assert next(results) == 0
        cluster.scheduler.kill()
        with pytest.raises(WorkersLostError, match="run the command again"):
            list(results)


def test_a_worker_that_runs_other_code_is_refused(tmp_path):
    """A data set made by two versions of the car would be of neither."""
    root = Path(address_module.__file__).parent.parent
    for package in ("rt_controller", "sim_bridge", "offline"):
        shutil.copytree(root / package, tmp_path / "code" / package)
    (tmp_path / "code" / "sim_bridge" / "plant" / "another.py").touch()
    with (
        dask_cluster(tmp_path, workers=1, first_on_path=tmp_path / "code") as cluster,
        Backend("dask", cluster.address).active(),
        pytest.raises(ConfigError, match="Install the same version on every worker"),
    ):
        list(in_order(square, NUMBERS))


@pytest.mark.parametrize("name", ["dask", "ray"])
def test_nobody_at_the_address_is_an_error_and_not_a_hang(name, request):
    need(name, request)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{unused.getsockname()[1]}"
        with (
            pytest.raises(UnreachableError, match=r"expected a cluster to answer.*Start it"),
            Backend(name, address).active(),
        ):
            pytest.fail("nobody is there")


@pytest.mark.parametrize(("name", "what"), [("dask", "Dask scheduler"), ("ray", "Ray cluster")])
def test_somebody_else_at_the_address_is_an_error_and_not_a_hang(monkeypatch, request, name, what):
    need(name, request)
    monkeypatch.setattr(address_module, "CONNECT_S", 1.0)
    if name == "ray":
        from offline import ray_cluster

        monkeypatch.setattr(ray_cluster, "HEALTH_S", 3.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(UnreachableError, match=what), Backend(name, address).active():
            pytest.fail("that is no cluster")


def test_a_scheduler_without_workers_is_an_error_that_says_how_to_start_one(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_module, "FIRST_WORKER_S", 0.5)
    with (
        dask_cluster(tmp_path, workers=0) as cluster,
        pytest.raises(UnreachableError, match="dask worker tcp://127"),
        Backend("dask", cluster.address).active(),
    ):
        pytest.fail("nobody works")


@pytest.mark.parametrize(("name", "package"), [("dask", "distributed"), ("ray", "ray")])
def test_a_missing_package_is_named_with_the_line_that_installs_it(monkeypatch, name, package):
    monkeypatch.setitem(sys.modules, package, None)
    with (
        pytest.raises(MissingExtraError, match=rf'pip install -e "\.\[{name}\]"'),
        Backend(name).active(),
    ):
        pytest.fail("it is not installed")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("loky", "127.0.0.1:8786"), "expected --backend dask or ray"),
        (("dask", "127.0.0.1"), "expected HOST:PORT"),
        (("dask", ":8786"), "expected HOST:PORT"),
        (("ray", "head:port"), "expected HOST:PORT"),
        (("loky", None, 0), "--jobs"),
        (("loky", None, -2), "--jobs"),
    ],
)
def test_a_backend_that_makes_no_sense_is_refused_before_anything_starts(arguments, complaint):
    with pytest.raises(ConfigError, match=complaint):
        Backend(*arguments)
