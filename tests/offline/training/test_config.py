"""Explicit settings and presets of the training configuration."""

import pytest

from offline.config import PAST_STEPS, PRESETS, STEPS, TrainingConfig, resolve
from rt_controller.contract.errors import ConfigError


def test_the_default_is_the_preset_recommended():
    recommended = PRESETS["recommended"]
    assert resolve(None) == TrainingConfig() == recommended
    assert resolve(TrainingConfig(steps=7)) == recommended.model_copy(update={"steps": 7})


def test_every_preset_contains_its_own_name():
    assert all(config.preset == name for name, config in PRESETS.items())


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_passes_the_validation_of_its_fields(name):
    written = PRESETS[name].model_dump(mode="json")
    assert TrainingConfig.model_validate(written) == PRESETS[name]


def test_an_explicit_setting_overrides_the_preset():
    resolved = resolve(TrainingConfig(preset="quick", steps=7, seed=0))
    assert (resolved.steps, resolved.seed) == (7, 0)
    assert resolved.evaluate_every == PRESETS["quick"].evaluate_every


def test_an_explicit_setting_equal_to_the_default_overrides_the_preset():
    default = TrainingConfig().steps
    assert default != PRESETS["quick"].steps
    assert resolve(TrainingConfig(preset="quick", steps=default)).steps == default


def test_an_unknown_preset_is_refused_with_the_list_of_presets():
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
        {"stability": "projection"},
        {"bilinear_rank": -1},
        {"path_rank": -1},
        {"drift_rank": -1},
        {"path_latents": -1},
        {"path_hidden": (0,)},
        {"typo": 1},
    ],
)
def test_a_setting_out_of_range_is_refused(wrong):
    (name,) = wrong
    with pytest.raises(ConfigError, match=rf"TrainingConfig\.{name}[:[]"):
        TrainingConfig(**wrong)


def test_the_preset_linear_is_recommended_without_the_bilinear_part_and_the_drift():
    recommended = PRESETS["recommended"]
    assert recommended.bilinear_rank > 0
    changes = {"preset": "linear", "bilinear_rank": 0, "path_rank": 0, "drift_rank": 0}
    assert PRESETS["linear"] == recommended.model_copy(update=changes)


@pytest.mark.parametrize("name", ["paper", "paper-literal"])
def test_the_presets_of_the_paper_use_no_extension(name):
    config = PRESETS[name]
    assert (config.windows, config.mirror, config.objective) == ("slices", False, "paper")
    assert (config.lift_exogenous, config.history_steps, config.bilinear_rank) == (False, 0, 0)
    assert (config.rate_schedule, config.activation) == ("plateau", "relu")
    assert config.latents_start == "identity"
    assert (config.separate_motion, config.saturating_gains, config.drift_rank) == (False, False, 0)


def test_the_preset_quick_shares_no_episode_with_the_full_data_set():
    """Data sets of different seeds share no episode."""
    assert PRESETS["quick"].data_seed != PRESETS["paper"].data_seed
    assert PRESETS["recommended"].data_seed == PRESETS["paper"].data_seed
