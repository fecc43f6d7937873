"""A Ray cluster as a place for tasks. Loaded only where Ray is asked for."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import joblib

from offline.address import require_listener, unreachable

# Ray reports its use to its makers unless told otherwise before it is loaded.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")

import ray
from ray.util.joblib.ray_backend import RayBackend

HEALTH_S = 15.0
"""most of it for starting Ray's own command"""


class StreamingRayBackend(RayBackend):  # type: ignore[misc]
    """joblib's for Ray, which can hand results over as they come and does not say so."""

    may_run_other_code = True
    supports_return_generator = True


@contextmanager
def ray_tasks(address: str | None, jobs: int) -> Iterator[None]:
    """Within it joblib sends its tasks to the cluster there, or to one made now.

    Raises:
        UnreachableError: no cluster answers.
    """
    if address is not None:
        require_listener(address)
        _require_head(address)
    joblib.register_parallel_backend("ray", StreamingRayBackend)
    cores = None if address or jobs == -1 else jobs
    try:
        # "local" is a cluster of one's own; nothing at all may be that of somebody else.
        ray.init(address or "local", num_cpus=cores, log_to_driver=False, logging_level="ERROR")
    except (OSError, RuntimeError, ValueError) as error:
        raise unreachable(address or "local", "a Ray cluster", error) from error
    try:
        with joblib.parallel_config("ray", n_jobs=-1 if address else jobs):
            yield
    finally:
        ray.shutdown()


def _require_head(address: str) -> None:
    """Asked in a process of its own: Ray's client tries for a minute and cannot be interrupted."""
    command = [sys.executable, "-m", "ray.scripts.scripts", "health-check", "--address", address]
    try:
        answer = subprocess.run(
            command, capture_output=True, text=True, timeout=HEALTH_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise unreachable(address, "the head of a Ray cluster", "no answer") from error
    if answer.returncode:
        last = (answer.stderr.strip().splitlines() or ["no answer"])[-1]
        raise unreachable(address, "the head of a Ray cluster", last)
