"""Conditions of simulated drives: drawn within their ranges, and acting on the car."""

import numpy as np
import pytest

from offline.data.recipe import CONDITIONS, FRICTION_COLUMNS, PATCH_S, draw_conditions
from offline.data.variation import VARIED, Variation
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.parameters import default_car
from sim_bridge.plant.parts import RoadParameters

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


def test_the_first_columns_are_the_road_as_the_plant_takes_it():
    assert CONDITIONS[: len(RoadParameters._fields)] == RoadParameters._fields
    drawn = draw(VARIED)
    assert np.array_equal(drawn.rows[:, : len(RoadParameters._fields)], drawn.roads)
    assert drawn.car.road == RoadParameters(*drawn.roads[0])


def test_a_nominal_episode_has_the_conditions_of_the_car_file():
    drawn = draw(VARIED.model_copy(update={"nominal_share": 1.0, "changing_share": 0.0}))
    assert np.all(drawn.rows == NOMINAL_ROW)
    assert drawn.car == CAR


def test_nothing_but_the_named_range_varies():
    rows = rows_of(Variation(stiffness_factor=(0.8, 1.2)))
    is_drawn = np.array([name == "stiffness_factor" for name in CONDITIONS])
    assert np.all(rows[..., ~is_drawn] == np.array(NOMINAL_ROW)[~is_drawn])
    assert np.ptp(column(rows, "stiffness_factor")) > 0.2


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


def test_load_and_tyres_stay_within_an_episode():
    rows = rows_of(VARIED)
    for name in ("mass_factor", "cg_ahead_m", "stiffness_factor"):
        assert np.all(np.ptp(column(rows, name), axis=1) == 0.0)


def test_patches_have_their_own_friction_on_one_side_or_on_both():
    slippery = Variation(changing_share=1.0, friction=(0.9, 0.9), patch_friction=(0.3, 0.4))
    friction = rows_of(slippery)[..., FRICTION_COLUMNS]
    is_patch = friction != 0.9
    assert np.all((friction[is_patch] >= 0.3) & (friction[is_patch] <= 0.4))
    sides = is_patch.any(axis=1)
    left, right, both = (
        is_patch[..., 0] & ~is_patch[..., 1],
        ~is_patch[..., 0] & is_patch[..., 1],
        is_patch.all(axis=-1),
    )
    assert left.any()
    assert right.any()
    assert both.any()
    assert np.all(friction[both][:, 0] == friction[both][:, 1])
    assert sides.any(axis=1).mean() > 0.9


def test_patches_last_as_long_as_stated():
    slippery = Variation(changing_share=1.0, friction=(0.9, 0.9), patch_friction=(0.3, 0.4))
    for seed in range(20):
        is_patch = np.any(draw(slippery, seed).roads[:, FRICTION_COLUMNS] != 0.9, axis=1)
        edges = np.flatnonzero(np.diff(is_patch.astype(int)))
        lengths_s = PERIOD_S * np.diff(edges)
        assert np.all(lengths_s >= PATCH_S[0] - PERIOD_S)
        assert np.all(lengths_s <= PATCH_S[1] + PERIOD_S)


def test_slopes_and_wind_change_gradually():
    rows = rows_of(Variation(changing_share=1.0, bank_rad=(-0.1, 0.1), gust_mps=5.0))
    for name, largest_per_s in (("bank_rad", 0.15), ("wind_left_mps", 25.0)):
        change_per_s = np.diff(column(rows, name), axis=1) / PERIOD_S
        assert 0.0 < np.abs(change_per_s).max() < largest_per_s


def test_a_load_behind_moves_the_centre_of_gravity_back_and_adds_its_mass():
    """300 kg, 1.5 m behind the centre of gravity of a car of 1501 kg."""
    drawn = draw(Variation(payload_kg=(300.0, 300.0), payload_ahead_m=(-1.5, -1.5)))
    share = 300.0 / (CAR.body.mass_kg + 300.0)
    assert column(drawn.rows, "cg_ahead_m")[0] == pytest.approx(-1.5 * share)
    assert column(drawn.rows, "mass_factor")[0] == pytest.approx(1.0 + 300.0 / CAR.body.mass_kg)
    assert drawn.car.body.front_axle_m - CAR.body.front_axle_m == pytest.approx(1.5 * share)


def test_conditions_follow_from_the_random_stream_alone():
    assert np.array_equal(draw(VARIED, 4).rows, draw(VARIED, 4).rows)
    assert not np.array_equal(draw(VARIED, 4).rows, draw(VARIED, 5).rows)
