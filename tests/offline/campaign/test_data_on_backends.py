"""A data set is the same bytes whoever made it, and however often a worker died on the way."""

import json
import signal
import sys
from pathlib import Path

import pytest
from dask_cluster import dask_cluster

from offline import cli, generate
from offline.backend import Backend
from offline.dataset import save_dataset, split_episodes
from offline.excitation import Recipe
from offline.manifest import Driven, Roads
from offline.roles import VEHICLE_ROLES
from rt_controller.contract.schema import VEHICLE

EPISODES = 12
SEED = 5


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    """Six tasks instead of one."""
    monkeypatch.setattr(generate, "CHUNK_EPISODES", 2)


def sha256(folder: Path, backend: Backend, on_progress=lambda done: None) -> str:
    """Of a data set that the backend made."""
    recipe = Recipe()
    with backend.active():
        made = generate.generate(recipe, EPISODES, SEED, None, on_progress)
    return save_dataset(
        folder,
        made.recording,
        made.slices,
        split_episodes(EPISODES, SEED),
        schema=VEHICLE,
        roles=VEHICLE_ROLES,
        roads=Roads(recipe.curvatures_per_m, generate.FIRST_EY_M, generate.FIRST_EPSI_RAD),
        origin=Driven(recipe, EPISODES, SEED, "of today"),
        rejected=made.rejected,
    ).sha256


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> str:
    """What one process makes without any help."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generate, "CHUNK_EPISODES", 2)
        return sha256(tmp_path_factory.mktemp("alone"), Backend(jobs=1))


@pytest.mark.parametrize("backend", [Backend(jobs=2), Backend("threading", jobs=2)])
def test_processes_and_threads_make_the_same_bytes(tmp_path, alone, backend):
    assert sha256(tmp_path, backend) == alone


def test_a_dask_cluster_makes_the_same_bytes(tmp_path, alone, cluster):
    assert sha256(tmp_path, Backend("dask", cluster.address)) == alone


def test_a_ray_cluster_makes_the_same_bytes(tmp_path, alone, ray_environment):
    assert sha256(tmp_path, Backend("ray", jobs=2)) == alone


def test_other_chunks_make_the_same_bytes(tmp_path, alone, monkeypatch):
    monkeypatch.setattr(generate, "CHUNK_EPISODES", 5)
    assert sha256(tmp_path, Backend(jobs=2)) == alone


def test_a_dask_worker_killed_in_mid_run_changes_nothing(tmp_path, alone):
    with dask_cluster(tmp_path) as cluster:
        heard: list[int] = []

        def kill_a_worker(done: int) -> None:
            if not heard:
                cluster.workers[0].send_signal(signal.SIGKILL)
            heard.append(done)

        found = sha256(tmp_path / "data", Backend("dask", cluster.address), kill_a_worker)
        assert cluster.workers[0].wait() == -signal.SIGKILL
        assert cluster.workers[1].poll() is None
    assert found == alone
    assert heard == [2] * 6


def test_the_command_takes_a_cluster_and_says_the_same_hash(tmp_path, monkeypatch, cluster):
    hashes = []
    for name, backend in (("here", ()), ("there", ("dask", cluster.address))):
        options = () if not backend else ("--backend", backend[0], "--address", backend[1])
        figures = tmp_path / f"{name}.json"
        arguments = ["offline-data", "--episodes", "10", "--jobs", "1", *options]
        arguments += ["--data", str(tmp_path / name), "--json", str(figures)]
        monkeypatch.setattr(sys, "argv", arguments)
        with pytest.raises(SystemExit) as exit_info:
            cli.data_main()
        assert exit_info.value.code in (0, None)
        hashes.append(json.loads(figures.read_text())["sha256"])
    assert hashes[0] == hashes[1]


@pytest.mark.parametrize(
    ("options", "code", "complaint"),
    [
        (("--address", "127.0.0.1:8786"), 2, "--backend dask or ray"),
        (("--backend", "dask", "--address", "127.0.0.1:1"), 2, "expected a cluster to answer"),
        (("--jobs", "0"), 2, "--jobs"),
    ],
)
def test_a_backend_that_cannot_work_is_a_mistake_in_words(
    tmp_path, monkeypatch, capsys, options, code, complaint
):
    arguments = ["offline-data", "--episodes", "10", "--data", str(tmp_path / "data"), *options]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as exit_info:
        cli.data_main()
    assert exit_info.value.code == code
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "data").exists()
