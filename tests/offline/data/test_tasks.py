"""Tasks give the same results with every number of workers, also when a worker dies."""

import joblib
import pytest
from worker_tasks import fail, square, square_or_die

from offline.data import tasks as tasks_module
from offline.data.tasks import WorkersLostError, run_tasks
from rt_controller.contract.errors import ConfigError

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


def test_task_of_a_killed_process_is_run_again(tmp_path):
    (tmp_path / "die-3").touch()
    assert dict(run_tasks(square_or_die, [(n, tmp_path) for n in SQUARES], 2)) == SQUARES
    assert not (tmp_path / "die-3").exists()


def test_task_that_kills_every_worker_ends_with_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(tasks_module, "MAX_LOSSES", 1)
    (tmp_path / "die-1").mkdir()
    with pytest.raises(WorkersLostError, match="Look for lack of memory"):
        list(run_tasks(square_or_die, [(n, tmp_path) for n in SQUARES], 2))


def test_worker_of_another_version_of_the_program_is_refused(monkeypatch):
    versions = iter(("source a", "source b"))
    monkeypatch.setattr(tasks_module, "describe_code", lambda: next(versions))
    with pytest.raises(ConfigError, match=r"source a.*source b.*Install the same version"):
        list(run_tasks(square, NUMBERS, 1))
