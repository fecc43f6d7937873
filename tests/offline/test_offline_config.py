"""What a person may choose, and how choices and presets meet."""

import pytest
from pydantic import ValidationError

from offline.config import PRESETS, TrainingConfig, resolve
from rt_controller.contract.errors import ConfigError


def test_without_a_choice_the_preset_is_the_papers():
    assert resolve(None) == PRESETS["paper"]


def test_a_preset_is_known_by_its_own_name():
    assert all(config.preset == name for name, config in PRESETS.items())


def test_an_explicit_choice_goes_before_the_preset():
    resolved = resolve(TrainingConfig(preset="quick", steps=7, seed=0))
    assert (resolved.steps, resolved.seed) == (7, 0)
    assert resolved.target_samples == PRESETS["quick"].target_samples


def test_a_choice_that_equals_the_default_still_goes_before_the_preset():
    assert resolve(TrainingConfig(preset="quick", steps=60_000)).steps == 60_000


def test_an_unknown_preset_is_refused_with_those_that_exist():
    with pytest.raises(ConfigError, match="paper, paper-literal, quick"):
        resolve(TrainingConfig(preset="papre"))


@pytest.mark.parametrize(
    "wrong",
    [
        {"steps": 0},
        {"forgetting": 1.5},
        {"learning_rate": -1.0},
        {"stability": "none"},
        {"typo": 1},
    ],
)
def test_a_setting_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValidationError):
        TrainingConfig(**wrong)


def test_a_quick_model_may_be_judged_on_the_full_data_set():
    """Another seed: none of its training episodes is a test episode there."""
    assert PRESETS["quick"].data_seed != PRESETS["paper"].data_seed
