"""The result of a training is read as it was written; other files are refused."""

from dataclasses import asdict

import pytest

from offline.experiments.error_ratios import ErrorRatios
from offline.experiments.training_task import RESULT_FILE, Result, load_result
from offline.files import write_json
from rt_controller.contract.errors import ArtifactError


@pytest.mark.parametrize(
    "result",
    [
        Result("finished", 12, 3.5, "", ErrorRatios((2.0, 0.0), 0.0), 1.0, 99),
        Result("refused", 12, 3.5, "it grows", None, 1.2, 99),
        Result("diverged", 3, 0.5, "not finite"),
    ],
)
def test_result_is_read_as_it_was_written(tmp_path, result):
    write_json(tmp_path / RESULT_FILE, asdict(result))
    assert load_result(tmp_path) == result
    assert [file.name for file in tmp_path.iterdir()] == [RESULT_FILE]


def test_training_that_has_not_ended_has_no_result(tmp_path):
    assert load_result(tmp_path) is None


@pytest.mark.parametrize("text", ["", "3", "{}", '{"ratios": null, "ending": "finished"}'])
def test_other_content_is_refused_with_the_remedy(tmp_path, text):
    (tmp_path / RESULT_FILE).write_text(text)
    with pytest.raises(ArtifactError, match="Delete it; the training continues"):
        load_result(tmp_path)
