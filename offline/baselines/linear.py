"""Persistence, a linear model with offset for all roads, and one for each road.

The linear models are fitted to all transitions of the training part at once, by least squares; they
start from the measured state and do not use the past.
"""

from dataclasses import dataclass

import numpy as np

from offline.baselines.baseline import describe_fit, require_windows
from offline.data.dataset import Dataset
from offline.data.signals import Roles, Scaling, Trajectories, fit_scaling
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema
from rt_controller.model.bundle import Bundle, spectral_radius_of
from rt_controller.model.dynamics import Matrices, roll_out
from rt_controller.model.lift import Lift, LiftSample, identity_encoder
from rt_controller.report.table import Fact

_CHUNK = 1_000
"""trajectories whose transitions are factorised at once"""
_SAME_ROAD_PER_M = 1e-9


@dataclass(frozen=True, slots=True)
class Persistence:
    """Predicts the first state for all steps."""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), all equal to x0 (batch, n)."""
        return np.repeat(x0[:, None, :], U.shape[1] + 1, axis=1)

    def fit_info(self) -> tuple[Fact, ...]:
        """Nothing: there is nothing to fit."""
        return ()


@dataclass(frozen=True, slots=True)
class LinearModel:
    """x_(k+1) = A x_k + B_uc u_k + B_uw w_k + c in physical units."""

    matrices: Matrices

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`; the past is not used."""
        n, m, p = len(self.matrices.A), self.matrices.B_uc.shape[1], self.matrices.B_uw.shape[1]
        require_windows(x0, past, U, W, (n, m, p))
        return roll_out(self.matrices, x0, U, W, n)

    def fit_info(self) -> tuple[Fact, ...]:
        """Largest absolute eigenvalue; above 1 predictions can grow."""
        radius = spectral_radius_of(self.matrices.A)
        return (Fact("spectral radius", f"{radius:.5f}"),)


@dataclass(frozen=True, slots=True)
class LinearPerCurvature:
    """x_(k+1) = A x_k + B_uc u_k + c, with the matrices of the curvature at the start.

    They are interpolated linearly between the C fitted curvatures and constant beyond them.
    """

    curvature_per_m: Array
    """(C,) ascending"""
    A: Array
    """(C, n, n)"""
    B_uc: Array
    """(C, n, m)"""
    c: Array
    """(C, n)"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`; W[:, 0, 0] is the curvature."""
        _, n, m = self.B_uc.shape
        require_windows(x0, past, U, W, (n, m, 1))
        states = np.empty((len(x0), U.shape[1] + 1, n))
        for kappa in np.unique(W[:, 0, 0]):
            at = W[:, 0, 0] == kappa
            states[at] = self._model_at(float(kappa)).predict(x0[at], past[at], U[at], W[at])
        return states

    def fit_info(self) -> tuple[Fact, ...]:
        """The curvatures that have a model."""
        roads = ", ".join(f"{kappa:g}" for kappa in self.curvature_per_m)
        return (Fact("curvatures in 1/m", roads),)

    def _model_at(self, kappa: float) -> LinearModel:
        weights = [np.interp(kappa, self.curvature_per_m, row) for row in np.eye(len(self.A))]
        A, B, c = (np.tensordot(weights, each, 1) for each in (self.A, self.B_uc, self.c))
        return LinearModel(Matrices(A, B, np.zeros((len(c), 1)), c))


def fit_linear(dataset: Dataset) -> LinearModel:
    """The one-step least-squares model of the training part."""
    return LinearModel(fit_one_step(dataset.select("train"), dataset.schema, dataset.roles))


def find_objection_to_roads(dataset: Dataset) -> str | None:
    """The data need roads, and curvature as their only exogenous signal."""
    if dataset.manifest.roads is None:
        return "the data have no roads"
    if len(dataset.schema.exogenous) != 1:
        return "the data have other exogenous signals than curvature"
    return None


def fit_per_curvature(dataset: Dataset) -> LinearPerCurvature:
    """One least-squares model for each curvature of the training part."""
    roads = dataset.manifest.roads
    train = dataset.select("train")
    curvature = train.w[:, 0, 0].astype(np.float64)
    curvatures = np.unique(roads.curvatures_per_m if roads else ())
    is_on = np.abs(curvature[:, None] - curvatures) < _SAME_ROAD_PER_M
    curvatures, is_on = curvatures[is_on.any(axis=0)], is_on[:, is_on.any(axis=0)]
    models = [
        fit_one_step(train.take(rows), dataset.schema, dataset.roles, sees_exogenous=False)
        for rows in is_on.T
    ]
    A, B_uc, c = (
        np.stack([getattr(matrices, name) for matrices in models]) for name in ("A", "B_uc", "c")
    )
    return LinearPerCurvature(curvatures, A, B_uc, c)


def to_bundle(name: str, model: LinearModel, dataset: Dataset, sample: LiftSample) -> Bundle:
    """A bundle whose lift is the identity; `sample` are instants for its self-test."""
    return Bundle(
        name=name,
        schema=dataset.schema,
        car=dataset.car,
        **model.matrices._asdict(),
        lift=Lift(),
        encoder_onnx=identity_encoder(sample.x.shape[1]),
        selftest=LiftSample(sample.x, sample.w, np.zeros((len(sample.x), 0, 0))),
        selftest_psi=sample.x.copy(),
        training=describe_fit(name, model, dataset),
        data_sha256=dataset.sha256,
    )


def fit_one_step(
    train: Trajectories, schema: Schema, roles: Roles, sees_exogenous: bool = True
) -> Matrices:
    """The matrices in physical units, by least squares over all transitions.

    Without `sees_exogenous` B_uw is zero: exogenous signals that never change cannot be told from
    the offset.
    """
    scaling = fit_scaling(train, schema, roles)
    return scaling.to_physical(_solve(train, scaling, sees_exogenous))


def _solve(train: Trajectories, scaling: Scaling, sees_exogenous: bool) -> Matrices:
    """The matrices of scaled signals.

    The triangular factor of [regressors, targets] is updated chunk by chunk: the accuracy of a QR
    factorisation of all transitions, in the memory of one chunk. Speed and progress are nearly
    proportional, so normal equations would square a large condition number.
    """
    n = train.x.shape[2]
    R = np.zeros((0, 0))
    for first in range(0, len(train.episode), _CHUNK):
        chunk = train.take(slice(first, first + _CHUNK))
        x = scaling.normalise_states(chunk.x)
        driven = [chunk.u / scaling.u_scale]
        if sees_exogenous:
            driven.append(chunk.w / scaling.w_scale)
        ones = np.ones((*chunk.u.shape[:2], 1))
        rows = np.concatenate([x[:, :-1], *driven, ones, x[:, 1:]], axis=-1)
        rows = rows.reshape(-1, rows.shape[-1])
        _, R = np.linalg.qr(np.vstack([R.reshape(-1, rows.shape[1]), rows]))
    found, *_ = np.linalg.lstsq(R[:, :-n], R[:, -n:], rcond=None)
    m, p = len(scaling.u_scale), len(scaling.w_scale)
    A, B_uc, B_uw, c = np.split(found.T, [n, n + m, found.shape[0] - 1], axis=1)
    return Matrices(A, B_uc, B_uw if sees_exogenous else np.zeros((n, p)), c[:, 0])
