"""Fair linear baseline: one linear model with offset for all speeds and roads, by least squares.

It starts from the measured state and is fitted to all transitions of the training part at once.
"""

from offline.baselines.baseline import Baseline
from offline.baselines.linear_model import LinearModel, fit_one_step, to_bundle
from offline.data.dataset import Dataset


def fit_linear(dataset: Dataset) -> LinearModel:
    """The one-step least-squares model of the training part."""
    return LinearModel(fit_one_step(dataset.select("train"), dataset.schema, dataset.roles))


BASELINE = Baseline(fit=fit_linear, to_bundle=to_bundle, model_class="linear")
