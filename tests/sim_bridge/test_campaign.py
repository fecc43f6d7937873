"""Many tasks: every backend gives every result, and a stopped campaign goes on where it was."""

import signal
import socket
import sys
from importlib.util import find_spec
from operator import neg

import pytest

from rt_controller.contract.errors import ConfigError, MissingExtraError
from sim_bridge import campaign
from sim_bridge.campaign import Backend, WorkersLostError, run_campaign

TASKS = [(str(number), (number,)) for number in range(20)]
NEGATIVES = {key: -number for key, (number,) in TASKS}
ALONE = Backend(jobs=1)


@pytest.mark.parametrize("name", ["loky", "dask", "ray"])
def test_workers_of_this_machine_give_every_result(name):
    package = campaign.CLUSTERS.get(name)
    if package and find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    assert dict(run_campaign(neg, TASKS, Backend(name, jobs=2))) == NEGATIVES


def test_cluster_at_an_address_gives_every_result():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as cluster:
        backend = Backend("dask", cluster.scheduler_address.removeprefix("tcp://"))
        assert dict(run_campaign(neg, TASKS, backend)) == NEGATIVES


def test_a_killed_campaign_goes_on_and_its_file_is_of_one_model(tmp_path):
    file, made_with, asked = tmp_path / "results.jsonl", {"model": "a"}, []

    def noted(number):
        asked.append(number)
        if len(asked) == 3:
            raise KeyboardInterrupt
        return neg(number)

    with pytest.raises(KeyboardInterrupt):
        list(run_campaign(noted, TASKS, ALONE, file, made_with))
    file.write_text(file.read_text() + '{"made_with_sha256": "', encoding="utf-8")
    found = dict(run_campaign(noted, TASKS, ALONE, file, made_with))
    assert (found, asked) == (NEGATIVES, [0, 1, 2, *range(2, 20)])
    assert dict(run_campaign(noted, TASKS, ALONE, file, made_with)) == NEGATIVES
    assert len(asked) == 21
    for content in (file.read_text(), "{}\n", "text\n"):
        file.write_text(content)
        with pytest.raises(ConfigError, match=r"results\.jsonl.*Name another file"):
            list(run_campaign(noted, TASKS, ALONE, file, {"model": "b"}))


@pytest.mark.filterwarnings("ignore:.*have been cancelled")
def test_tasks_in_order_may_have_no_end():
    def endless():
        while True:
            yield from TASKS

    results = run_campaign(neg, endless(), Backend(jobs=2), in_order=True)
    assert [next(results) for _ in TASKS] == [*NEGATIVES.items()]
    results.close()


@pytest.mark.parametrize("content", [b"notes", b"[1, 2]\nlast", b"\x00\xff", b'{"a": 1}\n'])
def test_a_file_of_something_else_is_refused_and_stays_as_it_was(tmp_path, content):
    file = tmp_path / "mine"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match="expected results of the same model and data"):
        list(run_campaign(neg, [("a", (1,))], Backend(jobs=1), file))
    assert file.read_bytes() == content


def test_killed_worker_ends_with_an_error_that_names_lack_of_memory():
    with pytest.raises(WorkersLostError, match="Look for lack of memory"):
        list(run_campaign(signal.raise_signal, [("a", (signal.SIGKILL,))], Backend(jobs=2)))


@pytest.mark.parametrize("name", ["dask", "ray"])
def test_address_without_a_listener_is_an_error(name, monkeypatch):
    pytest.importorskip(campaign.CLUSTERS[name])
    monkeypatch.setattr(campaign, "CONNECT_S", 0.5)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(ConfigError, match="--address"), Backend(name, address).active():
            pytest.fail("no cluster is there")


@pytest.mark.parametrize(("name", "package"), campaign.CLUSTERS.items())
def test_missing_package_is_an_error_with_the_line_that_installs_it(monkeypatch, name, package):
    monkeypatch.setitem(sys.modules, package, None)
    with (
        pytest.raises(MissingExtraError, match=rf"pip install.*\[{name}\]"),
        Backend(name).active(),
    ):
        pytest.fail("it is not installed")
