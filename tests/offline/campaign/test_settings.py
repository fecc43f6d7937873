"""Settings that a campaign's trainings share, and the way back to a command line."""

import shlex
from pathlib import Path

import pytest

from offline.campaign.settings import explicit_fields, train_command
from offline.cli import train_app
from offline.config import PRESETS, TrainingConfig, resolve
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.follow import Follow


def test_each_training_has_one_thread_unless_more_are_asked_for():
    assert explicit_fields(None, {}) == {"threads": 1}
    assert explicit_fields(TrainingConfig(threads=3, steps=5), {}) == {"threads": 3, "steps": 5}


def test_an_option_that_is_given_otherwise_is_refused_with_the_other_way():
    with pytest.raises(ConfigError, match="--seed: expected --seeds in its place, found 3"):
        explicit_fields(TrainingConfig(seed=3), {"seed": "--seeds"})


@pytest.mark.parametrize(
    ("preset", "changes"),
    [
        ("recommended", {}),
        ("recommended", {"hidden": (64, 32), "mirror": False, "gradient_clip": None}),
        ("paper", {"mirror": True, "learning_rate": 0.00123456789012345, "windows": "all"}),
        ("recommended", {"weight_regularisation": 1e-7, "horizon_start": None, "seed": 4}),
        ("recommended", {"bilinear_follows": Follow.FREE_RESPONSE}),
    ],
)
def test_the_command_line_of_a_configuration_means_that_configuration(preset, changes):
    config = PRESETS[preset].model_copy(update=changes)
    command = train_command(config, PRESETS[preset], Path("/data/of mine"))
    program, *arguments = shlex.split(command)
    assert program == "offline-train"
    _, bound, _ = train_app.parse_args(arguments, exit_on_error=False)
    assert resolve(bound.arguments.get("config")) == config
    assert bound.arguments["data"] == Path("/data/of mine")
