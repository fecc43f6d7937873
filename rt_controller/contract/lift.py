"""What the encoder of a model is shown."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.errors import ArtifactError

Array = NDArray[np.float64]

POSSIBLE_INPUTS = ("x", "w", "history")


@dataclass(frozen=True, slots=True)
class Lift:
    """What the encoder is shown; the names of its ONNX inputs, in this order, all float32.

    - "x" (batch, n_x): the states now;
    - "w" (batch, p): the exogenous signals now, for the car its road's curvature;
    - "history" (batch, H, h): the last H instants, oldest first. Row i holds the named states at
      instant k - H + i, and the named inputs held from that instant to the next one.

    Raises:
        ArtifactError: inputs out of order or unknown, or a history without rows or fields.
    """

    inputs: tuple[str, ...] = ("x",)
    """an ordered part of ("x", "w", "history") that begins with "x" """
    history_steps: int = 0
    """H"""
    history_fields: tuple[str, ...] = ()
    """h names of states and inputs, in their order"""

    def __post_init__(self) -> None:
        in_order = tuple(name for name in POSSIBLE_INPUTS if name in self.inputs)
        if self.inputs != in_order or "x" not in self.inputs:
            raise ArtifactError(
                f"lift_inputs: expected an ordered part of {POSSIBLE_INPUTS} that begins with "
                f"'x', found {self.inputs}. Run offline-export again."
            )
        shown = ("history" in self.inputs, self.history_steps > 0, len(self.history_fields) > 0)
        if self.history_steps < 0 or len(set(shown)) > 1:
            raise ArtifactError(
                f"lift: expected a history with steps and fields, or neither of the three, found "
                f"inputs {self.inputs}, history_steps {self.history_steps} and history_fields "
                f"{self.history_fields}. Run offline-export again."
            )

    @property
    def sees_exogenous(self) -> bool:
        return "w" in self.inputs

    @property
    def sees_history(self) -> bool:
        return "history" in self.inputs


STATES_ONLY = Lift()
"""the paper's: eq. (7)"""


class LiftSample(NamedTuple):
    """What an encoder may be shown, for several instants; float64, in physical units.

    All three are there, whatever the encoder looks at; a history it has none of has no entries.
    """

    x: Array
    """(b, n_x)"""
    w: Array
    """(b, p)"""
    history: Array
    """(b, H, h)"""
