"""Independent tasks, run by the active joblib backend; a task whose worker dies is run again.

A task is the arguments of a function. It may run in any process on any machine, and again if its
worker dies. The function therefore returns the same result every time, or continues from what it
saved in a folder.
"""

import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

import joblib

from offline.data.code_identity import describe_code
from rt_controller.contract.errors import ConfigError, RtControllerError

Result = TypeVar("Result")

MAX_LOSSES = 3
"""deaths of workers in a row, without a finished task between them, before the error is raised"""

_DEATHS = {
    "distributed.client": "FutureCancelledError",
    "distributed.comm": "CommClosedError",
    "distributed.scheduler": "KilledWorker",
    "ray.exceptions": "RayActorError",
}
"""by module: the exception that reports the death of a worker, or of the whole cluster"""


class WorkersLostError(RtControllerError):
    """Workers died repeatedly, or the connection to the cluster is lost."""


def run_tasks(
    function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], jobs: int | None = None
) -> Iterator[tuple[int, Result]]:
    """Index of each task and the result of the function for it, in the order of completion.

    Args:
        function: called as function(*task), in a worker.
        tasks: arguments of each call.
        jobs: number of processes; None: number and place follow from the active joblib backend.

    Raises:
        WorkersLostError: `MAX_LOSSES` deaths of workers without a finished task between them.
        ConfigError: a worker runs another version of the program.
    """
    missing = dict(enumerate(tasks))
    losses = 0
    code = describe_code()
    while missing:
        # One task per message, so that the death of a worker loses no finished task. Arguments
        # travel as one tuple: joblib would store large ones on a single Dask worker.
        parallel = joblib.Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        calls = [joblib.delayed(_run)(function, i, task, code) for i, task in missing.items()]
        try:
            for index, result in parallel(calls):
                losses = 0
                del missing[index]
                yield index, result
        except _deaths() as error:
            losses += 1
            # Dask has already run the task again on other workers before it raises.
            if losses >= MAX_LOSSES or type(error).__module__.startswith("distributed"):
                reason = (str(error).strip() or type(error).__name__).splitlines()[0]
                raise WorkersLostError(
                    f"expected workers to finish {len(tasks)} tasks, found that they died with "
                    f"{len(missing)} left ({reason}). Look for lack of memory and at the last "
                    f"output of the workers, and run the command again."
                ) from error


def _run(
    function: Callable[..., Result], index: int, task: tuple[Any, ...], expected_code: str
) -> tuple[int, Result]:
    """Runs in the worker."""
    if (code := describe_code()) != expected_code:
        raise ConfigError(
            f"expected workers that run {expected_code}, found one on {socket.gethostname()} that "
            f"runs {code}. Install the same version on every worker, and start them again."
        )
    return index, function(*task)


def _deaths() -> tuple[type[BaseException], ...]:
    """Exceptions by which the imported backends report that workers died."""
    loaded = (getattr(sys.modules[at], name) for at, name in _DEATHS.items() if at in sys.modules)
    return (BrokenProcessPool, *loaded)
