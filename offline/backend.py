"""Where independent tasks run: on the cores of this machine, or on those of a cluster.

The tasks are the same, and so are their results; only `Backend` knows the difference. It
configures joblib, whose own backends do the work, and `offline.parallel` sends the tasks.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal

from offline.address import host_and_port
from rt_controller.contract.errors import ConfigError, MissingExtraError

BackendName = Literal["loky", "threading", "dask", "ray"]

CLUSTERS = {"dask": "distributed", "ray": "ray"}
"""backends that know an address, and the package that each stands on"""


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
        host_and_port(self.address)

    @contextmanager
    def active(self) -> Iterator[None]:
        """Within it, `offline.parallel.in_order` sends its tasks there.

        Raises:
            MissingExtraError: the package of the cluster is not installed.
            UnreachableError: nobody answers at the address, within seconds.
        """
        self._require_package()
        with self._tasks():
            yield

    def _tasks(self) -> AbstractContextManager[None]:
        if self.name == "dask":
            from offline.dask_cluster import dask_tasks

            return dask_tasks(self.address, self.jobs)
        if self.name == "ray":
            from offline.ray_cluster import ray_tasks

            return ray_tasks(self.address, self.jobs)
        import joblib

        configured: AbstractContextManager[None] = joblib.parallel_config(
            self.name, n_jobs=self.jobs
        )
        return configured

    def _require_package(self) -> None:
        package = CLUSTERS.get(self.name)
        if package is not None and find_spec(package) is None:
            raise MissingExtraError(
                f"--backend {self.name} expects the extra {self.name!r}, found no {package}. "
                f'Run: pip install -e ".[{self.name}]"'
            )
