"""A Dask cluster of real processes on the loopback interface; tests may kill any of them."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

RIGS = Path(__file__).parent
START_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True)
class DaskCluster:
    """A scheduler and its workers. No nanny restarts a worker."""

    address: str
    """HOST:PORT"""
    scheduler: subprocess.Popen[bytes]
    workers: tuple[subprocess.Popen[bytes], ...]


@contextmanager
def dask_cluster(
    folder: Path, workers: int = 2, first_on_path: Path = RIGS
) -> Iterator[DaskCluster]:
    """A cluster that writes its logs to `folder`."""
    file = folder / "scheduler.json"
    path = (str(first_on_path), str(RIGS), os.environ.get("PYTHONPATH", ""))
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, path))}
    started: list[subprocess.Popen[bytes]] = []

    def start(command: str, *arguments: str) -> subprocess.Popen[bytes]:
        line = [sys.executable, "-m", f"distributed.cli.dask_{command}", *arguments]
        line += ["--scheduler-file", str(file), "--host", "127.0.0.1", "--no-dashboard"]
        with (folder / f"{command}-{len(started)}.log").open("wb") as log:
            process = subprocess.Popen(
                line, stdout=log, stderr=subprocess.STDOUT, env=env, cwd=folder
            )
        started.append(process)
        return process

    try:
        scheduler = start("scheduler", "--port", "0")
        options = ("--nthreads", "1", "--no-nanny", "--local-directory", str(folder))
        processes = tuple(start("worker", *options) for _ in range(workers))
        yield DaskCluster(_address(file, scheduler, workers), scheduler, processes)
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


def _address(file: Path, scheduler: subprocess.Popen[bytes], workers: int) -> str:
    """HOST:PORT of the scheduler, when all its workers are connected."""
    from distributed import Client

    deadline_s = time.monotonic() + START_TIMEOUT_S
    while not file.exists() or not file.stat().st_size:
        if scheduler.poll() is not None or time.monotonic() > deadline_s:
            raise RuntimeError(f"no scheduler started, see {file.parent}")
        time.sleep(0.05)
    with Client(scheduler_file=str(file), set_as_default=False) as client:
        if workers:
            client.wait_for_workers(workers, timeout=START_TIMEOUT_S)
        return str(client.scheduler.address).removeprefix("tcp://")
