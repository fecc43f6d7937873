"""A linear model for each road of the library, blended on the roads between."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.baselines.finding import Finding
from offline.baselines.least_squares import fit_one_step
from offline.baselines.window_shape import WindowShape
from offline.dataset import Dataset
from rt_controller.contract.errors import DatasetError

Array = NDArray[np.float64]

_SAME_ROAD_PER_M = 1e-9


@dataclass(frozen=True, slots=True)
class LinearByCurvature:
    """x_(k+1) = A x_k + B_uc u_k + c, with matrices of the curvature that a prediction starts on.

    Between two learned curvatures the matrices are interpolated linearly; beyond the ends those
    of the end hold.
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
        """States (batch, K+1, n); W[:, 0, 0] is the curvature, the past is not looked at.

        Raises:
            DatasetError: the shapes are not those of the data it was fitted to.
        """
        _, n, m = self.B_uc.shape
        WindowShape(n, m, 1).require(x0, past, U, W)
        states = np.empty((len(x0), U.shape[1] + 1, n))
        states[:, 0] = x0
        for kappa in np.unique(W[:, 0, 0]):
            on_it = W[:, 0, 0] == kappa
            share = self._shares(float(kappa))
            A, B, c = (np.tensordot(share, each, 1) for each in (self.A, self.B_uc, self.c))
            driven = U[on_it] @ B.T + c
            x = x0[on_it]
            for k in range(U.shape[1]):
                x = x @ A.T + driven[:, k]
                states[on_it, k + 1] = x
        return states

    def findings(self) -> tuple[Finding, ...]:
        """The roads that have a model of their own."""
        roads = ", ".join(f"{kappa:g}" for kappa in self.curvature_per_m)
        return (Finding("curvatures in 1/m", roads),)

    def _shares(self, kappa: float) -> Array:
        """(C,) what each learned curvature contributes; they sum to 1."""
        every = np.eye(len(self.curvature_per_m))
        return np.array([np.interp(kappa, self.curvature_per_m, one) for one in every])


def fit_by_curvature(dataset: Dataset) -> LinearByCurvature:
    """One least-squares model for each curvature of the training part.

    Raises:
        DatasetError: the data know no roads.
    """
    if dataset.manifest.roads is None or len(dataset.schema.exogenous) != 1:
        raise DatasetError(
            "expected data whose only exogenous signal is the curvature of known roads, to fit a "
            f"model to each road, found {', '.join(dataset.schema.exogenous_names) or 'none'} and "
            f"roads {dataset.manifest.roads}. Leave out the rival lti-per-curvature."
        )
    train = dataset.select("train")
    driven_on = train.w[:, 0, 0].astype(np.float64)
    curvatures = np.array(sorted(set(dataset.manifest.roads.curvatures_per_m)))
    is_on = np.abs(driven_on[:, None] - curvatures) < _SAME_ROAD_PER_M
    curvatures, is_on = curvatures[is_on.any(axis=0)], is_on[:, is_on.any(axis=0)]
    models = [
        fit_one_step(train.take(on_it), dataset.schema, dataset.roles, sees_exogenous=False)
        for on_it in is_on.T
    ]
    return LinearByCurvature(
        curvature_per_m=curvatures,
        A=np.stack([model.A for model in models]),
        B_uc=np.stack([model.B_uc for model in models]),
        c=np.stack([model.c for model in models]),
    )
