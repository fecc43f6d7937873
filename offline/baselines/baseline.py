"""What a baseline consists of.

The modules of the catalogue import it, so it imports neither the registry nor what simulates the
data: the cache of fitted baselines depends on all that a baseline imports.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from offline.data.dataset import Dataset
from offline.data.provenance import describe_training
from offline.evaluation.predictor import Predictor
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.lift import LiftSample
from rt_controller.report.table import Fact

ModelClass = Literal["linear", "recurrent", "other"]
"""linear: in states, past and inputs, also scheduled by speed or road, without other observables"""


class FittedBaseline(Predictor, Protocol):
    """A baseline after its fit: a predictor that can be pickled."""

    def fit_info(self) -> tuple[Fact, ...]:
        """What the fit chose and found."""
        ...


@dataclass(frozen=True, slots=True)
class Baseline:
    """How a baseline is made; each module of the catalogue has one as `BASELINE`."""

    fit: Callable[[Dataset], FittedBaseline]
    """fits to the training part, and chooses settings on the validation part"""
    fit_short: Callable[[Dataset], FittedBaseline] | None = None
    """the same with less training, where a fit takes long; None: a fit is short"""
    find_objection: Callable[[Dataset], str | None] = lambda dataset: None
    """why it cannot be fitted to these data, as the end of a sentence; None if it can"""
    to_bundle: Callable[[str, Any, Dataset, LiftSample], Bundle] | None = None
    """name, fitted baseline, data, self-test instants → bundle; None if no controller can use it"""
    model_class: ModelClass = "other"
    """an evaluation compares with the best linear and the best recurrent baseline"""


def describe_fit(name: str, baseline: FittedBaseline, dataset: Dataset) -> str:
    """The field `training` of the bundle of a fitted baseline, as JSON."""
    facts = {fact.name: fact.value for fact in baseline.fit_info()}
    return describe_training({"kind": name, **facts}, dataset.origin)
