"""ONNX models written byte by byte: the controller's own tests run where there is no onnx package.

As much of the protocol-buffer format as an encoder of one layer needs.
"""

from collections.abc import Sequence

import numpy as np

from rt_controller.model.lift import IR_VERSION, OPSET, message

FLOAT, DOUBLE, INT64 = 1, 11, 7

Shape = Sequence[str | int]


def model(
    nodes: Sequence[bytes],
    inputs: Sequence[bytes],
    outputs: Sequence[bytes],
    constants: Sequence[bytes] = (),
) -> bytes:
    """A ModelProto."""
    parts = ((1, nodes), (2, [b"lift"]), (5, constants), (11, inputs), (12, outputs))
    graph = [(number, each) for number, contents in parts for each in contents]
    return message((1, IR_VERSION), (7, message(*graph)), (8, message((1, b""), (2, OPSET))))


def node(operator: str, inputs: Sequence[str], output: str, axis: int | None = None) -> bytes:
    """A NodeProto with at most the one attribute that an encoder needs."""
    attributes = [] if axis is None else [(5, message((1, b"axis"), (3, axis), (20, 2)))]
    names = [(1, name.encode()) for name in inputs]
    return message(*names, (2, output.encode()), (4, operator.encode()), *attributes)


def value(name: str, shape: Shape, kind: int = FLOAT) -> bytes:
    """A ValueInfoProto; a word in the shape is a dimension that is open."""
    sizes = [(1, each) if isinstance(each, int) else (2, each.encode()) for each in shape]
    dimensions = message(*((1, message(size)) for size in sizes))
    return message((1, name.encode()), (2, message((1, message((1, kind), (2, dimensions))))))


def constant(name: str, numbers: np.ndarray) -> bytes:
    """A TensorProto of float32 or int64 numbers."""
    kind = INT64 if numbers.dtype == np.int64 else FLOAT
    raw = numbers.astype("<i8" if kind == INT64 else "<f4").tobytes()
    sizes = [(1, size) for size in numbers.shape]
    return message(*sizes, (2, kind), (8, name.encode()), (9, raw))


def passes_on(
    inputs: Sequence[tuple[str, Shape]] = (("x", ("batch", 6)),),
    outputs: Sequence[tuple[str, Shape]] = (("psi", ("batch", 6)),),
    kind: int = FLOAT,
) -> bytes:
    """A model that passes its first input on, to each of its outputs."""
    return model(
        [node("Identity", [inputs[0][0]], name) for name, _ in outputs],
        [value(name, shape, kind) for name, shape in inputs],
        [value(name, shape, kind) for name, shape in outputs],
    )
