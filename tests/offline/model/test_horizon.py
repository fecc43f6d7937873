"""The number of steps of a roll-out grows during a training."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from offline.config import PRESETS, STEPS, TrainingConfig
from offline.model.losses import horizon_of_step

seeded = settings(derandomize=True, deadline=None)
growths = st.floats(0.01, 1.0)
starts = st.integers(1, STEPS)


def a_config(**changes: object) -> TrainingConfig:
    return PRESETS["recommended"].model_copy(update=changes)


@seeded
@given(st.integers(1, 400), growths, starts)
def test_the_horizon_grows_monotonically_from_its_start_to_all_steps(steps, growth, start):
    config = a_config(horizon_start=start, horizon_growth=growth, steps=steps)
    lengths = [horizon_of_step(step, config, STEPS) for step in range(steps)]
    assert lengths == sorted(lengths)
    assert lengths[0] == start
    whole_from = math.ceil(max(growth * steps, 1.0))
    assert all(length == STEPS for length in lengths[whole_from:])


@seeded
@given(st.integers(1, 400), growths, st.integers(1, 3 * STEPS))
def test_the_horizon_is_between_one_step_and_all_steps(steps, growth, start):
    config = a_config(horizon_start=start, horizon_growth=growth, steps=steps)
    lengths = [horizon_of_step(step, config, STEPS) for step in range(steps)]
    assert min(lengths) >= 1
    assert max(lengths) <= STEPS


def test_the_horizon_grows_linearly():
    config = a_config(horizon_start=8, horizon_growth=0.3, steps=10_000)
    assert horizon_of_step(1500, config, 80) == 44


def test_without_a_start_the_horizon_has_all_steps_at_once():
    assert horizon_of_step(0, a_config(horizon_start=None), STEPS) == STEPS
