"""A data set has the same bytes with every backend, and when a worker is killed."""

import json
import signal
import sys
from pathlib import Path

import pytest
from dask_cluster import dask_cluster

from offline import cli
from offline.data import generate
from offline.data.cache import make_dataset
from offline.data.excitation import Recipe
from offline.data.manifest import Simulated
from offline.experiments.backend import Backend

ORIGIN = Simulated(Recipe(), 12, 5, "of a test")


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    """Six tasks instead of one."""
    monkeypatch.setattr(generate, "CHUNK_EPISODES", 2)


def sha256(folder: Path, backend: Backend, on_progress=lambda done: None) -> str:
    """Of a data set that the backend made."""
    with backend.active():
        return make_dataset(folder, ORIGIN, on_progress=on_progress).sha256


@pytest.fixture(scope="module")
def expected(tmp_path_factory) -> str:
    """SHA-256 of the data set of one process, made as a single task."""
    return sha256(tmp_path_factory.mktemp("alone"), Backend(jobs=1))


@pytest.mark.parametrize("backend", [Backend(jobs=2), Backend("threading", jobs=2)])
def test_processes_and_threads_make_the_same_bytes(tmp_path, expected, backend):
    assert sha256(tmp_path, backend) == expected


@pytest.mark.nightly
def test_ray_cluster_makes_the_same_bytes(tmp_path, expected, ray_environment):
    assert sha256(tmp_path, Backend("ray", jobs=2)) == expected


@pytest.mark.nightly
def test_dask_cluster_makes_the_same_bytes_also_when_a_worker_is_killed(tmp_path, expected):
    with dask_cluster(tmp_path) as cluster:
        progress: list[int] = []

        def kill_a_worker(done: int) -> None:
            if not progress:
                cluster.workers[0].send_signal(signal.SIGKILL)
            progress.append(done)

        found = sha256(tmp_path / "data", Backend("dask", cluster.address), kill_a_worker)
        assert cluster.workers[0].wait() == -signal.SIGKILL
        assert cluster.workers[1].poll() is None
    assert found == expected
    assert progress == [2, 4, 6, 8, 10, 12]


@pytest.mark.nightly
def test_command_reports_the_same_hash_from_a_cluster(tmp_path, monkeypatch, cluster):
    hashes = []
    for name, options in (("here", ()), ("there", ("--backend", "dask", "--address"))):
        where = (*options, cluster.address) if options else ()
        figures = tmp_path / f"{name}.json"
        arguments = ["offline-data", "--episodes", "10", "--jobs", "1", *where]
        arguments += ["--data", str(tmp_path / name), "--json", str(figures)]
        monkeypatch.setattr(sys, "argv", arguments)
        with pytest.raises(SystemExit) as exit_info:
            cli.data_main()
        assert exit_info.value.code in (0, None)
        hashes.append(json.loads(figures.read_text())["sha256"])
    assert hashes[0] == hashes[1]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--address", "127.0.0.1:8786"), "--backend dask or ray"),
        (("--backend", "dask", "--address", "127.0.0.1:1"), "expected a cluster to answer"),
        (("--jobs", "0"), "--jobs"),
    ],
)
def test_backend_that_cannot_work_ends_the_command_with_exit_code_2(
    tmp_path, monkeypatch, capsys, options, complaint
):
    arguments = ["offline-data", "--episodes", "10", "--data", str(tmp_path / "data"), *options]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as exit_info:
        cli.data_main()
    assert exit_info.value.code == 2
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "data").exists()
