"""The fitted single-track car, and the Gauss-Newton steps that fit it."""

from dataclasses import replace

import numpy as np
import pytest
from made_drives import dataset_of, relative_error

from offline.baselines.catalogue.bicycle import (
    BicycleSettings,
    descend,
    fit_bicycle,
    guessed_model,
)
from offline.baselines.score import log_error, log_mean_square
from offline.baselines.single_track.gauss_newton import begin, step
from offline.baselines.single_track.kernel import Bicycle
from offline.data.signals import VEHICLE_ROLES, mirror_signs
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import VEHICLE

GUESS = Bicycle()
TRUE = GUESS._replace(
    front_axle_m=1.25,
    gyration_m2=2.1,
    steering_ratio=16.0,
    steering_lag_s=0.08,
    stiffness_front_per_rad=10.0,
    friction_rear=0.9,
    brake_mps2_per_n=0.05,
    drag_per_m=5e-4,
)


def car(parameters=GUESS):
    return replace(guessed_model(), parameters=np.array(parameters))


def drives_of(model, episodes=24, periods=181):
    """Drives of a known car as a data set without poses."""
    rng = np.random.default_rng(1)
    time = np.arange(periods) * VEHICLE.dt_s
    phase, rate = rng.uniform(0, 6, (episodes, 1, 3)), rng.uniform(1, 4, (episodes, 1, 3))
    wave = np.sin(rate * time[:, None] + phase)
    u = np.concatenate(
        [np.maximum(wave[..., :1], 0), 80 * np.maximum(-wave[..., :1], 0), 0.6 * wave[..., 2:]], -1
    )
    w = np.repeat(rng.uniform(-4e-3, 4e-3, (episodes, 1, 1)), periods, axis=1)
    x0 = np.zeros((episodes, 6))
    x0[:, 0], x0[:, 3] = rng.uniform(12, 30, episodes), 0.5
    past = np.zeros((episodes, 20, 6))
    past[:, :, 0], past[:, :, 3:] = x0[:, :1], u[:, :1]
    x = model.predict(x0, past, u[:, :-1], w[:, :-1])
    return dataset_of(x, u, w, VEHICLE, VEHICLE_ROLES)


def predict_one(x0, U, kappa=0.0):
    """Prediction of one car without observer, whose past is constant."""
    model = car(GUESS._replace(surge_gain=0.0, sway_gain=0.0, swing_gain=0.0))
    past = np.tile(np.concatenate([x0[:3], U[0]]), (1, 20, 1))
    W = np.full((1, len(U), 1), kappa)
    return model.predict(x0[None], past, U[None], W)[0]


def test_a_coasting_car_drives_straight_and_slows_down_by_its_drag():
    found = predict_one(np.array([30.0, 0, 0, 0.75, 0.5, 0.0]), np.zeros((80, 3)))
    drag = 0.3 + GUESS.rolling_mps2 + GUESS.drag_per_m * 30.0**2
    assert found[1, 0] == pytest.approx(30.0 - 0.025 * drag, abs=1e-3)
    assert np.allclose(found[:, [1, 2, 5]], 0.0)
    assert np.allclose(found[:, 4], 0.5)
    assert found[1, 3] == pytest.approx(0.025 * found[:2, 0].mean())


def test_steering_angle_in_a_steady_turn_follows_from_curvature_and_understeer():
    """delta = L / R + (1 / C_f - 1 / C_r) a_y / g, with linear tyres."""
    speed, wheel_rad = 15.0, 0.1
    inputs = np.tile([0.15, 0.0, wheel_rad], (240, 1))
    found = predict_one(np.array([speed, 0, 0, 0.375, 0, 0]), inputs)
    vx, _, yaw_rate = found[-1, :3]
    wheelbase = GUESS.front_axle_m + GUESS.rear_axle_m
    understeer = 1 / GUESS.stiffness_front_per_rad - 1 / GUESS.stiffness_rear_per_rad
    expected = wheelbase * yaw_rate / vx + understeer * yaw_rate * vx / 9.81
    assert wheel_rad / GUESS.steering_ratio == pytest.approx(expected, rel=0.03)


def test_left_and_right_are_mirror_images():
    rng = np.random.default_rng(0)
    x0 = np.array([20.0, 0.3, 0.1, 0.5, 0.4, -0.05])
    U = np.column_stack([np.full(80, 0.4), np.zeros(80), np.cumsum(rng.normal(0, 0.02, 80))])
    x_signs = mirror_signs(VEHICLE.state_names, VEHICLE_ROLES)
    u_signs = mirror_signs(VEHICLE.input_names, VEHICLE_ROLES)
    left, right = predict_one(x0, U, 3e-3), predict_one(x0 * x_signs, U * u_signs, -3e-3)
    assert np.allclose(left, right * x_signs, atol=1e-12)


