"""The best one-step linear model of many trajectories, to the accuracy of an orthogonal solver."""

import numpy as np
from numpy.typing import NDArray

from offline.baselines.linear_model import LinearModel
from offline.roles import Roles
from offline.scaling import Scaling, fit_scaling
from offline.trajectories import Trajectories
from rt_controller.contract.schema import Schema

Array = NDArray[np.float64]

_CHUNK = 1_000


def fit_one_step(
    train: Trajectories, schema: Schema, roles: Roles, sees_exogenous: bool = True
) -> LinearModel:
    """x_(k+1) = A x_k + B_uc u_k + B_uw w_k + c, by least squares over all transitions.

    Where the exogenous signals never change they cannot be told from the offset: without
    `sees_exogenous` B_uw is zero.
    """
    scaling = fit_scaling(train, schema, roles)
    A, B, offset = _solve(train, scaling, sees_exogenous)

    # From scaled to physical: x = S x_n + m, u = U u_n.
    S, m = scaling.x_scale, scaling.x_centre
    driven = np.concatenate([scaling.u_scale, scaling.w_scale])[: B.shape[1]]
    A_physical = A * S[:, None] / S[None, :]
    B_physical = B * S[:, None] / driven[None, :]
    inputs = len(schema.inputs)
    B_uw = B_physical[:, inputs:] if sees_exogenous else np.zeros((len(A), len(schema.exogenous)))
    return LinearModel(
        A=A_physical,
        B_uc=np.ascontiguousarray(B_physical[:, :inputs]),
        B_uw=np.ascontiguousarray(B_uw),
        c=m + S * offset - A_physical @ m,
    )


def _solve(train: Trajectories, scaling: Scaling, sees_exogenous: bool) -> tuple[Array, ...]:
    """A (n, n), B (n, m + p) and offset (n,) on scaled numbers.

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
    solution = np.asarray(found.T, dtype=np.float64)
    return solution[:, :n], solution[:, n:-1], solution[:, -1]
