"""Where independent tasks run: on the cores of this machine, or on those of a cluster.

The tasks are the same, and so are their results; only `Backend` knows the difference. It
configures joblib, whose own backends do the work, and `offline.parallel` sends the tasks.
"""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal
from urllib.parse import urlsplit

import joblib

from rt_controller.contract.errors import ConfigError, MissingExtraError, RtControllerError

BackendName = Literal["loky", "threading", "dask", "ray"]

CLUSTERS = {"dask": "distributed", "ray": "ray"}
"""backends that know an address, and the package that each stands on"""

CONNECT_S = 5.0
HEALTH_S = 15.0
"""most of it for starting Ray's own command"""
FIRST_WORKER_S = 10.0


class UnreachableError(RtControllerError):
    """A cluster that does not answer, or that has nobody to work."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Backend:
    """Whom tasks are given to.

    Raises:
        ConfigError: an address without a cluster, no HOST:PORT, or no number of processes.
    """

    name: BackendName = "loky"
    address: str | None = None
    """HOST:PORT of Dask's scheduler or of Ray's head; None: a cluster of this machine's cores"""
    jobs: int = -1
    """processes on this machine, -1: one per core; at an address the cluster's size counts"""

    def __post_init__(self) -> None:
        if self.jobs == 0 or self.jobs < -1:
            raise ConfigError(f"--jobs: expected -1 or a number from 1 on, found {self.jobs}.")
        if self.address is None:
            return
        if self.name not in CLUSTERS:
            raise ConfigError(
                f"--address: expected --backend dask or ray with it, found --backend {self.name}. "
                f"Name the kind of the cluster at {self.address}."
            )
        _host_and_port(self.address)

    @contextmanager
    def active(self) -> Iterator[None]:
        """Within it, `offline.parallel.in_order` sends its tasks there.

        Raises:
            MissingExtraError: the package of the cluster is not installed.
            UnreachableError: nobody answers at the address, within seconds.
        """
        self._require_package()
        if self.name == "dask":
            with _dask_client(self.address, self.jobs) as client:
                yield from _configured("dask", None, client=client)
        elif self.name == "ray":
            with _ray_cluster(self.address, self.jobs):
                yield from _configured("ray", -1 if self.address else self.jobs)
        else:
            yield from _configured(self.name, self.jobs)

    def _require_package(self) -> None:
        package = CLUSTERS.get(self.name)
        if package is not None and find_spec(package) is None:
            raise MissingExtraError(
                f"--backend {self.name} expects the extra {self.name!r}, found no {package}. "
                f'Run: pip install -e ".[{self.name}]"'
            )


def _configured(name: str, jobs: int | None, **parameters: object) -> Iterator[None]:
    with joblib.parallel_config(name, n_jobs=jobs, **parameters):
        yield


@contextmanager
def _dask_client(address: str | None, jobs: int) -> Iterator[object]:
    """A client with at least one worker, of the cluster there or of one made now."""
    from distributed import Client, LocalCluster

    if address is None:
        workers = os.cpu_count() if jobs == -1 else jobs
        # One thread a process: two trainings in one process would share torch's dice.
        with (
            LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
            ) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):
            yield client
        return
    _require_listener(address)
    url = address if "://" in address else f"tcp://{address}"
    try:
        client = Client(url, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise _unreachable(address, "a Dask scheduler", error) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_S)
        except TimeoutError as error:
            raise UnreachableError(
                f"--address {address}: expected workers, found a scheduler without any for "
                f"{FIRST_WORKER_S:.0f} s. Start some: dask worker {url} --nthreads 1"
            ) from error
        yield client


@contextmanager
def _ray_cluster(address: str | None, jobs: int) -> Iterator[None]:
    """Ray connected to the cluster there, or to one made now, and joblib told about it."""
    # Ray reports its use to its makers unless told otherwise before it is loaded.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if address is not None:
        _require_listener(address)
        _require_ray_head(address)
    import ray
    from ray.util.joblib.ray_backend import RayBackend

    class StreamingRayBackend(RayBackend):  # type: ignore[misc]
        """Hands results over as they come, which Ray's pool can and its backend does not say."""

        supports_return_generator = True

    joblib.register_parallel_backend("ray", StreamingRayBackend)
    cores = None if address or jobs == -1 else jobs
    try:
        # "local" is a cluster of one's own; nothing at all may be that of somebody else.
        ray.init(address or "local", num_cpus=cores, log_to_driver=False, logging_level="ERROR")
    except (OSError, RuntimeError, ValueError) as error:
        raise _unreachable(address or "local", "a Ray cluster", error) from error
    try:
        yield
    finally:
        ray.shutdown()


def _require_listener(address: str) -> None:
    """Somebody listens there: known at once, where a cluster's client would try for a minute."""
    try:
        socket.create_connection(_host_and_port(address), timeout=CONNECT_S).close()
    except OSError as error:
        raise _unreachable(address, "a cluster", error) from error


def _require_ray_head(address: str) -> None:
    """It is Ray that listens: asked in a process of its own, since Ray cannot be interrupted."""
    command = [sys.executable, "-m", "ray.scripts.scripts", "health-check", "--address", address]
    try:
        answer = subprocess.run(
            command, capture_output=True, text=True, timeout=HEALTH_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise _unreachable(address, "the head of a Ray cluster", "no answer") from error
    if answer.returncode:
        last = (answer.stderr.strip().splitlines() or ["no answer"])[-1]
        raise _unreachable(address, "the head of a Ray cluster", last)


def _unreachable(address: str, what: str, why: object) -> UnreachableError:
    first_line = (str(why).strip() or type(why).__name__).splitlines()[0]
    return UnreachableError(
        f"--address {address}: expected {what} to answer, found none ({first_line}). Start it, or "
        f"name another HOST:PORT."
    )


def _host_and_port(address: str) -> tuple[str, int]:
    try:
        parts = urlsplit(address if "://" in address else f"//{address}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or port is None:
        raise ConfigError(f"--address: expected HOST:PORT, found {address!r}.")
    return host, port
