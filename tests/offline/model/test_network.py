"""The encoder input, the observables and the effect of the inputs."""

from math import exp

import pytest
import torch
from torch import Tensor

from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import Instants
from offline.data.signals import VEHICLE_ROLES, Roles
from offline.model.network import FADING_S, MdkNet, Sizes, sizes_of
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.schema import VEHICLE, Schema, Signal

SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)
STATES, LATENTS, HISTORY, RANK, BATCH = 6, 5, 3, 2, 4


def a_config(**changes: object) -> TrainingConfig:
    """All extensions switched on; `changes` switch some off."""
    small = {"hidden": (8, 8), "latents": LATENTS, "history_steps": HISTORY, "bilinear_rank": RANK}
    return PRESETS["recommended"].model_copy(update={**small, **changes})


def a_model(sizes: Sizes = SIZES, **changes: object) -> MdkNet:
    torch.manual_seed(1)
    model = MdkNet(a_config(**changes), sizes)
    with torch.no_grad():
        model.B_rows.normal_()
        if model.rank:
            model.N_rows.normal_()
            model.S.normal_()
    return model


def instants(*leading: int, history: int = HISTORY) -> Instants:
    torch.manual_seed(2)
    return Instants(
        torch.randn(*leading, STATES), torch.randn(*leading, 1), torch.randn(*leading, history, 6)
    )


def test_sizes_are_the_numbers_of_signals_and_of_history_columns():
    schema = Schema(
        states=(Signal("a", "1"), Signal("b", "1"), Signal("c", "1")),
        inputs=(Signal("d", "1"), Signal("e", "1")),
        exogenous=(),
        dt_s=0.1,
    )
    roles = Roles(centred=(), odd=None, past=("a", "c", "e"))
    assert sizes_of(schema, roles) == Sizes(3, 2, 0, 3, 0.1)
    assert Sizes(6, 3, 1, 6, 0.025) == SIZES


def test_encoder_input_is_states_exogenous_signals_and_history_oldest_first():
    now = instants(BATCH)
    expected = torch.cat([now.x, now.w, *now.past.unbind(1)], dim=-1)
    assert torch.equal(a_model().encoder_input(now), expected)


@pytest.mark.parametrize("sees_w", [False, True])
@pytest.mark.parametrize("history", [0, HISTORY])
def test_encoder_input_contains_only_what_is_configured(sees_w, history):
    model = a_model(lift_exogenous=sees_w, history_steps=history)
    shown = model.encoder_input(instants(BATCH, history=history))
    assert shown.shape[-1] == STATES + sees_w + 6 * history
    assert model.encoder.layers[0].in_features == shown.shape[-1]


@pytest.mark.parametrize("constant", [False, True])
@pytest.mark.parametrize("history", [0, HISTORY])
@pytest.mark.parametrize("sees_w", [False, True])
def test_observables_are_states_then_latents_then_the_constant(constant, history, sees_w):
    model = a_model(constant_observable=constant, history_steps=history, lift_exogenous=sees_w)
    now = instants(BATCH, history=history)
    psi = model.lift(now)
    assert psi.shape == (BATCH, STATES + LATENTS)
    assert model.n_observables == STATES + LATENTS
    assert torch.equal(psi[:, :STATES], now.x)
    learned = psi[:, STATES:-1] if constant else psi[:, STATES:]
    assert torch.equal(learned, model.encoder(model.encoder_input(now)))
    assert not constant or torch.equal(psi[:, -1], torch.ones(BATCH))


def test_lifting_many_times_at_once_equals_lifting_each():
    model, now = a_model(), instants(7, BATCH)
    psi = model.lift(now)
    for t in range(7):
        alone = model.lift(Instants(*(signal[t] for signal in now)))
        assert torch.allclose(psi[t], alone, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "matters"),
    [
        ({}, (True, True)),
        ({"lift_exogenous": False}, (False, True)),
        ({"history_steps": 0}, (True, False)),
    ],
)
def test_latents_depend_on_curvature_and_history_only_if_configured(changes, matters):
    model, now = a_model(**changes), instants(BATCH)
    psi = model.lift(now)
    others = (now._replace(w=now.w + 1.0), now._replace(past=now.past + 1.0))
    assert tuple(not torch.equal(model.lift(other), psi) for other in others) == matters


def written_out(model: MdkNet, psi0: Tensor, u: Tensor, w: Tensor) -> Tensor:
    """Step by step and input by input: A psi + (B_i + sum_r N_ri (S_ri psi')) u_i + B_w w.

    psi' is psi, psi_0, or what psi_0 has become by then without inputs.
    """
    A, B = model.operator()
    N = model.bilinear_columns() if model.rank else ()
    states = torch.zeros(len(u), BATCH, model.n_observables, dtype=psi0.dtype)
    for b in range(BATCH):
        psi = followed = psi0[b]
        for k in range(len(u)):
            exogenous = B[:, 3] * w[k, b, 0]
            after = A @ psi + exogenous
            for i in range(3):
                column = B[:, i].clone()
                for r in range(model.rank):
                    column += N[r, :, i] * (model.S[r, i] @ followed)
                after = after + column * u[k, b, i]
            states[k, b] = psi = after
            if model.follows is Follow.PREDICTION:
                followed = psi
            elif model.follows is Follow.FREE_RESPONSE:
                followed = A @ followed + exogenous
    return states


