"""Settings that all trainings of a command share, and the command line of a configuration."""

import shlex
from pathlib import Path

import pytest

from offline.cli import train_app
from offline.config import PRESETS, TrainingConfig, resolve
from offline.experiments.settings import common_fields, train_command
from rt_controller.contract.errors import ConfigError
from rt_controller.model.follow import Follow


def test_each_training_has_one_thread_unless_an_option_says_more():
    assert common_fields(None, {}) == {"threads": 1}
    assert common_fields(TrainingConfig(threads=3, steps=5), {}) == {"threads": 3, "steps": 5}


def test_option_that_this_command_does_not_have_is_refused_with_its_replacement():
    with pytest.raises(ConfigError, match="--seed: expected --seeds in its place, found 3"):
        common_fields(TrainingConfig(seed=3), {"seed": "--seeds"})


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
def test_command_line_of_a_configuration_gives_that_configuration(preset, changes):
    config = PRESETS[preset].model_copy(update=changes)
    program, *arguments = shlex.split(train_command(config, Path("/data/of mine")))
    assert program == "offline-train"
    _, bound, _ = train_app.parse_args(arguments, exit_on_error=False)
    assert resolve(bound.arguments.get("config")) == config
    assert bound.arguments["data"] == Path("/data/of mine")
