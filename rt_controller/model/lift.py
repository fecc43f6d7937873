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
    node = _field(1, b"x") + _field(2, b"psi") + _field(4, b"Identity")
    graph = _field(1, node) + _field(2, b"lift")
    graph += _field(11, _tensor(b"x", states)) + _field(12, _tensor(b"psi", states))
    opset = _field(1, b"") + _field(2, OPSET)
    return _field(1, IR_VERSION) + _field(7, graph) + _field(8, opset)


def _tensor(name: bytes, columns: int) -> bytes:
    """A ValueInfoProto of float32 numbers (1) of shape ("batch", columns)."""
    shape = _field(1, _field(2, b"batch")) + _field(1, _field(1, columns))
    return _field(1, name) + _field(2, _field(1, _field(1, 1) + _field(2, shape)))


def _field(number: int, content: bytes | int) -> bytes:
    """A field of a protobuf message."""
    if isinstance(content, int):
        return _varint(number << 3) + _varint(content)
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _varint(number: int) -> bytes:
    encoded = bytearray()
    while number >= 0x80:
        encoded.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*encoded, number])
