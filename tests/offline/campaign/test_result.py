"""How a training ended is read as it was written, and nothing else is taken for it."""

import pytest

from offline.campaign.result import FILE, Result, keep_result, read_result
from offline.campaign.score import Score
from rt_controller.contract.errors import ArtifactError


@pytest.mark.parametrize(
    "result",
    [
        Result("finished", 12, 3.5, "", Score((2.0, 0.0), 0.0), 1.0, 99),
        Result("refused", 12, 3.5, "it grows", None, 1.2, 99),
        Result("diverged", 3, 0.5, "no number"),
    ],
)
def test_a_result_is_read_as_it_was_written(tmp_path, result):
    keep_result(tmp_path, result)
    assert read_result(tmp_path) == result
    assert [file.name for file in tmp_path.iterdir()] == [FILE]


def test_a_training_that_has_not_ended_has_no_result(tmp_path):
    assert read_result(tmp_path) is None


@pytest.mark.parametrize("text", ["", "3", "{}", '{"score": null, "ending": "finished"}'])
def test_another_file_of_that_name_is_refused_with_the_way_on(tmp_path, text):
    (tmp_path / FILE).write_text(text)
    with pytest.raises(ArtifactError, match="Delete it; the training goes on"):
        read_result(tmp_path)
