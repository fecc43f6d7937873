"""A Dask cluster as a place for tasks. Loaded only where Dask is asked for."""

import asyncio
import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from typing import Any

import joblib
from distributed import Client, LocalCluster, rpc
from joblib._dask import DaskDistributedBackend

from offline import address as address_of
from offline.address import UnreachableError, require_listener, unreachable

FIRST_WORKER_S = 10.0

DEAF_TO_CTRL_C = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
"""what workers of one's own run first: a terminal interrupts them too, and nobody would be left to
end a task where nothing is lost"""


class DaskBackend(DaskDistributedBackend):  # type: ignore[misc]
    """joblib's, without two of its habits.

    It does not say so when a task failed for good, and would be waited for; and joblib does the
    work itself where a cluster has one core only.
    """

    may_run_other_code = True

    def effective_n_jobs(self, n_jobs: int) -> int:
        return max(2, int(super().effective_n_jobs(n_jobs)))

    def submit(self, func: Any, callback: Callable[[Any], None]) -> "Future[Any]":
        outcome: Future[Any] = super().submit(func, callback)

        def report(done: "Future[Any]") -> None:
            error = done.exception()
            if error is not None:
                callback(error)

        outcome.add_done_callback(report)
        return outcome


@contextmanager
def dask_tasks(address: str | None, jobs: int) -> Iterator[None]:
    """Within it joblib sends its tasks to the cluster there, or to one made now.

    Raises:
        UnreachableError: no scheduler answers, or it has no workers.
    """
    joblib.register_parallel_backend("dask", DaskBackend)
    with (
        _own_client(jobs) if address is None else _client_at(address) as client,
        joblib.parallel_config("dask", client=client),
    ):
        yield


@contextmanager
def _own_client(jobs: int) -> Iterator[Client]:
    workers = os.cpu_count() if jobs == -1 else jobs
    # One thread a process: two trainings in one process would share torch's dice.
    cluster = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        preload=DEAF_TO_CTRL_C,
        silence_logs=logging.ERROR,
    )
    try:
        with Client(cluster, set_as_default=False) as client:
            yield client
    finally:
        # It has nothing to lose any more: on a busy machine it may be slow to go, and is killed.
        with suppress(TimeoutError):
            cluster.close()


@contextmanager
def _client_at(address: str) -> Iterator[Client]:
    require_listener(address)
    url = address if "://" in address else f"tcp://{address}"
    try:
        # The client itself would wait for ever for whoever listens and is no scheduler.
        asyncio.run(asyncio.wait_for(_identity(url), address_of.CONNECT_S))
    except (OSError, ValueError) as error:
        raise unreachable(address, "a Dask scheduler", error) from error
    with Client(url, timeout=address_of.CONNECT_S, set_as_default=False) as client:
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_S)
        except TimeoutError as error:
            raise UnreachableError(
                f"--address {address}: expected workers, found a scheduler without any for "
                f"{FIRST_WORKER_S:g} s. Start some: dask worker {url} --nthreads 1"
            ) from error
        yield client


async def _identity(url: str) -> object:
    async with rpc(url) as scheduler:
        return await scheduler.identity()
