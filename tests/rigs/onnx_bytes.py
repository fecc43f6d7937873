"""ONNX models written byte by byte: the controller's own tests run where there is no onnx package.

As much of the protocol-buffer format as an encoder of one layer needs.
"""

from collections.abc import Sequence

import numpy as np

FLOAT, DOUBLE, INT64 = 1, 11, 7
OPSET = 18
IR_VERSION = 10

Shape = Sequence[str | int]


def model(
    nodes: Sequence[bytes],
    inputs: Sequence[bytes],
    outputs: Sequence[bytes],
    constants: Sequence[bytes] = (),
) -> bytes:
    """A ModelProto."""
    graph = b"".join(
        [
            *(_field(1, each) for each in nodes),
            _field(2, b"lift"),
            *(_field(5, each) for each in constants),
            *(_field(11, each) for each in inputs),
            *(_field(12, each) for each in outputs),
        ]
    )
    opset = _field(1, b"") + _number(2, OPSET)
    return _number(1, IR_VERSION) + _field(7, graph) + _field(8, opset)


def node(operator: str, inputs: Sequence[str], output: str, axis: int | None = None) -> bytes:
    """A NodeProto with at most the one attribute that an encoder needs."""
    parts = [_field(1, name.encode()) for name in inputs]
    parts += [_field(2, output.encode()), _field(4, operator.encode())]
    if axis is not None:
        parts.append(_field(5, _field(1, b"axis") + _number(3, axis) + _number(20, 2)))
    return b"".join(parts)


def value(name: str, shape: Shape, kind: int = FLOAT) -> bytes:
    """A ValueInfoProto; a word in the shape is a dimension that is open."""
    dimensions = b"".join(
        _field(1, _number(1, each) if isinstance(each, int) else _field(2, each.encode()))
        for each in shape
    )
    tensor = _number(1, kind) + _field(2, dimensions)
    return _field(1, name.encode()) + _field(2, _field(1, tensor))


def constant(name: str, numbers: np.ndarray) -> bytes:
    """A TensorProto of float32 or int64 numbers."""
    kind = INT64 if numbers.dtype == np.int64 else FLOAT
    raw = numbers.astype("<i8" if kind == INT64 else "<f4").tobytes()
    dimensions = b"".join(_number(1, size) for size in numbers.shape)
    return dimensions + _number(2, kind) + _field(8, name.encode()) + _field(9, raw)


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


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _number(number: int, content: int) -> bytes:
    return _varint(number << 3) + _varint(content)


def _varint(number: int) -> bytes:
    whole = bytearray()
    while True:
        low, number = number & 0x7F, number >> 7
        whole.append(low | 0x80 if number else low)
        if not number:
            return bytes(whole)
