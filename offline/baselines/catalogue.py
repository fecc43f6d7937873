"""The baselines: one row each. A new baseline is a fit function and a row of this table.

For the settings that a row lists, every combination is fitted, and the one with the smallest error
on the validation part is kept.
"""

from functools import partial

from offline.baselines.baseline import Baseline, FittedBaseline
from offline.baselines.bilinear import fit_bilinear
from offline.baselines.linear import (
    Persistence,
    find_objection_to_roads,
    fit_linear,
    fit_per_curvature,
    to_bundle,
)
from offline.baselines.scheduled import fit_scheduled
from offline.config import PAST_STEPS
from offline.data.dataset import Dataset


def _fit_gru(dataset: Dataset) -> FittedBaseline:
    from offline.baselines.recurrent import fit_network  # imports torch, which takes seconds

    return fit_network(dataset)


_fit_delays = partial(fit_scheduled, past_steps=(1, 2, 3, 4, 6, 8, 12, 16, PAST_STEPS))
_fit_blended = partial(
    fit_scheduled, past_steps=(2, 8, 20), knots=(2, 4, 8), ridges=(1e-10, 1e-6, 1e-4)
)

_fit_products = partial(fit_bilinear, observables=(66, 150, 300), past_steps=(4, 12))

CATALOGUE: dict[str, Baseline] = {
    "persistence": Baseline("other", lambda dataset: Persistence()),
    "lti": Baseline("linear", fit_linear, to_bundle),
    "lti-per-curvature": Baseline(
        "linear", fit_per_curvature, find_objection=find_objection_to_roads
    ),
    "dmdc-delays-path": Baseline("linear", _fit_delays),
    "lti-scheduled-delays": Baseline("linear", _fit_blended),
    "edmd-bilinear": Baseline("other", _fit_products, to_bundle),
    "gru": Baseline("recurrent", _fit_gru),
}
"""by name"""
