"""A linear model for each curvature of the data, interpolated for curvatures in between."""

from dataclasses import dataclass

import numpy as np

from offline.baselines.baseline import Baseline
from offline.baselines.linear_model import LinearModel, fit_one_step
from offline.baselines.window_shape import require_windows
from offline.data.dataset import Dataset
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.rollout import Matrices
from rt_controller.report.table import Fact

_SAME_ROAD_PER_M = 1e-9


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


def find_objection(dataset: Dataset) -> str | None:
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


BASELINE = Baseline(fit=fit_per_curvature, find_objection=find_objection, model_class="linear")
