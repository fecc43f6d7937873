"""The inputs of an encoder have one order; a history has steps and fields, or is absent."""

import pytest

from rt_controller.contract.errors import ArtifactError
from rt_controller.model.lift import Lift


def test_the_inputs_have_one_order():
    assert Lift().inputs == ("x",)
    assert Lift(sees_exogenous=True).inputs == ("x", "w")
    assert Lift(False, 3, ("vx_mps",)).inputs == ("x", "history")
    assert Lift(True, 3, ("vx_mps",)).inputs == ("x", "w", "history")


@pytest.mark.parametrize(("steps", "fields"), [(0, ("vx_mps",)), (3, ()), (-1, ("vx_mps",))])
def test_an_incomplete_history_is_refused(steps, fields):
    with pytest.raises(ArtifactError, match=r"expected .* found .* offline-export"):
        Lift(history_steps=steps, history_fields=fields)
