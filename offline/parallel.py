"""Many independent tasks: sent to wherever joblib is configured to run them, redone if lost.

A task is the arguments of a function and nothing else. It may run in any process, on any machine,
more than once if a worker dies; so it returns the same each time, or keeps its work in a folder
and finds it there.
"""

import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

import joblib
from joblib.parallel import get_active_backend

from offline.code_identity import describe_code
from rt_controller.contract.errors import ConfigError, RtControllerError

Result = TypeVar("Result")

MOST_LOSSES = 3
"""workers lost in a row without one finished task in between: then it is the task that kills"""


class WorkersLostError(RtControllerError):
    """Workers died again and again, or the cluster is gone."""


def in_order(
    function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], jobs: int | None = None
) -> Iterator[Result]:
    """What the function makes of each task, in the tasks' order, as soon as it is known.

    Raises:
        WorkersLostError, ConfigError: as `as_done`.
    """
    early: dict[int, Result] = {}
    due = 0
    for number, result in as_done(function, tasks, jobs):
        early[number] = result
        while due in early:
            yield early.pop(due)
            due += 1


def as_done(
    function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], jobs: int | None = None
) -> Iterator[tuple[int, Result]]:
    """Number of each task and what the function makes of it, in the order in which they finish.

    `jobs` processes work on them; None leaves the number, and where they run, to the active
    `offline.backend.Backend`. A task whose worker dies is done again by another.

    Raises:
        WorkersLostError: no task was finished between several deaths of workers.
        ConfigError: a worker runs another version of the program.
    """
    missing = dict(enumerate(tasks))
    losses = 0
    while missing:
        try:
            for number, result in _as_completed(function, missing, jobs):
                losses = 0
                del missing[number]
                yield number, result
        except _deaths() as error:
            losses += 1
            if losses >= MOST_LOSSES or not _starts_new_workers(error):
                raise WorkersLostError(
                    f"expected workers to finish {len(tasks)} tasks, found that they died with "
                    f"{len(missing)} left ({_first_line(error)}). Look for lack of memory, or for "
                    f"what the workers wrote last, and run the command again."
                ) from error


def _as_completed(
    function: Callable[..., Result], tasks: dict[int, tuple[Any, ...]], jobs: int | None
) -> Iterator[tuple[int, Result]]:
    """Number and result of each task, in any order; all at once where joblib cannot do better."""
    backend, _ = get_active_backend()
    streams = bool(backend.supports_return_generator)
    # One task a message: a worker that dies takes no finished task with it.
    parallel = joblib.Parallel(
        n_jobs=jobs, batch_size=1, return_as="generator_unordered" if streams else "list"
    )
    # Processes of this machine run what lies on its disk; those of a cluster may be installed.
    home = describe_code() if getattr(backend, "may_run_other_code", False) else None
    # Arguments travel as a tuple. Large ones on their own would be kept by one worker of a Dask
    # cluster on behalf of all, and would die with it.
    done: Iterator[tuple[int, Result]] = iter(
        parallel(
            joblib.delayed(_run)(function, number, arguments, home)
            for number, arguments in list(tasks.items())
        )
    )
    return done


def _run(
    function: Callable[..., Result], number: int, arguments: tuple[Any, ...], home: str | None
) -> tuple[int, Result]:
    """In the worker."""
    if home is not None and (here := describe_code()) != home:
        raise ConfigError(
            f"expected workers that run {home}, found one on {socket.gethostname()} that runs "
            f"{here}. Install the same version on every worker, and start them again."
        )
    return number, function(*arguments)


def _deaths() -> tuple[type[BaseException], ...]:
    """What the loaded backends raise when a worker, or all of them, died."""
    kinds: list[type[BaseException]] = [BrokenProcessPool]
    if "distributed" in sys.modules:
        from distributed.client import FutureCancelledError
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker

        kinds += [KilledWorker, CommClosedError, FutureCancelledError]
    if "ray" in sys.modules:
        from ray.exceptions import RayActorError

        kinds.append(RayActorError)
    return tuple(kinds)


def _starts_new_workers(error: BaseException) -> bool:
    """Whether trying again may help; Dask has done all it can before it raises."""
    return not type(error).__module__.startswith("distributed")


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
