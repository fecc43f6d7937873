"""Test sets of simulated drives beyond the recipe of the training data."""

from dataclasses import replace

import numpy as np
import pytest

from offline.config import PRESETS
from offline.evaluation import simulated_sets
from offline.evaluation.simulated_sets import (
    BY_FRICTION,
    BY_MASS_FACTOR,
    NOMINAL,
    PRESSED_AT_S,
    SIMULATED,
    open_simulated_set,
    straight_braking_set,
)
from offline.evaluation.test_sets import ROBUSTNESS, SET_NAMES
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import InputColumn, StateColumn
from rt_controller.contract.timing import PERIOD_S

BY_NAME = {each.name: each for each in SIMULATED}


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_the_data_are_made_once_and_used_whole(monkeypatch):
    few = replace(BY_NAME[ROBUSTNESS], episodes=3)
    dataset, test = open_simulated_set(few)
    assert (test.n_trajectories, test.n_episodes) == (15, 3)
    assert "road friction 0.5 to 1, mass times 0.85 to 1.15" in test.description
    monkeypatch.setattr(simulated_sets, "make_dataset", None)
    assert open_simulated_set(few)[0].sha256 == dataset.sha256


def test_no_preset_trains_with_the_seeds_of_these_sets():
    trained = {preset.data_seed for preset in PRESETS.values()}
    assert trained.isdisjoint(each.seed for each in SIMULATED)


def test_every_set_has_a_name_of_its_own_and_belongs_to_an_option():
    assert len(BY_NAME) == len(SIMULATED)
    for each in SIMULATED:
        assert set(each.options) <= set(SET_NAMES)
    assert {*BY_FRICTION.values(), *BY_MASS_FACTOR.values()} <= set(SIMULATED)


def test_the_same_drivers_drive_on_every_friction_and_with_every_mass():
    nominal = open_simulated_set(replace(NOMINAL, episodes=2))[1].trajectories
    for which in (BY_FRICTION[1.0], BY_MASS_FACTOR[1.15]):
        other = open_simulated_set(replace(which, episodes=2))[1].trajectories
        assert np.array_equal(other.u, nominal.u)
        assert not np.allclose(other.x[:, -1, :3], nominal.x[:, -1, :3], atol=1e-3)


@pytest.fixture(scope="module")
def stops():
    return straight_braking_set()


def test_every_stop_reaches_the_full_brake_within_the_limits_of_the_inputs(stops):
    u = stops.trajectories.u
    brake_n = u[..., InputColumn.brake_n]
    assert np.all(brake_n[:, -1] == INPUT_LIMITS.upper.brake_n)
    assert np.all(u[..., [InputColumn.throttle, InputColumn.steer_rad]] == 0.0)
    change = np.diff(brake_n, axis=1) / PERIOD_S
    assert change.max() <= INPUT_LIMITS.rate_per_s.brake_n * 1.001
    assert change.min() >= 0.0


def test_windows_of_one_drive_differ_in_when_the_brake_begins(stops):
    brake_n = stops.trajectories.u[: len(PRESSED_AT_S), :, InputColumn.brake_n]
    begins = [int(np.argmax(row > 0.0)) for row in brake_n]
    assert begins == [round(max(after_s, 0.0) / PERIOD_S) for after_s in PRESSED_AT_S]


def test_the_cars_keep_moving_straight(stops):
    x = stops.trajectories.x
    assert np.all(x[..., StateColumn.vx_mps] > 10.0 / 3.6)
    assert np.all(x[..., [StateColumn.vy_mps, StateColumn.yaw_rate_radps]] == 0.0)
    deceleration = -np.diff(x[..., StateColumn.vx_mps], axis=1) / PERIOD_S
    assert 6.0 < deceleration.max() < 10.0


def test_each_window_has_errors_of_its_own_on_a_straight_road(stops):
    first = stops.trajectories.x[:, 0]
    assert len(np.unique(first[:, StateColumn.ey_m])) == stops.n_trajectories
    assert np.all(stops.trajectories.w == 0.0)
    assert stops.n_episodes * len(PRESSED_AT_S) == stops.n_trajectories
