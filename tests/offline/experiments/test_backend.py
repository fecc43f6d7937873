"""A backend that cannot work is refused within seconds, with its remedy."""

import socket
import sys

import pytest

from offline.experiments import backend as backend_module
from offline.experiments.backend import Backend
from rt_controller.contract.errors import ConfigError, MissingExtraError


def need(name: str, request: pytest.FixtureRequest) -> None:
    if name == "ray":
        request.getfixturevalue("ray_environment")


@pytest.mark.parametrize("name", ["dask", "ray"])
def test_address_without_a_listener_is_an_error(name, request):
    need(name, request)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{unused.getsockname()[1]}"
        with (
            pytest.raises(ConfigError, match=r"expected a cluster to answer.*Start it"),
            Backend(name, address).active(),
        ):
            pytest.fail("no cluster is there")


@pytest.mark.parametrize(("name", "what"), [("dask", "Dask scheduler"), ("ray", "Ray cluster")])
def test_address_of_another_program_is_an_error(monkeypatch, request, name, what):
    need(name, request)
    monkeypatch.setattr(backend_module, "CONNECT_S", 0.5)
    if name == "ray":
        from offline.experiments import ray_cluster

        monkeypatch.setattr(ray_cluster, "HEALTH_CHECK_S", 3.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(ConfigError, match=what), Backend(name, address).active():
            pytest.fail("this is no cluster")


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
        (("dask", "127.0.0.1"), "expected HOST:PORT"),
        (("dask", ":8786"), "expected HOST:PORT"),
        (("ray", "head:port"), "expected HOST:PORT"),
        (("loky", None, 0), "--jobs"),
        (("loky", None, -2), "--jobs"),
    ],
)
def test_contradictory_options_are_refused(arguments, complaint):
    with pytest.raises(ConfigError, match=complaint):
        Backend(*arguments)
