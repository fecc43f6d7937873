"""Settings of the program that only a new process shows."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

COUNT_THREADS = "import rt_controller.cli, numpy, os; print(len(os.listdir('/proc/self/task')))"


def threads_after_import(blas_threads: str | None) -> int:
    chosen = {} if blas_threads is None else {"OPENBLAS_NUM_THREADS": blas_threads}
    inherited = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    environment = {**inherited, "OMP_NUM_THREADS": "2", **chosen}
    command = [sys.executable, "-c", COUNT_THREADS]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted on Linux")
def test_linear_algebra_runs_in_one_thread_unless_the_user_sets_more() -> None:
    single = threads_after_import("1")
    assert threads_after_import(None) == single
    if len(os.sched_getaffinity(0)) > 1:
        assert threads_after_import("2") > single
