"""Persistence and linear models: for all roads, for each road, with a past, blended over speed."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from made_drives import drive, predict, relative_error

from offline.baselines.fitting import best_model, log_error
from offline.baselines.linear import LinearPerCurvature, fit_linear, fit_per_curvature, to_bundle
from offline.baselines.road_path import path_states
from offline.baselines.scheduled import fit_scheduled, hat_functions
from offline.config import PAST_STEPS
from offline.data.generate import steering_geometry
from offline.data.signals import past_names
from offline.model.bundle_predictor import BundlePredictor
from offline.model.physical_units import choose_selftest
from rt_controller.contract.errors import DatasetError
from rt_controller.model.artifact import load_bundle, save_bundle
from rt_controller.model.dynamics import Matrices
from rt_controller.model.follow import Follow
from rt_controller.model.lift import Lift

B = np.array([[0.1, 0.0], [0.0, 0.02], [-0.05, 0.1]])
FEW = {"ridges": (1e-12,)}


def linear_step(x, u, w, u_before):
    return 0.95 * x + u @ B.T + 0.02 * w + 0.01


def slower_inputs(x, u, w, u_before):
    """The turn acts one period late."""
    gains = np.diag([0.1, 0.02, 0.1])
    return 0.95 * x + np.stack([u[:, 0], u_before[:, 1], u_before[:, 1]], axis=1) @ gains


def speed_dependent(x, u, w, u_before):
    """The gain of the turn is proportional to the speed, which follows the push."""
    speed, level, swing = x.T
    push, turn = u.T
    return np.stack([0.98 * speed + 0.05 * push, level, 0.9 * swing + 0.3 * speed * turn], axis=1)


def float_windows(dataset):
    return (series.astype(np.float64) for series in dataset.select("test")[:4])


def test_least_squares_is_the_solution_of_all_transitions_at_once(toy_dataset):
    """Against numpy's solver on the whole problem in physical units."""
    x, u, w = (series.astype(float) for series in toy_dataset.select("train")[:3])
    regressors = np.concatenate([x[:, :-1], u, w, np.ones((*u.shape[:2], 1))], axis=-1)
    regressors, targets = regressors.reshape(-1, 11), x[:, 1:].reshape(-1, 6)
    expected, *_ = np.linalg.lstsq(regressors, targets, rcond=None)
    model = fit_linear(toy_dataset)
    lti = model.matrices
    found = np.vstack([lti.A.T, lti.B_uc.T, lti.B_uw.T, lti.c])
    assert np.allclose(regressors @ found, regressors @ expected, atol=1e-5)


def test_the_bundle_has_its_kind_and_data_and_predicts_what_the_model_predicts(
    toy_dataset, tmp_path
):
    known = replace(
        toy_dataset, manifest=replace(toy_dataset.manifest, geometry=steering_geometry())
    )
    model = fit_linear(known)
    whole_past = Lift(True, PAST_STEPS, past_names(known.schema, known.roles))
    bundle = to_bundle("lti", model, known, choose_selftest(known, whole_past))
    training = json.loads(bundle.training)
    assert (training["kind"], training["episodes"], training["data_seed"]) == ("lti", 40, 3)
    assert bundle.geometry == steering_geometry()
    assert bundle.data_sha256 == toy_dataset.sha256
    save_bundle(tmp_path, bundle, "card")
    by_bundle, _ = predict(BundlePredictor(load_bundle(tmp_path)), known.select("test"))
    by_model, _ = predict(model, known.select("test"))
    assert np.allclose(by_bundle, by_model, rtol=1e-6, atol=1e-8)


