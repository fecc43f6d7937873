"""What a recipe draws: driver inputs and conditions, within bounds and from one stream."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offline.data.generate import make_episode
from offline.data.recipe import (
    CONDITIONS,
    FRICTION_COLUMNS,
    PATCH_S,
    Recipe,
    draw_conditions,
    draw_inputs,
)
from offline.data.variation import VARIED, Variation, choose_variation, describe
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import INPUT_LIMITS, PEDAL_CHANGE_S, PLAN_STEER_RAD
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.parameters import default_car
from sim_bridge.plant.parts import RoadParameters

SEEDS = st.integers(0, 2**32 - 1)
CHANGE = round(PEDAL_CHANGE_S / PERIOD_S)


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


PERIODS = 420
CAR = default_car()
NOMINAL_ROW = [*CAR.road, 1.0, 0.0, 1.0]


def draw(variation: Variation, seed: int = 0):
    return draw_conditions(np.random.default_rng(seed), variation, PERIODS)


def rows_of(variation: Variation, count: int = 40) -> np.ndarray:
    """(count, periods, q)"""
    return np.stack([draw(variation, seed).rows for seed in range(count)])


def column(rows: np.ndarray, name: str) -> np.ndarray:
    return rows[..., CONDITIONS.index(name)]


@pytest.mark.parametrize(
    ("name", "largest_beyond"),
    [("bank_rad", 0.0), ("grade_rad", 0.0), ("wind_left_mps", 5.0), ("wind_forward_mps", 5.0)],
)
def test_slopes_and_mean_wind_cover_their_range_on_both_sides(name, largest_beyond):
    low, high = getattr(VARIED, name)
    values = column(rows_of(VARIED), name)
    assert low - largest_beyond <= values.min() < 0.8 * low
    assert 0.8 * high < values.max() <= high + largest_beyond


def test_the_shares_of_nominal_and_changing_episodes_are_those_of_the_recipe():
    rows = rows_of(VARIED, 400)
    is_nominal = np.all(rows == NOMINAL_ROW, axis=(1, 2))
    is_changing = np.any(np.ptp(rows, axis=1) > 0.0, axis=1)
    assert np.mean(is_nominal) == pytest.approx(VARIED.nominal_share, abs=0.07)
    assert np.mean(is_changing) == pytest.approx(VARIED.changing_share, abs=0.07)


def test_a_load_behind_moves_the_centre_of_gravity_back_and_adds_its_mass():
    """300 kg, 1.5 m behind the centre of gravity of a car of 1501 kg."""
    drawn = draw(Variation(payload_kg=(300.0, 300.0), payload_ahead_m=(-1.5, -1.5)))
    share = 300.0 / (CAR.body.mass_kg + 300.0)
    assert column(drawn.rows, "cg_ahead_m")[0] == pytest.approx(-1.5 * share)
    assert column(drawn.rows, "mass_factor")[0] == pytest.approx(1.0 + 300.0 / CAR.body.mass_kg)
    assert drawn.car.body.front_axle_m - CAR.body.front_axle_m == pytest.approx(1.5 * share)


def test_a_range_replaces_that_of_the_recipe_and_leaves_the_others():
    chosen = choose_variation("varied", Variation(friction=(0.6, 0.9), payload_kg=None))
    assert chosen == VARIED.model_copy(update={"friction": (0.6, 0.9), "payload_kg": None})


def test_the_description_names_every_value_that_varies():
    assert describe(None) == "recipe nominal"
    text = describe(Variation(changing_share=0.5, friction=(0.5, 1.0), gust_mps=4.0))
    assert text == "changing_share 0.5, friction 0.5 to 1, gust_mps 4"


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
    pedal = np.where(u[:, 0] > 0, 1, np.where(u[:, 1] > 0, 2, 0))
    pressed_at = np.flatnonzero(pedal)
    is_change = np.diff(pedal[pressed_at]) != 0
    assert np.all(np.diff(pressed_at)[is_change] > CHANGE)


def test_an_episode_keeps_its_load_and_tyres_and_is_nominal_outside_of_its_ranges():
    rows = rows_of(VARIED)
    assert CONDITIONS[: len(RoadParameters._fields)] == RoadParameters._fields
    for name in ("mass_factor", "cg_ahead_m", "stiffness_factor"):
        assert np.all(np.ptp(column(rows, name), axis=1) == 0.0)
    rows = rows_of(Variation(stiffness_factor=(0.8, 1.2)))
    is_drawn = np.array([name == "stiffness_factor" for name in CONDITIONS])
    assert np.all(rows[..., ~is_drawn] == np.array(NOMINAL_ROW)[~is_drawn])
    assert np.ptp(column(rows, "stiffness_factor")) > 0.2


def test_patches_have_their_own_friction_and_length_on_one_side_or_on_both():
    slippery = Variation(changing_share=1.0, friction=(0.9, 0.9), patch_friction=(0.3, 0.4))
    friction = rows_of(slippery)[..., FRICTION_COLUMNS]
    is_patch = friction != 0.9
    assert np.all((friction[is_patch] >= 0.3) & (friction[is_patch] <= 0.4))
    left, right = is_patch[..., 0], is_patch[..., 1]
    assert (left & ~right).any()
    assert (right & ~left).any()
    assert (left & right).any()
    assert np.all(friction[left & right][:, 0] == friction[left & right][:, 1])
    for patch in left | right:
        lengths_s = PERIOD_S * np.diff(np.flatnonzero(np.diff(patch.astype(int))))
        assert np.all(lengths_s >= PATCH_S[0] - PERIOD_S)
        assert np.all(lengths_s <= PATCH_S[1] + PERIOD_S)


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"friction": (0.0, 1.0)}, "friction"),
        ({"friction": (1.0, 0.5)}, "lower end first"),
        ({"payload_kg": (-1.0, 100.0)}, "payload_kg"),
        ({"bank_rad": (-6.0, 6.0)}, "bank_rad"),
        ({"wind_left_mps": (0.0, float("nan"))}, "wind_left_mps"),
        ({"nominal_share": 0.8, "changing_share": 0.3}, "at most 1 together"),
        ({"fricton": (0.5, 1.0)}, "friction"),
        # what acts in changing episodes only needs a share of them
        ({"patch_friction": (0.3, 0.5)}, "changing_share"),
        ({"gust_mps": 4.0}, "changing_share"),
    ],
)
def test_ranges_that_no_car_can_drive_in_are_refused(fields, complaint):
    with pytest.raises(ConfigError, match=complaint):
        choose_variation("nominal", Variation(**fields))
