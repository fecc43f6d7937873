"""Random driver inputs respect the controller's bounds and rates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offline.data.generate import make_episode
from offline.data.recipe import (
    Pedals,
    Recipe,
    draw_inputs,
    follow_pedals,
    limit_rate,
    monotone_cubic,
)
from rt_controller.contract.limits import INPUT_LIMITS, PEDAL_CHANGE_S, PLAN_STEER_RAD
from rt_controller.contract.timing import PERIOD_S

SEEDS = st.integers(0, 2**32 - 1)
CHANGE = round(PEDAL_CHANGE_S / PERIOD_S)


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_inputs_respect_bounds_rates_and_one_pedal_at_a_time(seed):
    u = draw_inputs(np.random.default_rng(seed), Recipe(), 401)
    assert u.shape == (401, 3)
    assert np.all(u >= np.array(INPUT_LIMITS.lower) - 1e-12)
    assert np.all(u <= np.array(INPUT_LIMITS.upper) + 1e-12)
    from_rest = np.diff(np.vstack([np.zeros(3), u]), axis=0)
    assert np.all(np.abs(from_rest) <= np.array(INPUT_LIMITS.rate_per_s) * PERIOD_S + 1e-9)
    assert not np.any((u[:, 0] > 0) & (u[:, 1] > 0))


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_changing_pedals_takes_the_configured_time(seed):
    u = draw_inputs(np.random.default_rng(seed), Recipe(), 401)
    pressed = np.where(u[:, 0] > 0, 1, np.where(u[:, 1] > 0, 2, 0))
    last_pressed, last_at = 0, -CHANGE
    for k, pedal in enumerate(pressed):
        if pedal and last_pressed and pedal != last_pressed:
            assert k - last_at > CHANGE
        if pedal:
            last_pressed, last_at = pedal, k


def test_equal_seeds_give_equal_inputs():
    first, second = (draw_inputs(np.random.default_rng(5), Recipe(), 401) for _ in range(2))
    assert np.array_equal(first, second)


def test_the_largest_angle_of_the_recipe_bounds_the_wheel():
    small, usual = Recipe(largest_steer_deg=40.0), Recipe()
    assert usual.largest_steer_rad == PLAN_STEER_RAD
    for seed in range(5):
        one, other = (
            make_episode(recipe, np.random.SeedSequence(seed)).inputs for recipe in (small, usual)
        )
        assert np.abs(one[:, 2]).max() <= np.radians(40.0) + 1e-12
        assert np.array_equal(one[:3, :2], other[:3, :2])
    assert small.text == "recipe nominal, steering wheel up to 40 deg"


def test_inputs_reach_both_ends_of_their_ranges():
    rng = np.random.default_rng(0)
    u = np.concatenate([draw_inputs(rng, Recipe(), 401) for _ in range(60)])
    assert u[:, 0].max() == pytest.approx(1.0)
    assert u[:, 1].max() == pytest.approx(150.0)
    assert abs(u[:, 2]).max() > 0.95 * INPUT_LIMITS.upper.steer_rad
    assert abs(u[:, 2].mean()) < 0.02
    driving = np.mean(u[:, 0] > 0)
    assert 0.35 < driving < 0.65


def test_a_pedal_follows_its_target_at_the_limited_rate():
    pedals = follow_pedals([Pedals(1.0, 0.0)] * 20, INPUT_LIMITS)
    step = INPUT_LIMITS.rate_per_s.throttle * PERIOD_S
    assert np.allclose(pedals[:, 0], np.minimum(step * np.arange(1, 21), 1.0))


def test_the_brake_is_pressed_only_after_the_throttle_is_released():
    targets = [Pedals(0.5, 0.0)] * 10 + [Pedals(0.0, 100.0)] * 40
    pedals = follow_pedals(targets, INPUT_LIMITS)
    released = np.flatnonzero(pedals[10:, 0] == 0.0)[0] + 10
    first_brake = np.flatnonzero(pedals[:, 1])[0]
    assert first_brake - released == CHANGE
    assert pedals[-1, 1] == 100.0


def test_the_spline_passes_through_its_knots_without_overshoot():
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 2.0, 6)
    for _ in range(20):
        y = rng.uniform(-1, 1, 6)
        assert np.allclose(monotone_cubic(t, y, t), y)
        for left in range(5):
            inside = monotone_cubic(t, y, np.linspace(t[left], t[left + 1], 50))
            assert inside.min() >= min(y[left : left + 2]) - 1e-12
            assert inside.max() <= max(y[left : left + 2]) + 1e-12


def test_the_spline_has_a_continuous_slope():
    rng = np.random.default_rng(2)
    t, y = np.linspace(0.0, 2.0, 6), rng.uniform(-1, 1, 6)
    h = 1e-6
    for knot in t[1:-1]:
        before = (monotone_cubic(t, y, np.array([knot])) - monotone_cubic(t, y, knot - h)) / h
        after = (monotone_cubic(t, y, knot + h) - monotone_cubic(t, y, np.array([knot]))) / h
        assert np.allclose(before, after, atol=1e-3)


def test_the_spline_reproduces_a_straight_line():
    t = np.array([0.0, 0.3, 1.0, 1.4])
    at = np.linspace(0.0, 1.4, 30)
    assert np.allclose(monotone_cubic(t, 2 * t - 1, at), 2 * at - 1)


def test_a_rate_limited_signal_starts_from_zero():
    limited = limit_rate(np.full(5, 1.0), rate_per_s=10.0)
    assert np.allclose(limited, [0.25, 0.5, 0.75, 1.0, 1.0])
