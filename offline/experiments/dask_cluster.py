"""Dask workers for joblib. Imported only with `--backend dask`."""

import asyncio
import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

import joblib
from distributed import Client, rpc
from joblib._dask import DaskDistributedBackend

from offline.experiments import backend
from offline.experiments.backend import unreachable
from rt_controller.contract.errors import ConfigError

FIRST_WORKER_S = 10.0

IGNORE_CTRL_C = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
"""a terminal also interrupts the local workers; they must live to save their checkpoints"""


class DaskBackend(DaskDistributedBackend):  # type: ignore[misc]
    """joblib's backend, corrected in two points.

    joblib waits forever for a task that Dask has given up, and runs all tasks in the calling
    process if the cluster has a single core.
    """

    def effective_n_jobs(self, n_jobs: int) -> int:
        return max(2, int(super().effective_n_jobs(n_jobs)))

    def submit(self, func: Any, callback: Callable[[Any], None]) -> "Future[Any]":
        result: Future[Any] = super().submit(func, callback)

        def report_error(done: "Future[Any]") -> None:
            if (error := done.exception()) is not None:
                callback(error)

        result.add_done_callback(report_error)
        return result


@contextmanager
def workers(address: str | None, jobs: int) -> Iterator[None]:
    """Context in which joblib uses this or a new cluster; `ConfigError` if no worker answers."""
    joblib.register_parallel_backend("dask", DaskBackend)
    with (
        _new_cluster(jobs) if address is None else _connect(address) as client,
        joblib.parallel_config("dask", client=client),
    ):
        yield


def _new_cluster(jobs: int) -> Client:
    # One thread per process: two trainings in one process would share torch's random numbers.
    return Client(
        n_workers=os.cpu_count() if jobs == -1 else jobs,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        preload=IGNORE_CTRL_C,
        silence_logs=logging.ERROR,
        set_as_default=False,
    )


def _connect(address: str) -> Client:
    url = address if "://" in address else f"tcp://{address}"
    try:
        # The client would wait forever for a server that is no scheduler.
        asyncio.run(asyncio.wait_for(_identity(url), backend.CONNECT_S))
    except (OSError, ValueError) as error:
        raise unreachable(address, "a Dask scheduler", error) from error
    client = Client(url, timeout=backend.CONNECT_S, set_as_default=False)
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER_S)
    except TimeoutError as error:
        client.close()
        raise ConfigError(
            f"--address {address}: expected workers, found a scheduler without any for "
            f"{FIRST_WORKER_S:g} s. Start some: dask worker {url} --nthreads 1"
        ) from error
    return client


async def _identity(url: str) -> object:
    async with rpc(url) as scheduler:
        return await scheduler.identity()
