"""Ratios of errors."""

import numpy as np
import pytest

from offline.evaluation.metrics import StateUnit, geometric_mean, ratio_of, state_units
from rt_controller.contract.schema import VEHICLE

CAR = state_units(VEHICLE)


def draws(*values, count=5):
    return np.tile(np.array(values, dtype=float), (count, 1))


def test_the_second_mean_leaves_out_progress():
    """Progress, the fourth state, has the only error."""
    found = ratio_of(draws(1, 1, 1, 64, 1, 1), draws(1, 1, 1, 1, 1, 1), CAR)
    assert found.geometric_mean.value == pytest.approx(2.0)
    assert found.without_progress.value == pytest.approx(1.0)
    found = ratio_of(draws(32, 1, 1, 64, 1, 1), draws(1, 1, 1, 1, 1, 1), CAR)
    assert found.without_progress.value == pytest.approx(2.0)


def test_states_without_progress_have_one_mean():
    columns = (StateUnit("speed", "km/h", 3.6), StateUnit("heat", "K", 1.0))
    found = ratio_of(draws(4, 1), draws(1, 1), columns)
    assert found.geometric_mean.value == pytest.approx(2.0)
    assert found.without_progress is None
    assert ratio_of(draws(4), draws(1), (StateUnit("ds", "m", 1.0),)).without_progress is None


def test_a_ratio_to_a_single_episode_has_no_interval():
    many = np.random.default_rng(0).uniform(1.0, 2.0, (2001, 6))
    found = ratio_of(draws(1, 1, 1, 1, 1, 1, count=1), many, CAR)
    assert np.isnan(found.geometric_mean.low)
    assert np.isnan(found.by_state.high).all()
    assert found.by_state.value == pytest.approx(1.0 / many[0])


def test_the_smallest_ratio_is_that_of_the_state_where_the_model_leads_least():
    found = ratio_of(draws(4, 3, np.nan, 9, 2, np.inf), draws(1, 1, 1, 1, 1, 1), CAR)
    assert CAR[found.least_state].name == "ey"
    assert CAR[found.worst_state].name == "yaw_rate"


def test_a_ratio_of_zero_makes_the_mean_zero():
    assert geometric_mean(np.array([0.0, 8.0, 8.0])) == 0.0
    assert geometric_mean(np.array([1.0, 8.0, 1.0])) == pytest.approx(2.0)
