"""Persistence, the path from motion, and the validation score."""

import numpy as np
import pytest
import torch

from offline.baselines.fitting import log_error
from offline.baselines.linear import Persistence
from offline.baselines.road_path import path_states


def test_persistence_predicts_the_first_state():
    x0 = np.arange(12.0).reshape(2, 6)
    predicted = Persistence().predict(
        x0, np.zeros((2, 20, 6)), np.zeros((2, 3, 3)), np.zeros((2, 3, 1))
    )
    assert predicted.shape == (2, 4, 6)
    assert np.array_equal(predicted, np.repeat(x0[:, None], 4, axis=1))


def test_path_agrees_with_integration_in_small_steps():
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


def test_path_is_the_same_in_numpy_and_torch(toy_dataset):
    x, _, w = (series.astype(np.float64) for series in toy_dataset.select("test")[:3])
    args = x[..., :3], x[:, 0], w[..., 0]
    by_numpy = path_states(np, *args, 0.025)
    by_torch = path_states(torch, *(torch.from_numpy(each) for each in args), 0.025)
    assert np.allclose(by_numpy, by_torch.numpy(), rtol=1e-12)


def test_score_is_infinite_if_a_prediction_is_not_finite(toy_dataset):
    class Off:
        def predict(self, x0, past, U, W):
            return np.full((len(x0), U.shape[1] + 1, 6), np.nan)

    assert log_error(Off(), toy_dataset.select("test")) == np.inf


def test_score_of_the_mean_is_zero(toy_dataset):
    """Its error is the variance, so the logarithm of their ratio is zero."""
    test = toy_dataset.select("test")

    class Mean:
        def predict(self, x0, past, U, W):
            mean = test.x.reshape(-1, 6).astype(float).mean(axis=0)
            return np.broadcast_to(mean, (len(x0), U.shape[1] + 1, 6))

    assert log_error(Mean(), test) == pytest.approx(0.0, abs=0.02)
