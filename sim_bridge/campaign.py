"""Many independent tasks, on the cores of this machine or on a Dask or Ray cluster.

Data generation, ablations, the fault matrix and all other drives of the benchmarks run here.
Results may be kept in a file of JSON lines: the same command then goes on after an interruption.
"""

import json
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from hashlib import sha256
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from rt_controller.contract.errors import ConfigError, RtControllerError, require_packages

BackendName = Literal["loky", "dask", "ray"]
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
            help="where the work is done: processes of this machine, a Dask or a Ray cluster",
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
        """Context in which joblib sends its tasks to this backend.

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


THIS_MACHINE = Backend()
_BEGIN = b'{"made_with_sha256": '
"""of each line of a file of results"""


class WorkersLostError(RtControllerError):
    """A worker process died."""


def run_campaign(
    function: Callable[..., Any],
    tasks: Iterable[tuple[str, tuple[Any, ...]]],
    backend: Backend = THIS_MACHINE,
    file: Path | None = None,
    made_with: Mapping[str, Any] | None = None,
    in_order: bool = False,
) -> Generator[tuple[str, Any], None, None]:
    """Key and result of every task: all that the file has, then the others as they are finished.

    Args:
        function: gives a result, one that JSON can hold if there is a file.
        tasks: key and arguments of each; there may be no end of them.
        backend: where they run.
        file: gets a line for each result; None: nothing is kept.
        made_with: what all results depend on beside the arguments, such as the hash of a model.
        in_order: results in the order of the tasks, for callers that stop after some of them.

    Raises:
        ConfigError: the file has results that were made with something else.
        WorkersLostError: a worker process died.
    """
    import joblib

    # That tasks were cancelled is what a caller wants that stops, or Ctrl-C.
    warnings.filterwarnings("ignore", ".*have been cancelled", UserWarning)
    common = digest(made_with)
    earlier = _read_results(file, common)
    yield from earlier.items()
    # Arguments travel as one tuple: joblib would store large ones on a single Dask worker.
    calls = (
        joblib.delayed(_run)(function, key, arguments)
        for key, arguments in tasks
        if key not in earlier
    )
    order = "generator" if in_order else "generator_unordered"
    try:
        with backend.active():
            with _ctrl_c_deferred():
                results_of_workers = joblib.Parallel(batch_size=1, return_as=order)(calls)
            for key, result in results_of_workers:
                if file is not None:
                    line = {"made_with_sha256": common, "key": key, "result": result}
                    with file.open("a", encoding="utf-8") as results:
                        results.write(json.dumps(line) + "\n")
                yield key, result
    except BrokenProcessPool as error:
        raise WorkersLostError(
            f"expected workers to finish their tasks, found that one died ({error}). Look for lack "
            f"of memory, and run the command again: what is finished is kept."
        ) from error


@contextmanager
def _ctrl_c_deferred() -> Iterator[None]:
    """Ctrl-C waits for its end, and the processes that are started within it never receive it.

    A terminal sends Ctrl-C to all processes; this one ends the others.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    from joblib.externals.loky.backend import resource_tracker as loky_tracker

    # Started first: the start of a tracker unblocks Ctrl-C. It clears away what an end at once
    # leaves behind, and need not say so; it takes the options of this interpreter.
    sys.warnoptions.append("ignore")
    resource_tracker.ensure_running()
    loky_tracker.ensure_running()
    sys.warnoptions.remove("ignore")
    received = list[int]()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # others inherit it
    # Another thread of this process may still receive it.
    before = signal.signal(signal.SIGINT, lambda number, _: received.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if received:
            signal.raise_signal(signal.SIGINT)


def _run(function: Callable[..., Any], key: str, arguments: tuple[Any, ...]) -> tuple[str, Any]:
    return key, function(*arguments)


def digest(value: Any) -> str:
    """SHA-256 of a value that JSON can hold."""
    return sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def object_digest(value: Any) -> str:
    """Digest of objects of any types, the same in each process."""
    import joblib

    return str(joblib.hash(value))


def _read_results(file: Path | None, made_with_sha256: str) -> dict[str, Any]:
    if file is None or not file.exists():
        return {}
    content = file.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    rest = content[len(whole) :]
    try:
        lines = [json.loads(line) for line in whole.splitlines()]
        is_same = all(line["made_with_sha256"] == made_with_sha256 for line in lines)
        is_same &= rest.startswith(_BEGIN) or _BEGIN.startswith(rest)
    except (ValueError, KeyError, TypeError):
        is_same = False
    if not is_same:
        raise ConfigError(
            f"{file}: expected results of the same model and data, found others. Name another "
            f"file, or delete this one."
        )
    if rest:  # killed while it wrote
        os.truncate(file, len(whole))
    return {line["key"]: line["result"] for line in lines}
