"""An encoder contains its data and neither loops nor branches."""

import random
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import onnx_bytes
import pytest

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.model.artifact import load_bundle, shipped_model
from rt_controller.control.encoder_file import require_self_contained

X, PSI = onnx_bytes.value("x", ("batch", 6)), onnx_bytes.value("psi", ("batch", 6))
WEIGHTS = onnx_bytes.constant("weights", np.zeros((6, 6), np.float32))
PRODUCT = onnx_bytes.node("MatMul", ["x", "weights"], "psi")


def field(number: int, content: bytes) -> bytes:
    key = number << 3 | 2
    assert len(content) < 128
    return (
        bytes([*([key & 0x7F | 0x80, key >> 7] if key > 0x7F else [key]), len(content)]) + content
    )


def model(node: bytes = PRODUCT, weights: bytes = WEIGHTS) -> bytes:
    return onnx_bytes.model([node], [X], [PSI], [weights])


IN_A_FILE = onnx_bytes.constant("w", np.zeros((0,), np.float32)) + bytes([14 << 3, 1])
WITH_A_PLACE = onnx_bytes.constant("w", np.zeros((0,), np.float32)) + field(
    13, field(1, b"location") + field(2, b"weights.bin")
)
BODY = field(1, b"body") + field(6, field(2, b"graph"))


@pytest.mark.parametrize("name", ["lti", "mdk-net", "mdk-net-paper"])
def test_the_shipped_encoders_are_self_contained(name: str) -> None:
    require_self_contained(load_bundle(shipped_model(name)).encoder_onnx)


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda: model(weights=IN_A_FILE), "data in another file"),
        (lambda: model(weights=WITH_A_PLACE), "data in another file"),
        (lambda: model(node=PRODUCT + field(5, field(5, IN_A_FILE))), "data in another file"),
        (
            lambda: model(node=PRODUCT + field(5, field(22, field(1, IN_A_FILE)))),
            "data in another file",
        ),
        (lambda: model(node=PRODUCT + field(5, BODY)), "a loop or a branch"),
    ],
)
def test_data_in_other_files_loops_and_branches_are_refused(
    make: Callable[[], bytes], found: str
) -> None:
    with pytest.raises(ArtifactError, match=rf"expected .* found {found}.*offline-export"):
        require_self_contained(make())


def test_nodes_of_functions_are_checked_too() -> None:
    function = field(7, PRODUCT + field(5, BODY))
    with pytest.raises(ArtifactError, match="a loop or a branch"):
        require_self_contained(model() + field(25, function))


def test_damaged_files_raise_nothing_else() -> None:
    rng, whole = random.Random(1), model()
    for _ in range(2000):
        damaged = bytearray(whole[: rng.randrange(len(whole) + 1)])
        for _ in range(rng.randrange(4)):
            if damaged:
                damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        with suppress(ArtifactError):
            require_self_contained(bytes(damaged))
