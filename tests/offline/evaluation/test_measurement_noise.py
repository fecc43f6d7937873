"""Noise on what a model hears."""

import numpy as np
import pytest
from toy_predictors import made_test_set, made_trajectories

from offline.data.signals import VEHICLE_ROLES, Roles, past_names
from offline.evaluation.test_sets import (
    DEFAULT_LEVELS,
    STANDARD_DEVIATIONS,
    choose_levels,
    noisy_set,
)
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.schema import VEHICLE, Schema, Signal

LIBRARY = made_test_set(made_trajectories(4_000))
HEARD = past_names(VEHICLE, VEHICLE_ROLES)


def differences(level):
    """What the noise adds to the first states (N, 6) and the past (N, H, 6)."""
    found = noisy_set(LIBRARY, level, VEHICLE, VEHICLE_ROLES).trajectories
    clean = LIBRARY.trajectories
    return (found.x - clean.x)[:, 0].astype(float), (found.past - clean.past).astype(float)


def test_only_the_first_state_and_the_past_have_noise():
    found, clean = noisy_set(LIBRARY, 1.0, VEHICLE, VEHICLE_ROLES), LIBRARY
    assert found.name == "noise-1"
    assert np.array_equal(found.trajectories.x[:, 1:], clean.trajectories.x[:, 1:])
    is_equal = found.trajectories.x[:, 0] == clean.trajectories.x[:, 0]
    assert is_equal.mean() < 0.01  # a small draw may be lost in single precision
    for name in ("u", "w", "episode"):
        assert np.array_equal(getattr(found.trajectories, name), getattr(clean.trajectories, name))


def test_the_noise_has_the_stated_standard_deviations():
    at_start, before = differences(1.0)
    for name, expected in STANDARD_DEVIATIONS.items():
        column = VEHICLE.state_names.index(name)
        assert at_start[:, column].std() == pytest.approx(expected, rel=0.05)
        assert abs(at_start[:, column].mean()) < 0.1 * expected
        if name in HEARD:
            assert before[..., HEARD.index(name)].std() == pytest.approx(expected, rel=0.02)


def test_inputs_of_the_past_have_no_noise():
    _, before = differences(3.0)
    for name in set(HEARD) & set(VEHICLE.input_names):
        assert np.all(before[..., HEARD.index(name)] == 0.0)


def test_progress_is_that_of_the_noisy_speed():
    at_start, _ = differences(1.0)
    speed, progress = (VEHICLE.state_names.index(name) for name in ("vx_mps", "ds_m"))
    assert np.allclose(at_start[:, progress], VEHICLE.dt_s * at_start[:, speed], atol=1e-6)


def test_instants_have_independent_noise():
    at_start, before = differences(1.0)
    now, last = at_start[:, 0], before[:, -1, HEARD.index("vx_mps")]
    assert abs(np.corrcoef(now, last)[0, 1]) < 0.06


def test_every_call_draws_the_same_noise_and_a_level_scales_it():
    once, again, thrice = differences(1.0), differences(1.0), differences(3.0)
    assert np.array_equal(once[0], again[0])
    assert np.array_equal(once[1], again[1])
    assert np.allclose(thrice[0], 3.0 * once[0], atol=1e-6)
    assert np.allclose(thrice[1], 3.0 * once[1], atol=1e-6)


def test_states_of_unknown_noise_have_no_noisy_set():
    schema = Schema((Signal("heat_k", "K"),), (), (), 0.1)
    test = made_test_set(made_trajectories(5, states=1))
    assert noisy_set(test, 1.0, schema, Roles((), None, ())) is None


def test_levels_are_sorted_and_each_is_used_once():
    assert choose_levels([3.0, 0.5, 3.0]) == (0.5, 3.0)
    assert choose_levels(None) == choose_levels([]) == DEFAULT_LEVELS


@pytest.mark.parametrize("level", [0.0, -1.0, 1e3, float("nan"), float("inf")])
def test_a_level_without_a_meaning_is_refused(level):
    with pytest.raises(ConfigError, match="--noise"):
        choose_levels([1.0, level])
