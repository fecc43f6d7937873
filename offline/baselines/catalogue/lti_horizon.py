"""A linear model of the physical states, trained on the error over two seconds.

It shows what lifting adds: a lifted model is trained on the same error and the same trajectories,
but has observables beyond the states.
"""

import numpy as np

from offline.baselines.baseline import Baseline
from offline.baselines.linear_model import LinearModel, to_bundle
from offline.baselines.scheduled.fit import LinearSettings, fit_linear_models
from offline.baselines.scheduled.model import ScheduledModel
from offline.data.dataset import Dataset
from rt_controller.contract.model.rollout import Matrices


def fit_on_horizon(dataset: Dataset, iterations: int = 300) -> LinearModel:
    """The linear model with the smallest validation score on the descent from the one-step fit."""
    from offline.baselines.scheduled.horizon import Descent, descend

    start = fit_linear_models(dataset, LinearSettings(has_exact_path=False))
    return time_invariant(descend(start, dataset, Descent(iterations)))


def time_invariant(model: ScheduledModel) -> LinearModel:
    """The matrices of a model of all states with one knot and without a past."""
    scaling, theta = model.structure.scaling, model.theta[0]
    n, m, p = len(theta), len(scaling.u_scale), len(scaling.w_scale)
    A, B_uc, B_uw, c = np.split(theta, [n, n + m, n + m + p], axis=1)
    return LinearModel(scaling.to_physical(Matrices(np.eye(n) + A, B_uc, B_uw, c[:, 0])))


BASELINE = Baseline(fit=fit_on_horizon, to_bundle=to_bundle, model_class="linear")
