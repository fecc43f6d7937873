"""Where independent tasks run: on the cores of this machine or on a Dask or Ray cluster."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from rt_controller.contract.errors import ConfigError, require_packages

BackendName = Literal["loky", "threading", "dask", "ray"]
CLUSTERS = {"dask": "distributed", "ray": "ray"}
"""backends that accept an address, and the package that each needs"""
CONNECT_S = 10.0


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class Backend:
    """A joblib backend with its place and size, and the options that name it.

    Raises:
        ConfigError: an address without a cluster, or no valid number of processes.
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
    jobs: Annotated[int, Parameter(help="processes; -1 is one per core")] = -1
    """on this machine; unused with an address"""

    def __post_init__(self) -> None:
        if self.jobs == 0 or self.jobs < -1:
            raise ConfigError(f"--jobs: expected -1 or a positive number, found {self.jobs}.")
        if self.address is not None and self.name not in CLUSTERS:
            raise ConfigError(
                f"--address: expected --backend dask or ray with it, found --backend {self.name}. "
                f"Name the kind of the cluster at {self.address}."
            )

    @contextmanager
    def active(self) -> Iterator[None]:
        """Context in which `run_tasks` sends its tasks to this backend.

        Raises:
            MissingExtraError: the package of the cluster is not installed.
            ConfigError: no cluster answers at the address.
        """
        import joblib

        if self.name in CLUSTERS:
            require_packages(self.name, (CLUSTERS[self.name],), f"--backend {self.name}")
        try:
            cluster = self._connect()
        except (OSError, RuntimeError, ValueError) as error:
            raise ConfigError(
                f"--address {self.address}: expected a {self.name} cluster to answer, found "
                f"none ({error}). Start it, or name another HOST:PORT."
            ) from error
        # The workers of Dask limit the number of tasks.
        jobs = -1 if self.name == "dask" else self.jobs
        with cluster, joblib.parallel_config(self.name, n_jobs=jobs):
            yield

    def _connect(self) -> Any:
        own_size = None if self.address or self.jobs == -1 else self.jobs
        if self.name == "dask":
            from distributed import Client

            if self.address is not None:
                return Client(self.address, timeout=CONNECT_S)
            # One thread per process: two trainings would share torch's random numbers.
            return Client(n_workers=own_size, threads_per_worker=1, dashboard_address="127.0.0.1:0")
        if self.name == "ray":
            import joblib
            import ray
            from ray.util.joblib.ray_backend import RayBackend

            # Ray's backend can return each result when it is ready, but does not declare it.
            streaming = type("Streaming", (RayBackend,), {"supports_return_generator": True})
            joblib.register_parallel_backend("ray", streaming)
            # "local" starts a new cluster, also if another one runs on this machine.
            return ray.init(self.address or "local", num_cpus=own_size, log_to_driver=False)
        return nullcontext()
