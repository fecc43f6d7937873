"""The path of a car from its movement: on a circle, over periods, and back on a plane."""

import numpy as np
import pytest

from rt_controller.model.path_kinematics import path_after, path_of, path_of_one, project

KAPPAS = (-0.12, -1e-3, -1e-9, 0.0, 1e-9, 4e-3, 0.08)


def moves(periods: int) -> np.ndarray:
    """(K, 3) of a car that slides and turns."""
    rng = np.random.default_rng(3)
    return np.array([0.4, 0.0, 0.01]) + rng.normal(size=(periods, 3)) * [0.05, 0.02, 0.01]


@pytest.mark.parametrize("kappa", [0.1, -0.02])
def test_a_point_is_projected_onto_the_circle_of_the_road(kappa):
    turn, beside = np.linspace(-2.0, 2.0, 21), 1.5
    radius = 1.0 / kappa
    x = (radius - beside) * np.sin(turn)
    y = radius - (radius - beside) * np.cos(turn)
    place = project(x, y, kappa)
    np.testing.assert_allclose(place.turn_rad, turn, atol=1e-12)
    np.testing.assert_allclose(place.s_m, turn * radius, atol=1e-11)
    np.testing.assert_allclose(place.ey_m, beside, atol=1e-11)


@pytest.mark.parametrize("kappa", KAPPAS)
def test_all_forms_give_the_same_path(kappa):
    """K periods at once, period by period, of several cars, and of one."""
    moved, path = moves(40), np.array([0.0, -0.7, 0.08])
    expected = path_of(moved, kappa, path)
    one = several = path
    for k, each in enumerate(moved):
        one = np.array(path_of_one(each, kappa, one))
        several = path_after(np.stack([each, 2.0 * each]), kappa, np.stack([several, several]))[0]
        np.testing.assert_allclose(one, expected[k], atol=1e-11)
        np.testing.assert_allclose(several, expected[k], atol=1e-11)


@pytest.mark.parametrize("kappa", KAPPAS)
def test_the_sum_of_the_path_is_the_place_of_the_car_on_a_plane(kappa):
    moved, first = moves(40), np.array([0.0, 0.5, -0.1])
    x, y, heading = 0.0, first[1], first[2]
    for ahead, left, turn in moved:
        middle = heading + 0.5 * turn
        x += ahead * np.cos(middle) - left * np.sin(middle)
        y += ahead * np.sin(middle) + left * np.cos(middle)
        heading += turn
    place = project(np.array(x), np.array(y), kappa)
    found = path_of(moved, kappa, first)
    assert found[:, 0].sum() == pytest.approx(float(place.s_m), abs=1e-10)
    assert found[-1, 1] == pytest.approx(float(place.ey_m), abs=1e-10)
    assert found[-1, 2] == pytest.approx(heading - kappa * float(place.s_m), abs=1e-10)


@pytest.mark.parametrize("kappa", [0.05, -0.1])
def test_a_car_that_turns_as_the_road_stays_beside_it(kappa):
    """Two metres inside or outside, where it moves on another radius."""
    for ey in (-2.0, 0.0, 2.0):
        radius = 1.0 / kappa - ey
        moved = np.tile(
            [2.0 * abs(radius) * np.sin(0.005), 0.0, np.copysign(0.01, radius)], (60, 1)
        )
        found = path_of(moved, kappa, np.array([0.0, ey, 0.0]))
        np.testing.assert_allclose(found[:, 1:], [[ey, 0.0]] * 60, atol=1e-12)
