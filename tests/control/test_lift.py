"""The encoder of a bundle lifts what it was exported to lift, or the controller does not start."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import onnx_bytes
import pytest
from made_models import WITH_ALL, WITH_PAST, WITH_ROAD, make_bundle

from rt_controller.contract.artifact import Bundle, Lift, load_bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import VehicleState
from rt_controller.control.lift import Encoder
from rt_controller.session import shipped_model

STATE = VehicleState(22.0, 0.1, 0.05, 0.55, -0.3, 0.02)
WIDTH = 6

Tensors = Sequence[tuple[str, Sequence[str | int]]]


@pytest.fixture
def identity() -> Bundle:
    """Lifts by the identity: six observables."""
    return load_bundle(shipped_model("lti"))


@pytest.fixture(params=["mdk-net", "mdk-net-paper"])
def learned(request: pytest.FixtureRequest) -> Bundle:
    return load_bundle(shipped_model(request.param))


def encoder_of_too_many_rows() -> bytes:
    """Looks right from outside, and answers one state with a row for each of its numbers."""
    return onnx_bytes.model(
        [
            onnx_bytes.node("NonZero", ["x"], "places"),
            onnx_bytes.node("Gather", ["places", "first"], "rows"),
            onnx_bytes.node("Gather", ["x", "rows"], "psi"),
        ],
        [onnx_bytes.value("x", ("batch", WIDTH))],
        [onnx_bytes.value("psi", ("rows", WIDTH))],
        [onnx_bytes.constant("first", np.array(0))],
    )


def refusal(bundle: Bundle) -> str:
    with pytest.raises(ArtifactError) as error:
        Encoder(bundle)
    message = str(error.value)
    assert "expected" in message
    assert "found" in message
    assert "offline-export" in message
    return message


def lifted(bundle: Bundle) -> np.ndarray:
    """psi (b, n) of the self-test, one instant after the other."""
    lift = Encoder(bundle)
    psi = []
    for x, w, history in zip(*bundle.selftest, strict=True):
        if lift.history is not None:
            lift.history[:] = history
        psi.append(lift.lift(VehicleState(*x), w[0]).copy())
    return np.stack(psi)


@pytest.mark.parametrize("lift_of", [Lift(), WITH_ROAD])
def test_one_state_and_a_batch_are_lifted_alike(lift_of: Lift) -> None:
    bundle = make_bundle(lift_of)
    lift = Encoder(bundle)
    states = bundle.selftest.x[:5]
    one_by_one = np.stack([lift.lift(VehicleState(*row), 0.001).copy() for row in states])
    np.testing.assert_allclose(one_by_one, lift.lift_batch(states, 0.001), rtol=1e-4, atol=1e-7)


def test_the_physical_states_pass_the_lift_in_double_precision(learned: Bundle) -> None:
    psi = Encoder(learned).lift(STATE, 0.0)
    assert psi.shape == (learned.n_observables,)
    assert tuple(psi[:WIDTH]) == STATE


@pytest.mark.parametrize("name", ["lti", "mdk-net", "mdk-net-paper"])
def test_shipped_models_agree_with_training_within_1e_5_of_each_spread(name: str) -> None:
    bundle = load_bundle(shipped_model(name))
    assert bundle.parity_error(lifted(bundle)) < 1e-5


@pytest.mark.parametrize("lift", [Lift(), WITH_ROAD, WITH_PAST, WITH_ALL])
def test_an_encoder_is_shown_what_its_bundle_names(lift: Lift) -> None:
    """In the order of the bundle, each in its own place: the latents lean on every number."""
    bundle = make_bundle(lift)
    assert bundle.parity_error(lifted(bundle)) < 1e-5


def test_a_latent_that_sees_the_road_changes_with_it_and_another_does_not() -> None:
    seeing, blind = Encoder(make_bundle(WITH_ROAD)), Encoder(make_bundle(Lift()))
    for lift, changes in ((seeing, True), (blind, False)):
        straight = lift.lift(STATE, 0.0)[WIDTH:].copy()
        bend = lift.lift(STATE, 0.004)[WIDTH:]
        assert np.array_equal(straight, bend) is not changes
        by_batch = lift.lift_batch(np.array([STATE, STATE]), 0.004)[1]
        np.testing.assert_allclose(by_batch[WIDTH:], bend, rtol=1e-5)


def test_writing_into_the_history_is_showing_it() -> None:
    lift = Encoder(make_bundle(WITH_PAST))
    assert lift.history is not None
    before = lift.lift(STATE, 0.0).copy()
    for row in range(WITH_PAST.history_steps):
        for column in range(len(WITH_PAST.history_fields)):
            lift.history[row, column] += 10.0
            after = lift.lift(STATE, 0.0).copy()
            assert not np.array_equal(before[WIDTH:], after[WIDTH:])
            lift.history[row, column] -= 10.0


def test_a_lift_without_a_past_has_no_history() -> None:
    assert Encoder(make_bundle(WITH_ROAD)).history is None


@pytest.mark.parametrize("damage", [b"", b"not an encoder", b"\x08\x0a" * 20])
def test_bytes_that_are_no_onnx_model_are_refused(identity: Bundle, damage: bytes) -> None:
    assert "expected an ONNX model" in refusal(replace(identity, encoder_onnx=damage))


def test_an_encoder_of_another_width_than_the_matrices_is_refused(identity: Bundle) -> None:
    wider = make_bundle(Lift())
    message = refusal(replace(wider, encoder_onnx=identity.encoder_onnx))
    assert f"psi: tensor(float) ['batch', {wider.n_observables}]" in message


@pytest.mark.parametrize(
    ("inputs", "outputs", "complaint"),
    [
        ([("state", ("batch", 6))], [("psi", ("batch", 6))], "1 input x"),
        ([("x", ("batch", 6))], [("lifted", ("batch", 6))], "1 output psi"),
        ([("x", ("batch", 7))], [("psi", ("batch", 7))], "1 input x"),
        ([("x", (6,))], [("psi", (6,))], "1 input x"),
        ([("x", ())], [("psi", ())], "1 input x"),
        ([("x", ("batch", 6)), ("w", ("batch", 1))], [("psi", ("batch", 6))], "1 input x"),
        ([("x", ("batch", 6))], [("psi", ("batch", 6)), ("more", ("batch", 6))], "1 output psi"),
        ([("x", ("batch", "width"))], [("psi", ("batch", "width"))], "1 input x"),
        ([("x", (2, 6))], [("psi", (2, 6))], "any batch"),
        ([("x", (1, 6))], [("psi", (1, 6))], "any batch"),
    ],
)
def test_other_tensors_than_the_controllers_are_refused(
    identity: Bundle, inputs: Tensors, outputs: Tensors, complaint: str
) -> None:
    encoder = onnx_bytes.passes_on(inputs, outputs)
    assert complaint in refusal(replace(identity, encoder_onnx=encoder))


X, ROAD, PAST = ("x", ("batch", 6)), ("w", ("batch", 1)), ("history", ("batch", 4, 6))


@pytest.mark.parametrize(
    "inputs",
    [
        [X, ROAD],
        [X, PAST],
        [X, ROAD, ("past", ("batch", 4, 6))],
        [X, ROAD, ("history", ("batch", 3, 6))],
        [X, ROAD, ("history", ("batch", 6, 4))],
        [X, ROAD, ("history", ("batch", 24))],
        [X, ROAD, ("history", (4, 6))],
        [X, ("w", ("batch",)), PAST],
        [X, ("w", ("batch", 2)), PAST],
        [X, ("w", (1, 1)), PAST],
        [X, ROAD, PAST, ("u", ("batch", 3))],
    ],
)
def test_an_encoder_that_is_shown_something_else_than_its_bundle_says_is_refused(
    inputs: Tensors,
) -> None:
    bundle = make_bundle(WITH_ALL, latents=0)
    message = refusal(replace(bundle, encoder_onnx=onnx_bytes.passes_on(inputs)))
    assert "3 input x: tensor(float) ['batch', 6], w: tensor(float) ['batch', 1]" in message


def test_the_order_of_tensors_in_the_file_does_not_matter() -> None:
    bundle = make_bundle(WITH_ALL, latents=0)
    Encoder(replace(bundle, encoder_onnx=onnx_bytes.passes_on([X, PAST, ROAD])))


def test_an_encoder_in_double_precision_is_refused(identity: Bundle) -> None:
    encoder = onnx_bytes.passes_on(kind=onnx_bytes.DOUBLE)
    assert "tensor(double)" in refusal(replace(identity, encoder_onnx=encoder))


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


@pytest.mark.parametrize("shown", ["w", "history"])
def test_the_self_test_shows_road_and_past_too(shown: str) -> None:
    bundle = make_bundle(WITH_ALL)
    wrong = np.roll(getattr(bundle.selftest, shown), 1, axis=0)
    other = replace(bundle, selftest=bundle.selftest._replace(**{shown: wrong}))
    assert "self-test" in refusal(other)
