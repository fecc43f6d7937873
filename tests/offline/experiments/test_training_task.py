"""The result of a training is read as it was written; others are refused."""

from dataclasses import asdict, replace
from datetime import datetime

import pytest
from filelock import FileLock
from tiny_comparison import tiny_trainings

from offline.experiments.training_task import (
    LOCK_FILE,
    RESULT_FILE,
    Result,
    exclusive_folder,
    load_result,
)
from offline.files import write_json
from offline.training.run import create_run
from rt_controller.contract.errors import ConfigError


@pytest.fixture
def training(tmp_path, lists, shared):
    """A training whose run folder exists."""
    config = tiny_trainings(lists)[0].config
    create_run(tmp_path, config, shared.folder, shared.sha256, datetime.now())
    return tmp_path, config, shared


@pytest.mark.parametrize(
    "result",
    [
        Result("finished", 12, 3.5, "", {"vx_mps": 2.0, "ey_m": 0.0}, 0.0, 1.0, 99),
        Result("refused", 12, 3.5, "it grows", None, None, 1.2, 99),
        Result("diverged", 3, 0.5, "not finite"),
    ],
)
def test_result_is_read_as_it_was_written(training, result):
    assert load_result(*training) is None
    write_json(training[0] / RESULT_FILE, asdict(result))
    assert load_result(*training) == result


@pytest.mark.parametrize(
    "text",
    [
        "",
        "3",
        "{}",
        '{"ending": "pruned", "step": 3, "training_cpu_s": 1.0, "more": 1}',
        '{"mse_ratio": null, "ending": "finished"}',
    ],
)
def test_other_content_is_refused_with_the_remedy(training, text):
    (training[0] / RESULT_FILE).write_text(text)
    with pytest.raises(ConfigError, match="Delete it, and train again"):
        load_result(*training)


def test_result_of_other_data_is_refused(training):
    write_json(training[0] / RESULT_FILE, asdict(Result("diverged", 3, 0.5)))
    folder, config, data = training
    with pytest.raises(ConfigError, match=r"differs in data set\. Choose another --folder"):
        load_result(folder, config, replace(data, sha256="0" * 64))


def test_folder_of_a_running_command_is_refused(tmp_path):
    with (
        FileLock(tmp_path / LOCK_FILE),
        pytest.raises(ConfigError, match="found: another command in it"),
        exclusive_folder(tmp_path),
    ):
        pytest.fail("two commands in one folder")


def test_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(ConfigError, match=r"writable folder.*Not a directory"),
        exclusive_folder(tmp_path / "file" / "folder"),
    ):
        pytest.fail("a folder in a file")
