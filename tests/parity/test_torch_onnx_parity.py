"""The exported bundle answers like the network it came from, in physical units."""

import copy

import numpy as np
import onnxruntime
import pytest
import torch

from offline.config import PRESETS
from offline.export import PhysicalEncoder, fold_scaling, to_onnx
from offline.model import MdkNet
from offline.rollout import roll_out
from offline.scaling import Scaling

SCALING = Scaling(
    x_centre=np.array([22.0, 0.0, 0.0, 0.55, 0.0, 0.0]),
    x_scale=np.array([7.0, 0.2, 0.1, 0.18, 3.0, 0.15]),
    u_scale=np.array([0.4, 30.0, 0.3, 2.8e-3]),
)


@pytest.fixture(params=["paper", "paper-literal"], scope="module")
def model(request) -> MdkNet:
    torch.manual_seed(0)
    model = MdkNet(PRESETS[request.param])
    with torch.no_grad():
        model.A_rows += 0.002 * torch.randn_like(model.A_rows)
        model.B_rows += 0.02 * torch.randn_like(model.B_rows)
        for layer in model.encoder:
            if isinstance(layer, torch.nn.Linear):
                layer.bias += 0.1 * torch.randn_like(layer.bias)
    return model


@pytest.fixture(scope="module")
def session(model) -> onnxruntime.InferenceSession:
    encoder = to_onnx(PhysicalEncoder(model, SCALING).eval())
    return onnxruntime.InferenceSession(encoder, providers=["CPUExecutionProvider"])


def states(n: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    return SCALING.restore_states(rng.normal(size=(n, 6)))


def spread_of_latents(precise: MdkNet) -> np.ndarray:
    with torch.no_grad():
        psi = precise.lift(torch.from_numpy(SCALING.normalise_states(states(200)))).numpy()
    spread = psi[:, 6:].std(axis=0)
    return np.where(spread > 0.0, spread, 1.0)


@pytest.mark.parametrize("batch", [1, 2, 33])
def test_onnx_agrees_with_the_scaled_network_for_any_batch(model, session, batch):
    x = states(batch)
    (psi,) = session.run(["psi"], {"x": x.astype(np.float32)})
    with torch.no_grad():
        precise = copy.deepcopy(model).double()
        expected = precise.lift(torch.from_numpy(SCALING.normalise_states(x))).numpy()
    assert psi.shape == (batch, 66)
    assert np.max(np.abs(psi[:, 6:] - expected[:, 6:]) / spread_of_latents(precise)) < 1e-5


def test_physical_states_pass_the_encoder_bit_by_bit(session):
    x = states(16).astype(np.float32)
    (psi,) = session.run(["psi"], {"x": x})
    assert np.array_equal(psi[:, :6], x)


def test_roll_out_in_physical_units_is_the_scaled_one(model):
    precise = copy.deepcopy(model).double()
    rng = np.random.default_rng(2)
    x0 = states(4)
    u = rng.normal(size=(80, 4, 4))
    with torch.no_grad():
        A_n, B_n = (matrix.detach() for matrix in precise.operator())
        psi_n = precise.lift(torch.from_numpy(SCALING.normalise_states(x0)))
        expected = roll_out(psi_n, A_n, torch.from_numpy(u) @ B_n.t()).numpy()
    A, B, c = fold_scaling(A_n.numpy(), B_n.numpy(), SCALING)
    psi = np.concatenate([x0, psi_n[:, 6:].numpy()], axis=1)
    for k in range(80):
        psi = psi @ A.T + (u[k] * SCALING.u_scale) @ B.T + c
    assert np.allclose(psi[:, :6], SCALING.restore_states(expected[-1][:, :6]), rtol=1e-9)
    assert np.allclose(psi[:, 6:], expected[-1][:, 6:], rtol=1e-9, atol=1e-9)


def test_the_encoder_tells_nothing_of_the_machine_it_was_exported_on(model) -> None:
    encoder = to_onnx(PhysicalEncoder(model, SCALING).eval())
    for word in (b"site-packages", b"export.py", b"File "):
        assert word not in encoder
