"""The ONNX encoder of a linear model, written without the onnx package: psi = x.

The bytes are a ModelProto in the protocol-buffer format, with one Identity node.
"""

OPSET = 18
IR_VERSION = 10
"""of the file format, low enough for every onnxruntime that this project supports"""
_FLOAT = 1


def identity_encoder(states: int) -> bytes:
    """An ONNX model that returns its input "x" (batch, states) float32 as "psi"."""
    node = _bytes(1, b"x") + _bytes(2, b"psi") + _bytes(4, b"Identity")
    graph = _bytes(1, node) + _bytes(2, b"lift")
    graph += _bytes(11, _tensor(b"x", states)) + _bytes(12, _tensor(b"psi", states))
    opset = _bytes(1, b"") + _integer(2, OPSET)
    return _integer(1, IR_VERSION) + _bytes(7, graph) + _bytes(8, opset)


def _tensor(name: bytes, columns: int) -> bytes:
    """A ValueInfoProto of shape ("batch", columns)."""
    shape = _bytes(1, _bytes(2, b"batch")) + _bytes(1, _integer(1, columns))
    return _bytes(1, name) + _bytes(2, _bytes(1, _integer(1, _FLOAT) + _bytes(2, shape)))


def _bytes(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def _integer(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _varint(number: int) -> bytes:
    encoded = bytearray()
    while number >= 0x80:
        encoded.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*encoded, number])
