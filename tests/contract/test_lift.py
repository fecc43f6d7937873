"""The inputs of an encoder have one order; a history has steps and fields, or is absent."""

import pytest

from rt_controller.contract.bundle import Lift
from rt_controller.contract.errors import ArtifactError


@pytest.mark.parametrize("inputs", [("x",), ("x", "w"), ("x", "history"), ("x", "w", "history")])
def test_every_ordered_subset_with_the_states_is_a_lift(inputs: tuple[str, ...]) -> None:
    sees_history = "history" in inputs
    lift = Lift(inputs, 3 * sees_history, ("vx_mps",) * sees_history)
    assert (lift.sees_exogenous, lift.sees_history) == ("w" in inputs, sees_history)


@pytest.mark.parametrize(
    ("inputs", "steps", "fields"),
    [
        ((), 0, ()),
        (("w",), 0, ()),
        (("w", "x"), 0, ()),
        (("x", "x"), 0, ()),
        (("x", "u"), 0, ()),
        (("x", "history", "w"), 3, ("vx_mps",)),
        (("x", "history"), 0, ("vx_mps",)),
        (("x", "history"), 3, ()),
        (("x", "history"), -1, ("vx_mps",)),
        (("x",), 3, ("vx_mps",)),
        (("x",), 3, ()),
        (("x",), 0, ("vx_mps",)),
    ],
)
def test_other_inputs_and_incomplete_histories_are_refused(
    inputs: tuple[str, ...], steps: int, fields: tuple[str, ...]
) -> None:
    with pytest.raises(ArtifactError, match=r"expected .* found .* offline-export"):
        Lift(inputs, steps, fields)
