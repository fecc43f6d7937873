"""Bundles from files, shipped names and plain matrices; the controller drives with each."""

import numpy as np
import pytest
from scripted_vehicle import build_rig

from rt_controller.config import MpcSettings
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import Mode, Schema, Signal
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import STATES_ONLY, identity_encoder
from rt_controller.node import build_mpc


@pytest.fixture(scope="module")
def lti() -> Bundle:
    return Bundle.load("lti")


def as_linear(bundle: Bundle, **changes: np.ndarray) -> Bundle:
    matrices = {"A": bundle.A, "B_uc": bundle.B_uc, "B_uw": bundle.B_uw, "offset": bundle.c}
    return Bundle.linear(**matrices | changes, name="mine")


def test_the_default_is_the_shipped_network():
    assert Bundle.load().sha256 == Bundle.load("mdk-net").sha256


def test_a_missing_folder_is_refused_with_a_remedy(tmp_path):
    remedy = r"none': expected one of lti, .*, or a folder that offline-export wrote"
    with pytest.raises(ArtifactError, match=remedy):
        Bundle.load(tmp_path / "none")
    with pytest.raises(ArtifactError, match=r"koopman.npz.*Point `model`"):
        Bundle.load(tmp_path)


def test_a_linear_bundle_has_the_matrices_and_the_identity_as_its_lift(lti):
    bundle = as_linear(lti)
    np.testing.assert_array_equal(bundle.A, lti.A)
    np.testing.assert_array_equal(bundle.c, lti.c)
    assert bundle.lift == STATES_ONLY
    assert bundle.name == "mine"
    assert Bundle.linear(lti.A, lti.B_uc, lti.B_uw).c.tolist() == [0.0] * 6


def test_a_saved_linear_bundle_is_loaded_as_the_same_model_with_a_warning(lti, tmp_path):
    saved = as_linear(lti).save(tmp_path / "mine")
    remedy = r"expected .* stored plans, found one without.* offline-export --bundle .*mine"
    with pytest.warns(UserWarning, match=remedy):
        loaded = Bundle.load(tmp_path / "mine")
    assert loaded.sha256 == saved.sha256
    assert (tmp_path / "mine" / "card.md").read_text() == "# mine\n"
    assert not list(tmp_path.rglob("*.part"))


def test_the_controller_drives_with_a_linear_bundle(lti):
    settings = MpcSettings()
    with build_rig(build_mpc(as_linear(lti), settings)) as mine:
        own = mine.tick(10)
    with build_rig(build_mpc(lti, settings)) as shipped:
        expected = shipped.tick(10)
    assert own.mode is Mode.NOMINAL
    assert own.control == pytest.approx(expected.control, abs=1e-6)


@pytest.mark.parametrize(
    ("field", "array"),
    [
        ("A", np.eye(5)),
        ("B_uc", np.zeros((6, 2))),
        ("B_uw", np.zeros((6, 2))),
        ("offset", np.zeros(5)),
    ],
)
def test_matrices_of_other_shapes_are_refused(lti, field, array):
    with pytest.raises(ArtifactError, match=f"^{field}: expected the shape"):
        as_linear(lti, **{field: array})


def test_a_linear_bundle_may_have_other_signals():
    schema = Schema((Signal("level_m", "m"),), (Signal("valve", "1"),), (), dt_s=0.1)
    bundle = Bundle.linear(
        np.array([[0.9]]), np.array([[0.1]]), np.zeros((1, 0)), schema=schema, name="tank"
    )
    assert bundle.schema == schema
    assert bundle.growth(20) == pytest.approx(0.9**20)


def test_the_identity_encoder_is_the_model_that_the_onnx_package_writes():
    onnx = pytest.importorskip("onnx")
    model = onnx.load_model_from_string(identity_encoder(300))
    onnx.checker.check_model(model)
    (node,) = model.graph.node
    assert (node.op_type, list(node.input), list(node.output)) == ("Identity", ["x"], ["psi"])
    for value in (model.graph.input[0], model.graph.output[0]):
        batch, columns = value.type.tensor_type.shape.dim
        assert (batch.dim_param, columns.dim_value) == ("batch", 300)
        assert value.type.tensor_type.elem_type == onnx.TensorProto.FLOAT