def test_the_model_of_a_road_is_fitted_to_its_trajectories(toy_dataset):
    model = fit_per_curvature(toy_dataset)
    assert [*model.models] == [-4e-3, 0.0, 4e-3]
    train = toy_dataset.select("train")
    on_it = train.take(train.w[:, 0, 0] == np.float32(4e-3))
    x, u = on_it.x.astype(float), on_it.u.astype(float)
    regressors = np.concatenate([x[:, :-1], u, np.ones((*u.shape[:2], 1))], axis=-1)
    rows, targets = regressors.reshape(-1, 10), x[:, 1:].reshape(-1, 6)
    expected = rows @ np.linalg.lstsq(rows, targets, rcond=None)[0]
    zero = np.zeros((len(x), PAST_STEPS, on_it.past.shape[2]))
    found = model.predict(x[:, 0], zero, u[:, :1], on_it.w[:, :1].astype(float))[:, 1]
    assert np.allclose(found, expected.reshape(x[:, 1:].shape)[:, 0], atol=1e-5)


def test_models_are_interpolated_between_roads_and_constant_beyond_them():
    made = drive(linear_step)
    scaling = replace(fit_linear(made).scaling, x_centre=np.zeros(1), x_scale=np.ones(1))
    none = (np.zeros((1, 1)), np.zeros((1, 2)), np.zeros((1, 1)))
    models = {0.0: Matrices(*none, np.ones(1)), 2e-3: Matrices(*none, np.full(1, 3.0))}
    kappa = np.array([0.0, 5e-4, 1e-3, 2e-3, 9e-3, -1.0])
    W = np.repeat(kappa[:, None, None], 2, axis=1)
    windows = np.zeros((6, 1)), np.zeros((6, 0, 3)), np.zeros((6, 2, 2)), W
    found = LinearPerCurvature(scaling, models).predict(*windows)
    assert np.allclose(found[:, 2, 0], [1.0, 1.5, 2.0, 3.0, 3.0, 1.0])


def test_a_past_explains_a_late_input():
    data = drive(slower_inputs)
    test = data.select("test")
    model = fit_scheduled(data, (1, 2), **FEW)
    assert np.all(relative_error(model, test) < 1e-3)
    assert log_error(model, test) < log_error(fit_scheduled(data, **FEW), test) - 2.0


def test_of_all_settings_those_of_the_smallest_validation_error_are_taken():
    data = drive(speed_dependent)
    chosen = fit_scheduled(data, (0, 1), knots=(1, 2), ridges=(1e-12, 10.0))
    assert chosen.structure.follows is Follow.PREDICTION
    structure, scaling = chosen.structure, chosen.structure.scaling
    assert chosen.ridge == 1e-12
    assert structure.learned.curvature is None
    knots = structure.knots * scaling.x_scale[0] + scaling.x_centre[0]
    expected = np.quantile(data.select("train").x[:, 0, 0], (0.01, 0.99))
    assert knots == pytest.approx(expected, rel=0.02)
    alone, test = fit_scheduled(data, **FEW), data.select("test")
    assert relative_error(chosen, test)[2] < 0.1 * relative_error(alone, test)[2]


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=6, unique_by=lambda x: round(x, 2)))
@settings(deadline=None, max_examples=50)
def test_hat_functions_are_one_at_their_knot_and_interpolate_constant_beyond(knots):
    knots = np.sort(knots)
    assert np.allclose(hat_functions(knots, knots), np.eye(len(knots)))
    speed = np.linspace(-7, 7, 29)
    assert np.allclose(hat_functions(speed, knots) @ knots, np.interp(speed, knots, knots))


def test_without_a_centred_state_or_with_one_speed_there_is_one_knot():
    data = drive(speed_dependent)
    roles = replace(data.roles, centred=())
    recording = data.recording._replace(x=data.recording.x * np.float32([0, 1, 1]))
    for few in (
        replace(data, manifest=replace(data.manifest, roles=roles)),
        replace(data, recording=recording),
    ):
        assert len(fit_scheduled(few, knots=(4,), **FEW).structure.knots) == 1


