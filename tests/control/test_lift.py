"""An encoder reproduces its self-test, or is refused at start; the rows of its history."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import onnx_bytes
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from made_models import WITH_ALL, WITH_PAST, WITH_ROAD, make_bundle

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.control.lift import Encoder, History
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.lift import Lift
from rt_controller.model.validation import DRIVABLE_HISTORY

STATE = VehicleState(22.0, 0.1, 0.05, 0.55, -0.3, 0.02)
WIDTH = 6
Tensors = Sequence[tuple[str, Sequence[str | int]]]


@pytest.fixture
def identity():
    """Lifts by the identity: six observables."""
    return load_bundle(shipped_model("lti"))


@pytest.fixture(params=["mdk-net", "mdk-net-paper"])
def learned(request):
    return load_bundle(shipped_model(request.param))


def encoder_of_too_many_rows():
    """Encoder with the right tensors, which returns one row for each number of a state."""
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


def refusal(bundle):
    with pytest.raises(ArtifactError) as error:
        Encoder(bundle)
    message = str(error.value)
    assert "expected" in message
    assert "found" in message
    assert "offline-export" in message
    return message


def lifted(bundle):
    """psi (b, n) of the self-test samples, one by one."""
    lift = Encoder(bundle)
    psi = []
    for x, w, history in zip(*bundle.selftest, strict=True):
        if lift.history is not None:
            lift.history[:] = history
        psi.append(lift.lift(VehicleState(*x), w[0]).copy())
    return np.stack(psi)


def test_the_physical_states_keep_double_precision(learned):
    psi = Encoder(learned).lift(STATE, 0.0)
    assert psi.shape == (learned.n_observables,)
    assert tuple(psi[:WIDTH]) == STATE


@pytest.mark.parametrize("name", ["lti", "mdk-net", "mdk-net-small", "mdk-net-paper"])
def test_shipped_models_reproduce_training_within_1e_5_of_each_spread(name):
    bundle = load_bundle(shipped_model(name))
    assert bundle.parity_error(lifted(bundle)) < 1e-5


@pytest.mark.parametrize("lift", [Lift(), WITH_ROAD, WITH_PAST, WITH_ALL])
def test_an_encoder_gets_the_inputs_that_its_bundle_names(lift):
    """The latents depend on every number of every input, so a wrong order would show."""
    bundle = make_bundle(lift)
    assert bundle.parity_error(lifted(bundle)) < 1e-5


def test_only_a_lift_with_curvature_depends_on_the_curvature():
    with_curvature, without = Encoder(make_bundle(WITH_ROAD)), Encoder(make_bundle(Lift()))
    for lift, changes in ((with_curvature, True), (without, False)):
        straight = lift.lift(STATE, 0.0)[WIDTH:].copy()
        bend = lift.lift(STATE, 0.004)[WIDTH:]
        assert np.array_equal(straight, bend) is not changes


def test_the_lift_depends_on_every_entry_of_the_history():
    lift = Encoder(make_bundle(WITH_PAST))
    before = lift.lift(STATE, 0.0).copy()
    for row in range(WITH_PAST.history_steps):
        for column in range(len(WITH_PAST.history_fields)):
            lift.history[row, column] += 10.0
            after = lift.lift(STATE, 0.0).copy()
            assert not np.array_equal(before[WIDTH:], after[WIDTH:])
            lift.history[row, column] -= 10.0


def encoder_with_data_in_another_file():
    """Where they are is an entry of the tensor (field 13) with the key "location"."""
    weights = onnx_bytes.constant("w", np.zeros((0,), np.float32))
    entry = b"\x0a\x08location" + b"\x12\x0bweights.bin"
    external = weights + bytes([13 << 3 | 2, len(entry)]) + entry + bytes([14 << 3, 1])
    return onnx_bytes.model(
        [onnx_bytes.node("MatMul", ["x", "w"], "psi")],
        [onnx_bytes.value("x", ("batch", 6))],
        [onnx_bytes.value("psi", ("batch", 6))],
        [external],
    )


@pytest.mark.parametrize(
    ("encoder", "complaint"),
    [
        (b"", "expected an ONNX model"),
        (b"not an encoder", "expected an ONNX model"),
        (b"\x08\x0a" * 20, "expected an ONNX model"),
        (encoder_with_data_in_another_file(), "found data in another file"),
        (onnx_bytes.passes_on(kind=onnx_bytes.DOUBLE), "tensor(double)"),
        (encoder_of_too_many_rows(), "lifts one state"),
    ],
    ids=["empty", "text", "cut", "data elsewhere", "double precision", "too many rows"],
)
def test_an_encoder_that_cannot_be_used_is_refused(identity, encoder, complaint):
    assert complaint in refusal(replace(identity, encoder_onnx=encoder))


def test_an_encoder_of_another_width_than_the_matrices_is_refused(identity):
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
def test_an_encoder_with_other_tensors_than_the_controller_needs_is_refused(
    identity, inputs, outputs, complaint
):
    encoder = onnx_bytes.passes_on(inputs, outputs)
    assert complaint in refusal(replace(identity, encoder_onnx=encoder))


X, CURVATURE, HISTORY = ("x", ("batch", 6)), ("w", ("batch", 1)), ("history", ("batch", 4, 6))


@pytest.mark.parametrize(
    "inputs",
    [
        [X, CURVATURE],
        [X, HISTORY],
        [X, CURVATURE, ("past", ("batch", 4, 6))],
        [X, CURVATURE, ("history", ("batch", 3, 6))],
        [X, CURVATURE, ("history", ("batch", 6, 4))],
        [X, CURVATURE, ("history", ("batch", 24))],
        [X, CURVATURE, ("history", (4, 6))],
        [X, ("w", ("batch",)), HISTORY],
        [X, ("w", ("batch", 2)), HISTORY],
        [X, ("w", (1, 1)), HISTORY],
        [X, CURVATURE, HISTORY, ("u", ("batch", 3))],
    ],
)
def test_an_encoder_with_other_inputs_than_its_bundle_is_refused(inputs):
    bundle = make_bundle(WITH_ALL, latents=0)
    message = refusal(replace(bundle, encoder_onnx=onnx_bytes.passes_on(inputs)))
    assert "3 input x: tensor(float) ['batch', 6], w: tensor(float) ['batch', 1]" in message


def test_the_order_of_tensors_in_the_file_does_not_matter():
    bundle = make_bundle(WITH_ALL, latents=0)
    Encoder(replace(bundle, encoder_onnx=onnx_bytes.passes_on([X, HISTORY, CURVATURE])))


@pytest.mark.parametrize("wrong", ["a thousandth of a spread", "no number", "other samples"])
def test_latents_that_are_not_those_of_the_self_test_are_refused(learned, wrong):
    """Also for the latent with the smallest values."""
    psi = learned.selftest_psi.copy()
    if wrong == "other samples":
        psi[:, WIDTH:] = np.roll(psi[:, WIDTH:], 1, axis=0)
    else:
        column = WIDTH + int(np.argmin(learned.spread[WIDTH:-1]))
        psi[3, column] += np.nan if wrong == "no number" else 1e-3 * learned.spread[column]
    assert "self-test" in refusal(replace(learned, selftest_psi=psi))


@pytest.mark.parametrize("name", ["w", "history"])
def test_the_self_test_includes_curvature_and_history(name):
    bundle = make_bundle(WITH_ALL)
    wrong = np.roll(getattr(bundle.selftest, name), 1, axis=0)
    other = replace(bundle, selftest=bundle.selftest._replace(**{name: wrong}))
    assert "self-test" in refusal(other)


def state(k):
    return VehicleState(20.0 + k, 0.1 * k, -0.01 * k, 0.5, 7.0, 7.0)


def held(k):
    """The input from instant k to the next."""
    return ControlInput(0.01 * k, 1.0 * k, -0.1 * k)


def row(x, u):
    named = {**x._asdict(), **u._asdict()}
    return tuple(named[name] for name in DRIVABLE_HISTORY)


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.integers(1, 6))
@example([True] * 10, 4)
@example([True] * 6 + [False, True], 4)
def test_a_row_is_a_state_and_the_input_that_followed_since_the_last_gap(is_seen, steps):
    """Compared with the definition; the oldest state is repeated with the input then in force."""
    rows = np.full((steps, len(DRIVABLE_HISTORY)), np.nan, dtype=np.float32)
    history, begun_at = History(rows), None
    for k, seen in enumerate(is_seen):
        if not seen:
            history.forget()
            begun_at = None
            continue
        history.advance(state(k), held(k - 1))
        begun_at = k if begun_at is None else begun_at
        since = [row(state(j), held(j)) for j in range(begun_at, k)]
        before = [row(state(begun_at), held(begun_at - 1))] * steps
        np.testing.assert_array_equal(rows, np.array((before + since)[-steps:], dtype=np.float32))
