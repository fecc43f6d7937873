"""Tasks give the same results with every number of workers."""

import joblib
import pytest
from worker_tasks import die, fail, square

from offline.data.generate import WorkersLostError, run_tasks

NUMBERS = [(number,) for number in range(20)]
SQUARES = {number: number * number for (number,) in NUMBERS}


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_gives_its_result_with_its_index(jobs):
    assert dict(run_tasks(square, NUMBERS, jobs)) == SQUARES


def test_backend_of_joblib_is_used_without_a_number_of_processes():
    with joblib.parallel_config("threading", n_jobs=2):
        assert dict(run_tasks(square, NUMBERS)) == SQUARES


def test_error_of_a_task_is_raised_with_its_text():
    with pytest.raises(ValueError, match="is too much"):
        list(run_tasks(fail, NUMBERS, 2))


def test_killed_worker_ends_with_an_error_that_names_lack_of_memory():
    with pytest.raises(WorkersLostError, match="Look for lack of memory"):
        list(run_tasks(die, NUMBERS, 2))