@pytest.mark.parametrize("follows", Follow)
@pytest.mark.parametrize("rank", [0, 1, 3])
@pytest.mark.parametrize("constant", [False, True])
def test_a_roll_out_equals_the_recursion_written_out(rank, constant, follows):
    model = a_model(bilinear_rank=rank, constant_observable=constant, bilinear_follows=follows)
    with torch.no_grad():
        model.A_rows += 0.1 * torch.randn_like(model.A_rows)
    model.double()  # rounding errors would grow in these roll-outs
    psi0 = torch.randn(BATCH, model.n_observables).double()
    u, w = torch.randn(6, BATCH, 3).double(), torch.randn(6, BATCH, 1).double()
    with torch.no_grad():
        found, expected = model.roll_out(psi0, u, w), written_out(model, psi0, u, w)
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("follows", Follow)
def test_a_roll_out_is_linear_in_the_inputs_unless_b_follows_the_prediction(follows):
    """The controller linearises such a model along its last plan."""
    model = a_model(bilinear_follows=follows)
    psi0, w = model.lift(instants(BATCH)), torch.randn(20, BATCH, 1)
    one, other = torch.randn(2, 20, BATCH, 3)
    with torch.no_grad():
        mixed = model.roll_out(psi0, 0.3 * one + 0.7 * other, w)
        expected = 0.3 * model.roll_out(psi0, one, w) + 0.7 * model.roll_out(psi0, other, w)
    is_linear = torch.allclose(mixed, expected, rtol=1e-4, atol=1e-3)
    assert is_linear == (follows is not Follow.PREDICTION)


def test_the_effect_of_inputs_depends_on_the_state_only_with_a_bilinear_part():
    u, w = torch.randn(1, BATCH, 3), torch.randn(1, BATCH, 1)
    for rank, changes in ((0, False), (RANK, True)):
        model = a_model(bilinear_rank=rank)
        here, there = torch.randn(2, BATCH, model.n_observables)
        same = torch.equal(model.forcing(here[None], u, w), model.forcing(there[None], u, w))
        assert same != changes


def test_exogenous_signals_have_no_bilinear_part():
    model = a_model()
    here, there = torch.randn(2, BATCH, model.n_observables)
    u, w = torch.zeros(1, BATCH, 3), torch.randn(1, BATCH, 1)
    assert torch.equal(model.forcing(here[None], u, w), model.forcing(there[None], u, w))


@pytest.mark.parametrize("rank", [0, RANK])
def test_the_constant_observable_stays_exactly_one(rank):
    model = a_model(bilinear_rank=rank)
    psi0 = model.lift(instants(BATCH))
    u, w = 0.1 * torch.randn(80, BATCH, 3), torch.randn(80, BATCH, 1)
    forcing = model.forcing(psi0[None], u, w)
    assert torch.equal(forcing[..., -1], torch.zeros(80, BATCH))
    assert forcing[..., :-1].abs().min() > 0.0
    psi = model.roll_out(psi0, u, w)
    assert torch.equal(psi[..., -1], torch.ones(80, BATCH))


def test_a_constant_input_matrix_needs_no_bilinear_parameters():
    names = {name for name, _ in a_model(bilinear_rank=0).named_parameters()}
    more = {name for name, _ in a_model().named_parameters()} - names
    assert more == {"N_rows", "S"}


def test_fading_latents_start_with_the_configured_time_constants():
    model = a_model(latents=21)
    A = model.operator().A.detach()
    latents = A.diagonal()[STATES:-1]
    assert latents[0].item() == pytest.approx(exp(-0.025 / FADING_S[0]), abs=0.01)
    assert latents[-1].item() == pytest.approx(exp(-0.025 / FADING_S[1]), abs=0.01)
    assert torch.all(latents.diff() > -0.01)
    assert torch.allclose(A.diagonal()[:STATES], torch.ones(STATES), atol=0.01)
    assert A[-1].tolist() == [0.0] * 26 + [1.0]


@pytest.mark.parametrize("name", PRESETS)
def test_the_first_roll_out_of_every_preset_is_bounded(name):
    """A start with spectral radius 8 would reach 1e72 over the horizon."""
    config = PRESETS[name]
    torch.manual_seed(config.seed)
    model = MdkNet(config, SIZES)
    torch.manual_seed(3)
    now = Instants(
        torch.randn(32, STATES), torch.randn(32, 1), torch.randn(32, config.history_steps, 6)
    )
    with torch.no_grad():
        psi0 = model.lift(now)
        psi = model.roll_out(psi0, torch.randn(80, 32, 3), torch.randn(80, 32, 1))
    assert psi.abs().max() < 100.0


def test_a_model_without_exogenous_signals_has_no_columns_for_them():
    model = a_model(Sizes(STATES, 3, 0, 6, 0.1))
    now = instants(BATCH)._replace(w=torch.zeros(BATCH, 0))
    psi0 = model.lift(now)
    forcing = model.forcing(psi0[None], torch.randn(2, BATCH, 3), torch.zeros(2, BATCH, 0))
    assert model.operator().B.shape == (STATES + LATENTS, 3)
    assert forcing.shape == (2, BATCH, STATES + LATENTS)
