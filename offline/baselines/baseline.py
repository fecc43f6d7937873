"""What a baseline consists of, and the check of the arrays that it predicts from."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from offline.data.dataset import Dataset
from offline.data.manifest import describe_training
from offline.evaluation.predictor import Predictor
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import LiftSample
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
    """How a baseline is made: a row of `offline.baselines.catalogue.CATALOGUE`."""

    model_class: ModelClass
    """an evaluation names the best linear baseline"""
    fit: Callable[[Dataset], FittedBaseline]
    """fits to the training part, and chooses settings on the validation part; a function, or a
    `functools.partial` of one with its settings"""
    to_bundle: Callable[[str, Any, Dataset, LiftSample], Bundle] | None = None
    """name, fitted baseline, data, self-test instants → bundle; None if no controller can use it"""
    find_objection: Callable[[Dataset], str | None] = lambda dataset: None
    """why it cannot be fitted to these data, as the end of a sentence; None if it can"""


def describe_fit(name: str, baseline: FittedBaseline, dataset: Dataset) -> str:
    """The field `training` of the bundle of a fitted baseline, as JSON."""
    facts = {fact.name: fact.value for fact in baseline.fit_info()}
    return describe_training({"kind": name, **facts}, dataset.origin)


def require_windows(
    x0: Array,
    past: Array,
    U: Array,
    W: Array,
    signals: tuple[int, int, int],
    past_signals: int = 0,
    past_steps: int = 0,
) -> None:
    """Return if the arguments of `Predictor.predict` have the shapes that a baseline needs.

    Args:
        signals: number of states, inputs and exogenous signals that it was fitted to.
        past_signals: signals in a row of the past; 0 if the past is not used.
        past_steps: rows of the past that are needed at least.

    Raises:
        DatasetError: a shape does not fit the baseline or the other arrays.
    """
    n, m, p = signals
    batch, steps = len(x0), U.shape[1] if U.ndim > 1 else 0
    is_past = past.ndim == 3 and len(past) == batch and past.shape[1] >= past_steps
    windows = ((batch, n), (batch, steps, m), (batch, steps, p))
    if (x0.shape, U.shape, W.shape) != windows or not (
        is_past and past_signals in (0, past.shape[2])
    ):
        raise DatasetError(
            f"expected x0 (batch, {n}), past (batch, {past_steps} or more, "
            f"{past_signals or 'any'}), U (batch, K, {m}) and W (batch, K, {p}), found "
            f"{x0.shape}, {past.shape}, {U.shape} and {W.shape}. Predict on windows of the "
            f"signals that the baseline was fitted to."
        )
