"""Eqs. (6)-(8) and the architecture of the table of hyperparameters."""

import pytest
import torch
from torch import Tensor, nn

from offline.config import PRESETS
from offline.data.sampling import Instants
from offline.data.signals import VEHICLE_ROLES
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.model.rollout import roll_out
from rt_controller.contract.signals import VEHICLE

SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)


@pytest.fixture
def model() -> MdkNet:
    torch.manual_seed(0)
    return MdkNet(PRESETS["paper"], SIZES)


def the_encoder(model: MdkNet) -> nn.Module:
    """The paper has one."""
    (encoder,) = model.encoders
    return encoder


def lift(model: MdkNet, x: Tensor) -> Tensor:
    """psi(x): the paper's encoder reads only the states."""
    return model.lift(Instants(x, torch.randn(len(x), 1), torch.randn(len(x), 0, 6)))


def test_observables_are_the_states_followed_by_the_latents(model):
    x = torch.randn(5, 6)
    psi = lift(model, x)
    assert psi.shape == (5, 66)
    assert torch.equal(psi[:, 6:65], the_encoder(model)(x))


def test_states_are_recovered_by_the_identity_and_zeros(model):
    """Eq. (8): C = [I 0]."""
    x = torch.randn(5, 6)
    C = torch.cat([torch.eye(6), torch.zeros(6, 60)], dim=1)
    assert torch.equal(lift(model, x) @ C.t(), x)


def test_encoder_has_the_widths_of_the_table_and_relu_on_hidden_layers_only(model):
    linear = [layer for layer in the_encoder(model).layers if isinstance(layer, nn.Linear)]
    assert [layer.out_features for layer in linear[:-1]] == [32, 64, 128, 128, 64]
    assert [type(layer) for layer in the_encoder(model).layers] == [nn.Linear, nn.ReLU] * 5 + [
        nn.Linear
    ]


def test_matrices_have_the_sizes_of_the_paper(model):
    A, B = model.operator()
    assert (A.shape, B.shape) == ((66, 66), (66, 4))


def test_constant_observable_stays_exactly_one_over_the_horizon(model):
    psi0 = lift(model, torch.randn(5, 6))
    psi = model.roll_out(psi0, torch.randn(80, 5, 3), torch.randn(80, 5, 1))
    assert torch.equal(psi[..., -1], torch.ones(80, 5))


def test_inputs_are_the_controls_followed_by_curvature(model):
    """Eq. (2): u = [u_c | u_w], through B = [B_uc | B_uw] of one matrix for every state."""
    u, w = torch.randn(7, 5, 3), torch.randn(7, 5, 1)
    _, B = model.operator()
    expected = u @ B[:, :3].t() + w @ B[:, 3:].t()
    assert torch.allclose(model.forcing(torch.randn(1, 5, 66), u, w), expected, atol=1e-7)


def test_the_preset_paper_literal_trains_all_sixty_latents():
    torch.manual_seed(0)
    model = MdkNet(PRESETS["paper-literal"], SIZES)
    assert the_encoder(model).layers[-1].out_features == 60
    assert torch.equal(model.operator().A, model.A_rows)
    assert model.A_learned.all()
    assert not model.A_one.any()


def test_roll_out_is_the_recursion_of_equation_6():
    torch.manual_seed(1)
    A, psi0 = 0.5 * torch.randn(4, 4), torch.randn(3, 4)
    forcing = torch.randn(6, 3, 4)
    psi, expected = psi0, []
    for k in range(6):
        psi = psi @ A.t() + forcing[k]
        expected.append(psi)
    assert torch.allclose(roll_out(psi0, A, forcing), torch.stack(expected))


def test_the_gradient_of_the_roll_out_equals_the_numerical_one():
    torch.manual_seed(2)
    arguments = (
        torch.randn(2, 3, dtype=torch.float64, requires_grad=True),
        (0.5 * torch.randn(3, 3, dtype=torch.float64)).requires_grad_(),
        torch.randn(5, 2, 3, dtype=torch.float64, requires_grad=True),
    )
    assert torch.autograd.gradcheck(roll_out, arguments)
