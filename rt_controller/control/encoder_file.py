"""What an ONNX file may contain to be an encoder: one graph of bounded run time, and all its data.

The parts of the file that matter are read without the onnx package: the vehicle does not have it.
"""

from collections.abc import Iterator
from typing import NamedTuple

from rt_controller.contract.errors import ArtifactError

_VARINT, _EIGHT_BYTES, _BYTES, _FOUR_BYTES = 0, 1, 2, 5
"""wire types of the protocol-buffer format"""
_EXTERNAL = 1
"""`data_location` of a tensor whose numbers are in another file"""
_PARTS = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node"},
    "graph": {1: "node", 5: "tensor", 15: "sparse tensor"},
    "node": {5: "attribute"},
    "attribute": {
        5: "tensor",
        6: "subgraph",
        10: "tensor",
        11: "subgraph",
        22: "sparse tensor",
        23: "sparse tensor",
    },
    "sparse tensor": {1: "tensor", 2: "tensor"},
}
"""fields of a message that contain others, by the names of onnx.proto"""
_EXTERNAL_DATA_FIELD, _DATA_LOCATION_FIELD = 13, 14


class _Field(NamedTuple):
    number: int
    content: memoryview | int


def require_self_contained(onnx: bytes) -> None:
    """Return if an encoder has its data in itself, and no loops or branches.

    Data in other files would be outside the hash of the bundle, and a loop may be endless.

    Raises:
        ArtifactError: it has not, or the file is damaged.
    """
    try:
        found = _objection(memoryview(onnx), "model")
    except (IndexError, ValueError) as error:
        raise ArtifactError(
            f"encoder.onnx: expected an ONNX model, found something onnxruntime cannot load "
            f"({error or 'a damaged file'}). Run offline-export again."
        ) from error
    if found is not None:
        raise ArtifactError(
            f"encoder.onnx: expected an encoder of one graph that contains its data, found {found}."
            f" Run offline-export again."
        )


def _objection(message: memoryview, kind: str) -> str | None:
    parts = _PARTS.get(kind, {})
    for number, content in _fields(message):
        if kind == "tensor":
            is_external = number == _DATA_LOCATION_FIELD and content == _EXTERNAL
            if number == _EXTERNAL_DATA_FIELD or is_external:
                return "data in another file"
        part = parts.get(number)
        if part is None or isinstance(content, int):
            continue
        if part == "subgraph":
            return "a loop or a branch"
        found = _objection(content, part)
        if found is not None:
            return found
    return None


def _fields(message: memoryview) -> Iterator[_Field]:
    """The fields of one message; raises IndexError or ValueError for a damaged one."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, wire_type = key >> 3, key & 7
        content: memoryview | int
        if wire_type == _VARINT:
            content, at = _varint(message, at)
        elif wire_type == _BYTES:
            length, at = _varint(message, at)
            content = message[at : at + length]
            at += length
        elif wire_type in (_FOUR_BYTES, _EIGHT_BYTES):
            content = 0
            at += 4 if wire_type == _FOUR_BYTES else 8
        else:
            raise ValueError(f"a field of wire type {wire_type}")
        if at > len(message):
            raise ValueError("a truncated file")
        yield _Field(number, content)


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    number = shift = 0
    while True:
        byte = message[at]
        number |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return number, at
