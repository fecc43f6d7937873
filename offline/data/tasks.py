"""Independent tasks, run by the active joblib backend."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

import joblib

from rt_controller.contract.errors import RtControllerError

Result = TypeVar("Result")


class WorkersLostError(RtControllerError):
    """A worker process died."""


def run_tasks(
    function: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], jobs: int | None = None
) -> Iterator[tuple[int, Result]]:
    """Index of each task and the result of function(*task), in the order of completion.

    Number and place of the workers follow from the active joblib backend if `jobs` is None.

    Raises:
        WorkersLostError: a worker process died.
    """
    parallel = joblib.Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
    # Arguments travel as one tuple: joblib would store large ones on a single Dask worker.
    calls = (joblib.delayed(_run)(function, index, task) for index, task in enumerate(tasks))
    try:
        yield from parallel(calls)
    except BrokenProcessPool as error:
        raise WorkersLostError(
            f"expected workers to finish {len(tasks)} tasks, found that one died ({error}). Look "
            f"for lack of memory, and run the command again: what is finished is kept."
        ) from error


def _run(function: Callable[..., Result], index: int, task: tuple[Any, ...]) -> tuple[int, Result]:
    return index, function(*task)
