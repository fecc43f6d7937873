"""Eqs. (2), (6) to (13) of the paper, each against a transcription in float64."""

import pytest
import torch
from torch import Tensor, nn

from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import Batch, Instants
from offline.data.signals import VEHICLE_ROLES
from offline.model.losses import forgetting_weights, regularisation_loss, total_loss
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.model.rollout import roll_out
from offline.model.stability import GROWTH_BOUND_OF_A, eigenvalue_excess, growth_excess
from rt_controller.contract.signals import VEHICLE

pytestmark = pytest.mark.usefixtures("double_precision")
K, BATCH = 7, 3
SMALL = {"hidden": (8, 8), "latents": 5}
SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)


def a_model(config: TrainingConfig) -> MdkNet:
    torch.manual_seed(1)
    model = MdkNet(config, SIZES)
    with torch.no_grad():
        model.A_rows += 0.05 * torch.randn_like(model.A_rows)
        model.B_rows += 0.3 * torch.randn_like(model.B_rows)
    return model


def learned(model: MdkNet) -> list[Tensor]:
    """The parameters; without gains, theirs are empty."""
    return [parameter for parameter in model.parameters() if parameter.numel()]


def a_batch() -> Batch:
    torch.manual_seed(2)
    return Batch(
        torch.randn(K + 1, BATCH, 6),
        torch.randn(K, BATCH, 3),
        torch.randn(K, BATCH, 1),
        torch.randn(K, BATCH, 6),
        torch.ones(1, BATCH, 1),
    )


def inputs(batch: Batch) -> Tensor:
    """u = [u_c; u_w] of eq. (2), (K, batch, 4)."""
    return torch.cat([batch.u, batch.w], dim=-1)


def lift(model: MdkNet, x: Tensor) -> Tensor:
    """psi(x) of one state; the paper's encoder reads nothing else."""
    return model.lift(Instants(x, torch.empty(0), torch.empty(0)))


def a_config(preset: str, **changes: object) -> TrainingConfig:
    return PRESETS[preset].model_copy(update={**SMALL, **changes})


def transcribed_single_step(model: MdkNet, batch: Batch) -> Tensor:
    """Eq. (9), averaged over the batch."""
    A, B = model.operator()
    x, u = batch.x, inputs(batch)
    loss = torch.zeros(())
    for b in range(BATCH):
        for i in range(K):
            error = lift(model, x[i + 1, b]) - (A @ lift(model, x[i, b]) + B @ u[i, b])
            loss = loss + error @ error / K
    return loss / BATCH


def transcribed_multi_step(model: MdkNet, batch: Batch, beta: float, last: int) -> Tensor:
    """Eq. (10), averaged over the batch; as printed, `last` is K-1."""
    A, B = model.operator()
    x, u = batch.x, inputs(batch)
    power = torch.linalg.matrix_power
    loss = torch.zeros(())
    for b in range(BATCH):
        for i in range(1, last + 1):
            predicted = power(A, i) @ lift(model, x[0, b])
            for t in range(1, i + 1):
                predicted = predicted + power(A, t - 1) @ B @ u[i - t, b]
            error = lift(model, x[i, b]) - predicted
            loss = loss + beta**i * (error @ error)
    return loss / sum(beta**i for i in range(1, last + 1)) / BATCH


@pytest.mark.parametrize("preset", ["paper", "paper-literal"])
def test_single_step_loss_is_equation_9(preset):
    config = a_config(preset)
    model, batch = a_model(config), a_batch()
    found = total_loss(model, config, batch).single_step
    assert torch.isclose(found, transcribed_single_step(model, batch))


@pytest.mark.parametrize(("preset", "last"), [("paper-literal", K - 1), ("paper", K)])
def test_multi_step_loss_is_equation_10(preset, last):
    config = a_config(preset)
    model, batch = a_model(config), a_batch()
    expected = transcribed_multi_step(model, batch, config.forgetting, last)
    assert torch.isclose(total_loss(model, config, batch).multi_step, expected)


@pytest.mark.parametrize(("preset", "last"), [("paper-literal", K - 1), ("paper", K)])
def test_gradients_of_both_prediction_losses_are_those_of_the_transcription(preset, last):
    config = a_config(preset)
    batch = a_batch()
    ours, naive = a_model(config), a_model(config)
    losses = total_loss(ours, config, batch)
    (losses.single_step + losses.multi_step).backward()
    (
        transcribed_single_step(naive, batch)
        + transcribed_multi_step(naive, batch, config.forgetting, last)
    ).backward()
    for one, other in zip(learned(ours), learned(naive), strict=True):
        assert torch.allclose(one.grad, other.grad, rtol=1e-9, atol=1e-12)