def test_the_path_of_the_car_follows_from_the_motion_and_the_motion_from_the_recursion(toy_dataset):
    """The recursion of the docstring, one step and one regressor at a time."""
    model = fit_scheduled(toy_dataset, (2,), knots=(3,), **FEW)
    s, scaling = model.structure, model.structure.scaling
    x, u, w, past = float_windows(toy_dataset)
    states = model.predict(x[:, 0], past, u, w)
    path = path_states(np, states[..., :3], x[:, 0], w[..., 0], 0.025)
    assert np.allclose(states[:, 1:, 3:], path)
    expected = scaling.normalise_states(x[0, 0])[:3]
    rows = [(row - scaling.past_centre) / scaling.past_scale for row in past[0, -2:]]
    for k in range(5):
        inputs = u[0, k] / scaling.u_scale
        z = [*expected, *rows[-2][:3], *rows[-1][:3], *rows[-2][3:], *rows[-1][3:], *inputs, 1.0]
        phi = hat_functions(expected[:1], s.knots)[0]
        rows.append(np.concatenate([expected, inputs]))
        expected = expected + sum(phi[j] * model.theta[j] @ np.array(z) for j in range(3))
        physical = expected * scaling.x_scale[:3] + scaling.x_centre[:3]
        assert np.allclose(states[0, k + 1, :3], physical)


def test_path_agrees_with_integration_in_small_steps_and_in_torch():
    rng = np.random.default_rng(0)
    steps, dt_s = 80, 0.025
    motion = np.empty((4, steps + 1, 3))
    motion[..., 0] = 20 + np.cumsum(rng.normal(0, 0.05, (4, steps + 1)), axis=1)
    motion[..., 1] = 0.3 * np.sin(0.1 * np.arange(steps + 1))
    motion[..., 2] = 0.2 * np.sin(0.05 * np.arange(steps + 1) + rng.uniform(0, 6, (4, 1)))
    x0 = np.zeros((4, 6))
    x0[:, 4:] = rng.uniform(-1, 1, (4, 2)) * (2.0, 0.17)
    kappa = np.repeat(np.array([[-1e-2], [0.0], [4e-3], [1e-2]]), steps, axis=1)
    found = path_states(np, motion, x0, kappa, dt_s)
    assert np.allclose(found, fine_path(motion, x0, kappa, dt_s), atol=1e-3)
    by_torch = path_states(torch, *map(torch.from_numpy, (motion, x0, kappa)), dt_s)
    assert np.allclose(found, by_torch.numpy(), rtol=1e-12)


def fine_path(motion, x0, kappa, dt_s, substeps=200):
    """Explicit Euler in small steps."""
    (ey, epsi), s = x0[:, 4:].T.copy(), np.zeros(len(x0))
    path = []
    for k in range(motion.shape[1] - 1):
        before = s.copy()
        for i in range(substeps):
            share = (i + 0.5) / substeps
            vx, vy, yaw_rate = ((1 - share) * motion[:, k] + share * motion[:, k + 1]).T
            ds = (vx * np.cos(epsi) - vy * np.sin(epsi)) / (1 - kappa[:, k] * ey)
            dey = vx * np.sin(epsi) + vy * np.cos(epsi)
            h = dt_s / substeps
            s, ey, epsi = s + h * ds, ey + h * dey, epsi + h * (yaw_rate - kappa[:, k] * ds)
        path.append(np.stack([s - before, ey, epsi], axis=1))
    return np.stack(path, axis=1)


class Constant:
    """Predicts the same state (n,) at every time."""

    def __init__(self, state):
        self.state = state

    def predict(self, x0, past, U, W):
        return np.broadcast_to(self.state, (len(x0), U.shape[1] + 1, x0.shape[1]))


def test_the_score_of_the_mean_is_zero_and_a_model_without_finite_predictions_is_not_taken(
    toy_dataset,
):
    """The error of the mean is the variance, so the logarithm of their ratio is zero."""
    test = toy_dataset.select("test")
    mean = Constant(test.x.reshape(-1, 6).astype(float).mean(axis=0))
    assert log_error(mean, test) == pytest.approx(0.0, abs=0.02)
    off = Constant(np.full(6, np.nan))
    assert best_model([off, mean], toy_dataset) is mean
    with pytest.raises(DatasetError, match="found none"):
        best_model([off], toy_dataset)
