"""A linear model of the physical states with an offset: its one-step fit and its bundle."""

from dataclasses import dataclass

import numpy as np

from offline.baselines.baseline import describe_fit
from offline.baselines.window_shape import require_windows
from offline.data.dataset import Dataset
from offline.data.signals import Roles, Scaling, fit_scaling
from offline.data.trajectories import Trajectories
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bundle import Bundle, spectral_radius_of
from rt_controller.contract.model.identity_encoder import identity_encoder
from rt_controller.contract.model.lift import Lift, LiftSample
from rt_controller.contract.model.rollout import Matrices, roll_out
from rt_controller.contract.schema import Schema
from rt_controller.report.table import Fact

_CHUNK = 1_000
"""trajectories whose transitions are factorised at once"""


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


def to_bundle(name: str, model: LinearModel, dataset: Dataset, sample: LiftSample) -> Bundle:
    """A bundle whose lift is the identity; `sample` are instants for its self-test."""
    return Bundle(
        name=name,
        schema=dataset.schema,
        geometry=dataset.geometry,
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
