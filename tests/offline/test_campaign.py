"""Backends of joblib: a cluster gives every result, one that cannot work is refused."""

import json
import socket
import sys
from importlib.util import find_spec

import pytest
from worker_tasks import square

from offline import cli
from offline.data.generate import run_tasks
from offline.experiments import backend as backend_module
from offline.experiments.backend import Backend
from rt_controller.contract.errors import ConfigError, MissingExtraError

SQUARES = {number: number * number for number in range(20)}


def squares(backend: Backend) -> dict[int, int]:
    with backend.active():
        return dict(run_tasks(square, [(number,) for number in SQUARES]))


@pytest.fixture
def rigs_in_workers(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", ":".join(filter(None, sys.path)))


@pytest.mark.parametrize("name", ["loky", "threading", "dask", "ray"])
def test_workers_of_this_machine_give_every_result(name, rigs_in_workers):
    package = backend_module.CLUSTERS.get(name)
    if package and find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    assert squares(Backend(name, jobs=2)) == SQUARES


def test_cluster_at_an_address_gives_every_result(rigs_in_workers):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as cluster:
        address = cluster.scheduler_address.removeprefix("tcp://")
        assert squares(Backend("dask", address)) == SQUARES


@pytest.mark.parametrize("name", ["dask", "ray"])
def test_address_without_a_listener_is_an_error(name, monkeypatch):
    pytest.importorskip(backend_module.CLUSTERS[name])
    monkeypatch.setattr(backend_module, "CONNECT_S", 0.5)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{unused.getsockname()[1]}"
        with (
            pytest.raises(ConfigError, match=r"cluster to answer.*Start it"),
            Backend(name, address).active(),
        ):
            pytest.fail("no cluster is there")


@pytest.mark.parametrize(("name", "package"), [("dask", "distributed"), ("ray", "ray")])
def test_missing_package_is_an_error_with_the_line_that_installs_it(monkeypatch, name, package):
    monkeypatch.setitem(sys.modules, package, None)
    with (
        pytest.raises(MissingExtraError, match=rf"pip install.*\[{name}\]"),
        Backend(name).active(),
    ):
        pytest.fail("it is not installed")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("loky", "127.0.0.1:8786"), "expected --backend dask or ray"),
        (("loky", None, 0), "--jobs"),
        (("loky", None, -2), "--jobs"),
    ],
)
def test_contradictory_options_are_refused(arguments, complaint):
    with pytest.raises(ConfigError, match=complaint):
        Backend(*arguments)


def test_data_set_has_the_same_bytes_with_every_backend(tmp_path, monkeypatch):
    monkeypatch.setattr("offline.data.generate.CHUNK_EPISODES", 2)  # five tasks instead of one
    hashes = set()
    for where in (("--jobs", "1"), ("--jobs", "2"), ("--backend", "threading", "--jobs", "2")):
        folder, figures = tmp_path / "-".join(where), tmp_path / "figures.json"
        arguments = ["offline-data", "--episodes", "10", "--data", str(folder), *where]
        monkeypatch.setattr(sys, "argv", [*arguments, "--json", str(figures)])
        with pytest.raises(SystemExit) as exit_info:
            cli.data_main()
        assert exit_info.value.code in (0, None)
        hashes.add(json.loads(figures.read_text())["sha256"])
    assert len(hashes) == 1
