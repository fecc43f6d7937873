"""Inputs of an encoder: the states, and what a model adds to them.

The encoder itself runs in `rt_controller.control.lift`.
"""

from dataclasses import dataclass
from typing import NamedTuple

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError


@dataclass(frozen=True, slots=True)
class Lift:
    """Inputs of the encoder besides the states.

    Its ONNX inputs, all float32, are `inputs` in this order:

    - "x" (batch, n_x): the states now;
    - "w" (batch, p): the exogenous signals now; for the car the curvature of its road;
    - "history" (batch, H, h): the last H instants, oldest first. Row i holds the named states at
      instant k - H + i, and the named inputs held from that instant to the next one.

    A history has steps and fields, or neither.
    """

    sees_exogenous: bool = False
    history_steps: int = 0
    """H; 0: no history"""
    history_fields: tuple[str, ...] = ()
    """h names of states and inputs, in their order"""

    def __post_init__(self) -> None:
        if self.history_steps < 0 or (self.history_steps > 0) != bool(self.history_fields):
            raise ArtifactError(
                f"lift: expected a history with steps and fields, or neither, found history_steps "
                f"{self.history_steps} and history_fields {self.history_fields}. "
                f"Run offline-export again."
            )

    @property
    def sees_history(self) -> bool:
        return self.history_steps > 0

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("x", *("w",) * self.sees_exogenous, *("history",) * self.sees_history)


STATES_ONLY = Lift()
"""Paper: eq. (7)"""


class LiftSample(NamedTuple):
    """Encoder inputs for several instants; float64, in physical units.

    All three are present, whatever the encoder uses; without a history H and h are 0.
    """

    x: Array
    """(b, n_x)"""
    w: Array
    """(b, p)"""
    history: Array
    """(b, H, h)"""


OPSET = 18
IR_VERSION = 10
"""of the file format, low enough for every onnxruntime that this project supports"""


def identity_encoder(states: int) -> bytes:
    """An ONNX model that returns its input "x" (batch, states) float32 as "psi"."""

    def tensor(name: bytes) -> bytes:
        """A ValueInfoProto of float32 numbers (1)."""
        shape = message((1, message((2, b"batch"))), (1, message((1, states))))
        return message((1, name), (2, message((1, message((1, 1), (2, shape))))))

    node = message((1, b"x"), (2, b"psi"), (4, b"Identity"))
    graph = message((1, node), (2, b"lift"), (11, tensor(b"x")), (12, tensor(b"psi")))
    return message((1, IR_VERSION), (7, graph), (8, message((1, b""), (2, OPSET))))


def message(*fields: tuple[int, int | bytes]) -> bytes:
    """A protobuf message of numbered fields: whole numbers, and contents with their length."""
    return b"".join(
        _varint(number << 3) + _varint(content)
        if isinstance(content, int)
        else _varint(number << 3 | 2) + _varint(len(content)) + content
        for number, content in fields
    )


def _varint(number: int) -> bytes:
    if number < 0x80:
        return bytes([number])
    return bytes([number & 0x7F | 0x80]) + _varint(number >> 7)
