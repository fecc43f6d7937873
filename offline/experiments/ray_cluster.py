"""Ray workers for joblib. Imported only with `--backend ray`."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import joblib

from offline.experiments.backend import unreachable

# Ray sends statistics of its use unless told otherwise before it is imported.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")

import ray
from ray.util.joblib.ray_backend import RayBackend

HEALTH_CHECK_S = 15.0
"""most of it is the start of Ray's own command"""


class RayStreamingBackend(RayBackend):  # type: ignore[misc]
    """Ray's backend, which can return each result when it is ready but does not declare it."""

    supports_return_generator = True


@contextmanager
def workers(address: str | None, jobs: int) -> Iterator[None]:
    """Context in which joblib uses this cluster or a new one; `ConfigError` if none answers."""
    joblib.register_parallel_backend("ray", RayStreamingBackend)
    cores = None if address or jobs == -1 else jobs
    try:
        if address:
            _require_head(address)
        # "local" starts a new cluster, also if another one runs on this machine.
        ray.init(address or "local", num_cpus=cores, log_to_driver=False, logging_level="ERROR")
    except (OSError, RuntimeError, ValueError, subprocess.SubprocessError) as error:
        raise unreachable(address or "local", "a Ray cluster", error) from error
    try:
        with joblib.parallel_config("ray", n_jobs=-1 if address else jobs):
            yield
    finally:
        ray.shutdown()


def _require_head(address: str) -> None:
    """Raise if no head answers; a process of its own, since Ray's client blocks for a minute."""
    command = [sys.executable, "-m", "ray.scripts.scripts", "health-check", "--address", address]
    subprocess.run(command, capture_output=True, timeout=HEALTH_CHECK_S, check=True)