def test_eigenvalue_excess_is_equation_11():
    A = torch.diag(torch.tensor([1.5, 0.9, -1.25, 1.0]))
    A[0, 3] = 7.0
    assert torch.isclose(eigenvalue_excess(A), torch.tensor(0.75))


def test_eigenvalue_excess_counts_both_eigenvalues_of_a_complex_pair():
    radius, angle = 1.2, torch.tensor(0.7)
    turn = torch.stack(
        [torch.stack([angle.cos(), -angle.sin()]), torch.stack([angle.sin(), angle.cos()])]
    )
    assert torch.isclose(eigenvalue_excess(radius * turn), torch.tensor(0.4))


def test_growth_excess_is_the_root_of_the_64th_power():
    A = a_model(a_config("paper")).operator().A.detach() + 0.1
    norm = torch.linalg.matrix_norm(torch.linalg.matrix_power(A, 64))
    assert norm > 1.0
    assert torch.isclose(growth_excess(A), norm ** (1 / 64) - GROWTH_BOUND_OF_A)


def test_the_growth_bound_allows_the_chain_from_yaw_rate_to_lateral_error():
    """Strict stability would exclude the true kinematics: integrators have eigenvalue 1.

    In scaled numbers, at 20 m/s, beside 63 observables that merely persist.
    """
    dt_s, speed_mps, yaw_rate_scale, epsi_scale, ey_scale = 0.025, 20.0, 0.1, 0.15, 3.0
    chain = torch.eye(66)
    chain[5, 2] = dt_s * yaw_rate_scale / epsi_scale
    chain[4, 5] = dt_s * speed_mps * epsi_scale / ey_scale
    assert growth_excess(chain) == 0.0
    assert growth_excess(1.02 * chain) > 0.0


def test_growth_excess_has_a_small_gradient_where_eigenvalues_coincide():
    """Three integrators, 1e-12 away from defective, where eq. (11) has a huge gradient."""
    torch.manual_seed(3)
    start = torch.eye(3) + 0.3 * torch.diag(torch.ones(2), 1) + 1e-12 * torch.randn(3, 3)
    bounded = start.clone().requires_grad_()
    growth_excess(bounded).backward()
    literal = start.clone().requires_grad_()
    eigenvalue_excess(literal).backward()
    assert bounded.grad.norm() < 10.0
    assert literal.grad.norm() > 1e6


@pytest.mark.parametrize("preset", ["paper", "paper-literal"])
def test_regularisation_is_equation_12(preset):
    config = a_config(preset)
    model = a_model(config)
    A, B = model.operator()
    prior = torch.zeros_like(A) if preset == "paper-literal" else torch.eye(len(A))
    theta = sum((p**2).sum().item() for p in model.encoders.parameters())
    expected = 0.9 * theta + 0.5 * ((A - prior) ** 2).sum().item() + 0.5 * (B**2).sum().item()
    found = regularisation_loss(model.encoders.parameters(), A, B, prior, config)
    assert found.item() == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("preset", ["paper", "paper-literal"])
def test_total_loss_is_equation_13_with_the_weights_of_the_table(preset):
    config = a_config(preset)
    model, batch = a_model(config), a_batch()
    with torch.no_grad():
        model.A_rows += 0.2
    losses = total_loss(model, config, batch)
    assert losses.stability > 0
    expected = (
        1.0 * losses.single_step
        + 0.5 * losses.multi_step
        + 1.6 * losses.stability
        + 1e-4 * losses.regularisation
    )
    assert torch.isclose(losses.total, expected)


def test_forgetting_weights_sum_to_one_and_decay():
    weights = forgetting_weights(80, 0.9, through_last_step=True)
    assert weights.sum().item() == pytest.approx(1.0)
    assert weights[:29].sum().item() == pytest.approx(0.95, abs=0.01)
    assert forgetting_weights(80, 0.9, through_last_step=False)[-1] == 0.0


@pytest.fixture
def model() -> MdkNet:
    torch.manual_seed(0)
    return MdkNet(PRESETS["paper"], SIZES)


def the_encoder(model: MdkNet) -> nn.Module:
    """The paper has one."""
    (encoder,) = model.encoders
    return encoder


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


def test_the_states_share_of_the_multi_step_loss_excludes_the_latents():
    config = a_config("paper")
    model, batch = a_model(config), a_batch()
    losses = total_loss(model, config, batch)
    with torch.no_grad():
        last = model.encoders[0].layers[-1]
        last.weight.mul_(0.0)
        last.bias.mul_(0.0)
        model.A_rows[:6, 6:] = 0.0
        model.A_rows[6:] = 0.0
        model.B_rows[6:] = 0.0
    without_latents = total_loss(model, config, batch)
    assert losses.states < losses.multi_step
    assert torch.isclose(without_latents.states, without_latents.multi_step)
