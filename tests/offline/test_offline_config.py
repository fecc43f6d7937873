"""What a person may choose, and how choices and presets meet."""

import pytest
from pydantic import ValidationError

from offline.config import PRESETS, TrainingConfig, resolve
from offline.lengths import PAST_STEPS, STEPS
from rt_controller.contract.errors import ConfigError


def test_without_a_choice_the_preset_is_the_recommended_one():
    recommended = PRESETS["recommended"]
    assert resolve(None) == TrainingConfig() == recommended
    assert resolve(TrainingConfig(steps=7)) == recommended.model_copy(update={"steps": 7})


def test_a_preset_is_known_by_its_own_name():
    assert all(config.preset == name for name, config in PRESETS.items())


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_a_configuration_that_a_person_could_have_written(name):
    written = PRESETS[name].model_dump(mode="json")
    assert TrainingConfig.model_validate(written) == PRESETS[name]


def test_an_explicit_choice_goes_before_the_preset():
    resolved = resolve(TrainingConfig(preset="quick", steps=7, seed=0))
    assert (resolved.steps, resolved.seed) == (7, 0)
    assert resolved.evaluate_every == PRESETS["quick"].evaluate_every


def test_a_choice_that_equals_the_default_still_goes_before_the_preset():
    default = TrainingConfig().steps
    assert default != PRESETS["quick"].steps
    assert resolve(TrainingConfig(preset="quick", steps=default)).steps == default


def test_an_unknown_preset_is_refused_with_those_that_exist():
    with pytest.raises(ConfigError, match="recommended, linear, paper, paper-literal, quick"):
        resolve(TrainingConfig(preset="papre"))


@pytest.mark.parametrize(
    "wrong",
    [
        {"steps": 0},
        {"forgetting": 1.5},
        {"learning_rate": -1.0},
        {"operator_rate": 0.0},
        {"stability": "none"},
        {"windows": "some"},
        {"history_steps": -1},
        {"history_steps": PAST_STEPS + 1},
        {"horizon_start": 0},
        {"horizon_start": STEPS + 1},
        {"horizon_growth": 0.0},
        {"bilinear_rank": -1},
        {"typo": 1},
    ],
)
def test_a_setting_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValidationError):
        TrainingConfig(**wrong)


def test_linear_is_recommended_without_its_bilinear_part():
    recommended = PRESETS["recommended"]
    assert recommended.bilinear_rank > 0
    changes = {"preset": "linear", "bilinear_rank": 0}
    assert PRESETS["linear"] == recommended.model_copy(update=changes)


@pytest.mark.parametrize("name", ["paper", "paper-literal"])
def test_the_papers_presets_have_nothing_that_the_paper_has_not(name):
    config = PRESETS[name]
    assert (config.windows, config.mirror, config.objective) == ("slices", False, "paper")
    assert (config.lift_exogenous, config.history_steps, config.bilinear_rank) == (False, 0, 0)
    assert (config.rate_schedule, config.activation) == ("plateau", "relu")
    assert config.latents_start == "identity"


def test_a_quick_model_may_be_judged_on_the_full_data_set():
    """Another seed: none of its training episodes is a test episode there."""
    assert PRESETS["quick"].data_seed != PRESETS["paper"].data_seed
    assert PRESETS["recommended"].data_seed == PRESETS["paper"].data_seed