def test_path_states_are_relative_to_the_curved_road():
    """A car that drives straight on a road to the left gets to the right of it."""
    found = predict_one(np.array([20.0, 0, 0, 0.5, 0, 0]), np.tile([0.2, 0.0, 0.0], (80, 1)), 4e-3)
    turned = found[:, 3].cumsum()[-1] * 4e-3
    assert found[-1, 5] == pytest.approx(-turned, rel=0.02)
    assert found[-1, 4] < -1.0


def test_predictions_at_standstill_are_finite():
    found = predict_one(np.zeros(6), np.tile([0.0, 150.0, 0.5], (80, 1)))
    assert np.all(np.isfinite(found))


def test_unexplained_acceleration_of_the_past_continues_at_first():
    x0, U = np.array([20.0, 0, 0, 0.5, 0, 0]), np.zeros((40, 3))
    past = np.zeros((1, 20, 6))
    past[0, :, 0] = 20.0 + 3.0 * 0.025 * np.arange(20, 0, -1)
    W = np.zeros((1, 40, 1))
    braked = car().predict(x0[None], past, U[None], W)[0]
    assert braked[10, 0] < predict_one(x0, U)[10, 0] - 0.2


@pytest.fixture(scope="module")
def known_car():
    return drives_of(car(TRUE))


QUICK = BicycleSettings(horizons=(10, 40), steps=(7, 5), windows=24)


def test_the_fit_recovers_the_parameters_of_a_known_car(known_car):
    test = known_car.select("test")
    found = fit_bicycle(known_car, QUICK)
    assert np.all(relative_error(found, test) < 0.2 * relative_error(car(), test))
    fitted = Bicycle(*found.parameters)
    assert fitted.steering_ratio == pytest.approx(TRUE.steering_ratio, rel=0.05)
    assert fitted.brake_mps2_per_n == pytest.approx(TRUE.brake_mps2_per_n, rel=0.05)


def test_the_fit_is_repeatable(known_car):
    settings = BicycleSettings(horizons=(5,), steps=(1,), windows=4)
    one, other = fit_bicycle(known_car, settings), fit_bicycle(known_car, settings)
    assert np.array_equal(one.parameters, other.parameters)
    assert np.array_equal(one.drive_mps2, other.drive_mps2)
    assert not np.array_equal(one.parameters, np.array(GUESS))


def test_steps_from_two_windows_do_not_increase_the_error_on_the_others(known_car):
    train = known_car.select("train")
    settings = BicycleSettings(horizons=(80,), steps=(3,), windows=2)
    found = descend(car(TRUE), train, settings)
    assert log_error(found, train) <= log_error(car(TRUE), train)


def test_fit_info_has_all_parameters_with_their_units():
    named = dict(car(TRUE).fit_info())
    assert named["steering_ratio"] == "16"
    assert named["drag_per_m"] == "0.0005"
    assert "at 10 m/s" in named["drive in m/s^2, throttle 0.5"]


def test_windows_without_a_past_are_refused():
    with pytest.raises(DatasetError, match="20 or more"):
        car().predict(
            np.zeros((1, 6)), np.zeros((1, 3, 6)), np.zeros((1, 5, 3)), np.zeros((1, 5, 1))
        )


def residuals(theta):
    """Two states that do not depend on the third parameter."""
    rng, time = np.random.default_rng(0), np.linspace(0, 1, 30)
    wanted = np.stack([2.0 - time, 0.5 + 3.0 * time**2], -1) + rng.normal(0, 1e-3, (4, 30, 2))
    return np.stack([theta[0] - time, 0.5 + theta[1] * time**2], -1) - wanted


def test_gauss_newton_solves_a_linear_problem_and_keeps_parameters_without_effect():
    theta, trust = np.array([0.0, 0.0, 7.0]), begin(3)
    for _ in range(12):
        theta, trust = step(theta, residuals, residuals, trust)
    assert theta == pytest.approx([2.0, 3.0, 7.0], abs=1e-3)


def test_a_step_that_increases_the_objective_is_not_taken():
    best = np.array([2.0, 3.0, 7.0])
    theta, _ = step(
        best, residuals, lambda t: 1.0 + np.any(t != best) * np.ones((1, 1, 1)), begin(3)
    )
    assert theta is best


def test_log_error_is_infinite_if_an_error_is_not_finite():
    assert log_mean_square(np.array([[[1.0], [np.nan]]])) == np.inf
    assert log_mean_square(np.array([[[1.0, 2.0]]])) == pytest.approx(np.log(2.0))
