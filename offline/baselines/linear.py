"""Persistence, a linear model with offset for all roads, and one for each road.

The linear models are fitted to all transitions of the training part at once, by least squares; they
start from the measured state and do not use the past.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from offline.baselines.fitting import scale_windows
from offline.data.dataset import Dataset
from offline.data.manifest import describe_training
from offline.data.signals import Scaling, Trajectories, fit_scaling, last_rows, past_names
from offline.data.validity import validity_of
from rt_controller.contract.arrays import Array
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


@dataclass(frozen=True)
class LinearModel:
    """psi_(k+1) = A psi_k + B_uc u_k + B_uw w_k + c of scaled signals, here with psi = x."""

    scaling: Scaling
    matrices: Matrices

    @property
    def past_steps(self) -> int:
        """Rows of the past in psi."""
        return 0

    def lift(self, x: Array, w: Array, past: Array) -> Array:
        """psi (..., n) of scaled x (..., n_x), w (..., p) and past (..., past_steps, h)."""
        return x

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n_x), as `Predictor.predict`."""
        scaling = self.scaling
        x, u, w, rows = scale_windows(scaling, self.past_steps, x0, past, U, W)
        with np.errstate(over="ignore", invalid="ignore"):
            states = roll_out(self.matrices, self.lift(x, w[:, 0], rows), u, w, x.shape[1])
            states = states * scaling.x_scale + scaling.x_centre
        states[:, 0] = x0
        return states

    def fit_info(self) -> tuple[Fact, ...]:
        """Largest absolute eigenvalue; above 1 predictions can grow."""
        return (Fact("spectral radius", f"{spectral_radius_of(self.matrices.A):.5f}"),)

    def encoder(self, n: int) -> tuple[bool, bytes]:
        """Whether the lift reads w, and the lift to n observables in ONNX, in physical units."""
        return False, identity_encoder(n)


@dataclass(frozen=True, slots=True)
class LinearPerCurvature:
    """A linear model, with the matrices of the curvature at the start.

    They are interpolated linearly between the C fitted curvatures and constant beyond them.
    """

    scaling: Scaling
    models: Mapping[float, Matrices]
    """C, by ascending curvature in 1/m"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`; W[:, 0, 0] is the curvature."""
        states = np.empty((len(x0), U.shape[1] + 1, x0.shape[1]))
        parts = [np.stack(p) for p in zip(*(m[:4] for m in self.models.values()), strict=True)]
        for kappa in np.unique(W[:, 0, 0]):
            at = W[:, 0, 0] == kappa
            shares = [np.interp(kappa, [*self.models], row) for row in np.eye(len(self.models))]
            A, B_uc, B_uw, c = (np.tensordot(shares, part, 1) for part in parts)
            model = LinearModel(self.scaling, Matrices(A, B_uc, B_uw, c))
            states[at] = model.predict(x0[at], past[at], U[at], W[at])
        return states


def fit_linear(dataset: Dataset) -> LinearModel:
    """The one-step least-squares model of the training part, in physical units."""
    matrices = _fit_one_step(dataset.select("train"), dataset, sees_exogenous=True)
    return LinearModel(_unscaled(dataset), matrices)


def to_bundle(name: str, model: LinearModel, dataset: Dataset, sample: LiftSample) -> Bundle:
    """The model as a bundle, its scaling folded into the matrices.

    `sample` are instants with at least the past that the model needs.
    """
    no_inputs = np.zeros((len(sample.x), 1, len(model.scaling.u_scale)))
    windows = (sample.x, sample.history, no_inputs, sample.w[:, None])
    x, _, w, rows = scale_windows(model.scaling, model.past_steps, *windows)
    psi = model.lift(x, w[:, 0], rows).copy()
    psi[:, : x.shape[1]] = sample.x
    fields = past_names(dataset.schema, dataset.roles) if model.past_steps else ()
    history = last_rows(sample.history, model.past_steps)[..., : len(fields)]
    reads_w, encoder = model.encoder(psi.shape[1])
    facts = {fact.name: fact.value for fact in model.fit_info()}
    return Bundle(
        name=name,
        schema=dataset.schema,
        car=dataset.car,
        **model.scaling.to_physical(model.matrices)._asdict(),
        lift=Lift(reads_w, model.past_steps, fields),
        encoder_onnx=encoder,
        selftest=LiftSample(sample.x, sample.w, history),
        selftest_psi=psi,
        training=describe_training({"kind": name, **facts}, dataset.origin),
        data_sha256=dataset.sha256,
        validity=validity_of(dataset, has_near_roads=False),
    )


def find_objection_to_roads(dataset: Dataset) -> str | None:
    """The data need roads, and curvature as their only exogenous signal."""
    if dataset.manifest.roads is None:
        return "the data have no roads"
    if len(dataset.schema.exogenous) != 1:
        return "the data have other exogenous signals than curvature"
    return None


def fit_per_curvature(dataset: Dataset) -> LinearPerCurvature:
    """One least-squares model for each curvature of the training part, in physical units."""
    roads, train, models = dataset.manifest.roads, dataset.select("train"), {}
    for kappa in np.unique(roads.curvatures_per_m if roads else ()).tolist():
        is_on = np.abs(train.w[:, 0, 0].astype(np.float64) - kappa) < _SAME_ROAD_PER_M
        if is_on.any():
            models[kappa] = _fit_one_step(train.take(is_on), dataset, sees_exogenous=False)
    return LinearPerCurvature(_unscaled(dataset), models)


def _unscaled(dataset: Dataset) -> Scaling:
    """Physical units; a roll-out in them has the rounding errors of the bundle's."""
    names, past = dataset.schema, past_names(dataset.schema, dataset.roles)
    x, u, w, row = (
        np.ones(len(each)) for each in (names.states, names.inputs, names.exogenous, past)
    )
    return Scaling(0.0 * x, x, u, w, 0.0 * row, row)


def _fit_one_step(train: Trajectories, dataset: Dataset, sees_exogenous: bool) -> Matrices:
    """The matrices in physical units, by least squares over all transitions.

    Without `sees_exogenous` B_uw is zero: exogenous signals that never change cannot be told from
    the offset.

    The triangular factor of [regressors, targets] is updated chunk by chunk: the accuracy of a QR
    factorisation of all transitions, in the memory of one chunk. Speed and progress are nearly
    proportional, so normal equations would square a large condition number.
    """
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    n, m, p = train.x.shape[2], len(scaling.u_scale), len(scaling.w_scale) * sees_exogenous
    R = np.zeros((0, 2 * n + m + p + 1))
    for first in range(0, len(train.episode), _CHUNK):
        chunk = train.take(slice(first, first + _CHUNK))
        x, w = scaling.normalise_states(chunk.x), (chunk.w / scaling.w_scale)[..., :p]
        ones = np.ones((*chunk.u.shape[:2], 1))
        rows = np.concatenate([x[:, :-1], chunk.u / scaling.u_scale, w, ones, x[:, 1:]], axis=-1)
        _, R = np.linalg.qr(np.vstack([R, rows.reshape(-1, R.shape[1])]))
    found, *_ = np.linalg.lstsq(R[:, :-n], R[:, -n:], rcond=None)
    A, B_uc, B_uw, c = np.split(found.T, [n, n + m, n + m + p], axis=1)
    B_uw = B_uw if sees_exogenous else np.zeros((n, len(scaling.w_scale)))
    return scaling.to_physical(Matrices(A, B_uc, B_uw, c[:, 0]))
