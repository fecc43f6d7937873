"""The encoder of a bundle lifts what it was exported to lift, or the controller does not start."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rt_controller.contract.artifact import Bundle, load_bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import VehicleState
from rt_controller.control.lift import Encoder
from rt_controller.session import shipped_model

STATE = VehicleState(22.0, 0.1, 0.05, 0.55, -0.3, 0.02)
WIDTH = 6


@pytest.fixture
def identity() -> Bundle:
    """Lifts by the identity: six observables."""
    return load_bundle(shipped_model("lti"))


@pytest.fixture
def learned() -> Bundle:
    return load_bundle(shipped_model("mdk-net-paper"))


def encoder(
    inputs: Sequence[tuple[str, Sequence[str | int]]] = (("x", ("batch", WIDTH)),),
    outputs: Sequence[tuple[str, Sequence[str | int]]] = (("psi", ("batch", WIDTH)),),
    double: bool = False,
) -> bytes:
    """An ONNX model that passes its first input on, to each of its outputs."""
    onnx = pytest.importorskip("onnx")
    kind = onnx.TensorProto.DOUBLE if double else onnx.TensorProto.FLOAT
    make = onnx.helper
    graph = make.make_graph(
        [make.make_node("Identity", [inputs[0][0]], [name]) for name, _ in outputs],
        "lift",
        [make.make_tensor_value_info(name, kind, shape) for name, shape in inputs],
        [make.make_tensor_value_info(name, kind, shape) for name, shape in outputs],
    )
    model = make.make_model(graph, opset_imports=[make.make_opsetid("", 18)], ir_version=10)
    return bytes(model.SerializeToString())


def encoder_of_too_many_rows() -> bytes:
    """Looks right from outside, and answers one state with a row for each of its numbers."""
    onnx = pytest.importorskip("onnx")
    make, kind = onnx.helper, onnx.TensorProto
    graph = make.make_graph(
        [
            make.make_node("NonZero", ["x"], ["places"]),
            make.make_node("Gather", ["places", "first"], ["rows"]),
            make.make_node("Gather", ["x", "rows"], ["psi"]),
        ],
        "lift",
        [make.make_tensor_value_info("x", kind.FLOAT, ["batch", WIDTH])],
        [make.make_tensor_value_info("psi", kind.FLOAT, ["rows", WIDTH])],
        initializer=[make.make_tensor("first", kind.INT64, [], [0])],
    )
    model = make.make_model(graph, opset_imports=[make.make_opsetid("", 18)], ir_version=10)
    return bytes(model.SerializeToString())


def refusal(bundle: Bundle) -> str:
    with pytest.raises(ArtifactError) as error:
        Encoder(bundle)
    message = str(error.value)
    assert "expected" in message
    assert "found" in message
    assert "offline-export" in message
    return message


def test_one_state_and_a_batch_are_lifted_alike(learned: Bundle) -> None:
    lift = Encoder(learned)
    states = learned.selftest_x[:5]
    one_by_one = np.stack([lift.lift(VehicleState(*row)).copy() for row in states])
    np.testing.assert_allclose(one_by_one, lift.lift_batch(states), rtol=1e-4, atol=1e-7)


def test_the_physical_states_pass_the_lift_in_double_precision(learned: Bundle) -> None:
    psi = Encoder(learned).lift(STATE)
    assert psi.shape == (learned.n_observables,)
    assert tuple(psi[:WIDTH]) == STATE


@pytest.mark.parametrize("name", ["lti", "mdk-net-paper"])
def test_shipped_models_agree_with_training_within_1e_5_of_each_spread(name: str) -> None:
    bundle = load_bundle(shipped_model(name))
    lift = Encoder(bundle)
    psi = np.stack([lift.lift(VehicleState(*row)).copy() for row in bundle.selftest_x])
    assert bundle.parity_error(psi) < 1e-5


@pytest.mark.parametrize("damage", [b"", b"not an encoder", b"\x08\x0a" * 20])
def test_bytes_that_are_no_onnx_model_are_refused(identity: Bundle, damage: bytes) -> None:
    assert "expected an ONNX model" in refusal(replace(identity, encoder_onnx=damage))


def test_an_encoder_of_another_width_than_the_matrices_is_refused(
    identity: Bundle, learned: Bundle
) -> None:
    message = refusal(replace(learned, encoder_onnx=identity.encoder_onnx))
    assert f"psi: tensor(float) ['batch', {learned.n_observables}]" in message


@pytest.mark.parametrize(
    ("inputs", "outputs", "complaint"),
    [
        ([("state", ("batch", 6))], [("psi", ("batch", 6))], "one input x"),
        ([("x", ("batch", 6))], [("lifted", ("batch", 6))], "one output psi"),
        ([("x", ("batch", 7))], [("psi", ("batch", 7))], "one input x"),
        ([("x", (6,))], [("psi", (6,))], "one input x"),
        ([("x", ())], [("psi", ())], "one input x"),
        ([("x", ("batch", 6)), ("history", (1,))], [("psi", ("batch", 6))], "one input x"),
        ([("x", ("batch", 6))], [("psi", ("batch", 6)), ("more", ("batch", 6))], "one output psi"),
        ([("x", ("batch", "width"))], [("psi", ("batch", "width"))], "one input x"),
        ([("x", (2, 6))], [("psi", (2, 6))], "any batch"),
        ([("x", (1, 6))], [("psi", (1, 6))], "any batch"),
    ],
)
def test_other_tensors_than_the_controllers_are_refused(
    identity: Bundle,
    inputs: Sequence[tuple[str, Sequence[str | int]]],
    outputs: Sequence[tuple[str, Sequence[str | int]]],
    complaint: str,
) -> None:
    assert complaint in refusal(replace(identity, encoder_onnx=encoder(inputs, outputs)))


def test_an_encoder_in_double_precision_is_refused(identity: Bundle) -> None:
    assert "tensor(double)" in refusal(replace(identity, encoder_onnx=encoder(double=True)))


def test_an_encoder_that_cannot_lift_one_state_is_refused(identity: Bundle) -> None:
    message = refusal(replace(identity, encoder_onnx=encoder_of_too_many_rows()))
    assert "lifts one state" in message


def test_a_latent_wrong_by_a_thousandth_of_its_spread_is_refused(learned: Bundle) -> None:
    """However small its numbers are: latents of some thousandths count like metres."""
    column = WIDTH + int(np.argmin(learned.spread[WIDTH:-1]))
    psi = learned.selftest_psi.copy()
    psi[3, column] += 1e-3 * learned.spread[column]
    assert "self-test" in refusal(replace(learned, selftest_psi=psi))


def test_an_encoder_that_answers_with_something_else_is_refused(learned: Bundle) -> None:
    psi = learned.selftest_psi.copy()
    psi[:, WIDTH:] = np.roll(psi[:, WIDTH:], 1, axis=0)
    assert "self-test" in refusal(replace(learned, selftest_psi=psi))
