"""What a baseline consists of, its bundle, and the check of the arrays that it predicts from."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from offline.data.dataset import Dataset
from offline.data.signals import Scaling, last_rows
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


def scale_windows(
    scaling: Scaling, past_steps: int, x0: Array, past: Array, U: Array, W: Array
) -> tuple[Array, Array, Array, Array]:
    """Scaled x0, U, W and last `past_steps` rows of the past; arguments of `Predictor.predict`.

    Raises:
        DatasetError: a shape does not fit the baseline or the other arrays.
    """
    n, m, p, h = map(len, (scaling.x_scale, scaling.u_scale, scaling.w_scale, scaling.past_scale))
    found = tuple(each.shape for each in (x0, past, U, W))
    batch, steps, rows = len(x0), *(part.shape[1] if part.ndim > 1 else 0 for part in (U, past))
    expected = ((batch, n), (batch, rows, h), (batch, steps, m), (batch, steps, p))
    if found != expected or rows < past_steps:
        raise DatasetError(
            f"expected x0 (batch, {n}), past (batch, {past_steps} or more, {h}), U (batch, K, {m}) "
            f"and W (batch, K, {p}), found {', '.join(map(str, found))}. Predict on windows of the "
            f"signals that the baseline was fitted to."
        )
    rows_of_past = (last_rows(past, past_steps) - scaling.past_centre) / scaling.past_scale
    return scaling.normalise_states(x0), U / scaling.u_scale, W / scaling.w_scale, rows_of_past
