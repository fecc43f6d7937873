"""The best linear model of the motion, with past and blended over speed, on the whole horizon.

Past, knots and ridge are those of the best one-step fit; from there it is trained on the error over
two seconds. The path follows by kinematics.
"""

from offline.baselines.baseline import Baseline
from offline.baselines.catalogue.lti_scheduled_delays import SETTINGS
from offline.baselines.scheduled.fit import fit_linear_models
from offline.baselines.scheduled.model import ScheduledModel
from offline.data.dataset import Dataset


def fit_scheduled_on_horizon(dataset: Dataset) -> ScheduledModel:
    """The model with the smallest validation score on the descent from the one-step fit."""
    from offline.baselines.scheduled.horizon import Descent, descend

    # With its many parameters the validation error soon rises again.
    return descend(fit_linear_models(dataset, SETTINGS), dataset, Descent(20, check_every=5))


BASELINE = Baseline(fit=fit_scheduled_on_horizon, model_class="linear")
