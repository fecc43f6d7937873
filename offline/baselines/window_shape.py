"""Check of the arrays that a fitted baseline predicts from."""

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError


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
