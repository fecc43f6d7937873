"""Small lists of variants, and the commands on the toy data set."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from offline.experiments.backend import Backend
from offline.experiments.training_task import CampaignData, measure_linear_model

_COMMON = """
why = "small enough for a test"
base = "recommended"
[{name}.common]
steps = 12
batch = 8
hidden = [8]
latents = 4
stability = "gelfand"
"""
_TINY, _WILD = "[tiny]" + _COMMON.format(name="tiny"), "[wild]" + _COMMON.format(name="wild")

LISTS = f"""
{_TINY}
evaluate_every = 5
history_steps = 3
[[tiny.variant]]
name = "whole"
why = "nothing left out"
[[tiny.variant]]
name = "without-bilinear"
why = "a constant B"
changes = {{ bilinear_rank = 0 }}

{_WILD}
evaluate_every = 5
[[wild.variant]]
name = "too-fast"
why = "a learning rate that diverges"
changes = {{ learning_rate = 1e30, gradient_clip = "none" }}
[[wild.variant]]
name = "sane"
why = "the usual learning rate"
"""


@pytest.fixture(scope="session", autouse=True)
def empty_cache(tmp_path_factory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
        yield


@pytest.fixture(scope="session")
def lists(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("lists") / "lists.toml"
    file.write_text(LISTS)
    return file


@pytest.fixture(scope="session")
def shared(toy_folder, toy_dataset, empty_cache) -> CampaignData:
    """The toy data set and its linear model, as all trainings of a command share them."""
    return measure_linear_model(toy_folder, toy_dataset)


@pytest.fixture(scope="session")
def one_process() -> Backend:
    return Backend(jobs=1)
