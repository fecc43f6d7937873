"""Where independent tasks run: on the cores of this machine or on a Dask or Ray cluster."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Literal
from urllib.parse import urlsplit

from cyclopts import Parameter

from rt_controller.contract.errors import ConfigError, require_packages

BackendName = Literal["loky", "threading", "dask", "ray"]

CLUSTERS = {"dask": "distributed", "ray": "ray"}
"""backends that accept an address, and the package that each needs"""

CONNECT_S = 5.0


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class Backend:
    """A joblib backend with its place and size, and the options that name it.

    Raises:
        ConfigError: an address without a cluster, no HOST:PORT, or no valid number of processes.
    """

    name: Annotated[
        BackendName,
        Parameter(
            name="--backend",
            help="where the work is done: processes or threads of this machine, a Dask or a Ray "
            "cluster",
        ),
    ] = "loky"
    address: Annotated[
        str | None, Parameter(help="HOST:PORT of the cluster; default: a new one on this machine")
    ] = None
    """of Dask's scheduler or of Ray's head"""
    jobs: Annotated[int, Parameter(help="processes; -1 is one per core")] = -1
    """on this machine; unused with an address"""

    def __post_init__(self) -> None:
        if self.jobs == 0 or self.jobs < -1:
            raise ConfigError(f"--jobs: expected -1 or a positive number, found {self.jobs}.")
        if self.address is not None:
            if self.name not in CLUSTERS:
                raise ConfigError(
                    f"--address: expected --backend dask or ray with it, found --backend "
                    f"{self.name}. Name the kind of the cluster at {self.address}."
                )
            host_and_port(self.address)

    @contextmanager
    def active(self) -> Iterator[None]:
        """Context in which `run_tasks` sends its tasks to this backend.

        Raises:
            MissingExtraError: the package of the cluster is not installed.
            ConfigError: no cluster answers at the address within seconds.
        """
        import joblib

        package = CLUSTERS.get(self.name)
        if package is not None:
            require_packages(self.name, (package,), f"--backend {self.name}")
        if self.address is not None:
            try:  # the clients of the clusters would try for a minute
                socket.create_connection(host_and_port(self.address), CONNECT_S).close()
            except OSError as error:
                raise unreachable(self.address, "a cluster", error) from error
        if package is None:
            workers = joblib.parallel_config(self.name, n_jobs=self.jobs)
        else:
            cluster = import_module(f"offline.experiments.{self.name}_cluster")
            workers = cluster.workers(self.address, self.jobs)
        with workers:
            yield


def host_and_port(address: str) -> tuple[str, int]:
    """Host and port of HOST:PORT, with or without a scheme in front; else a `ConfigError`."""
    with suppress(ValueError):
        parts = urlsplit(address if "://" in address else f"//{address}")
        if parts.hostname and parts.port is not None:
            return parts.hostname, parts.port
    raise ConfigError(f"--address: expected HOST:PORT, found {address!r}.")


def unreachable(address: str, expected: str, reason: object) -> ConfigError:
    """The error to raise if `expected` does not answer at the address."""
    first_line = (str(reason).strip() or type(reason).__name__).splitlines()[0]
    return ConfigError(
        f"--address {address}: expected {expected} to answer, found none ({first_line}). Start it, "
        f"or name another HOST:PORT."
    )
