"""What the lift sees, the observables, and the effect of inputs and drift."""

from math import exp

import pytest
import torch
import transcribed_model
from torch import Tensor

from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import Instants
from offline.data.signals import VEHICLE_ROLES, Roles
from offline.model.network import FADING_S, MdkNet
from offline.model.observables import PathColumns, Sizes, sizes_of
from rt_controller.contract.signals import VEHICLE, Schema, Signal
from rt_controller.model.follow import Follow

SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)
STATES, LATENTS, HISTORY, RANK, BATCH = 6, 7, 3, 2, 4
PATH_LATENTS = 2


def a_config(**changes: object) -> TrainingConfig:
    """All extensions switched on; `changes` switch some off."""
    small = {"hidden": (8, 8), "latents": LATENTS, "history_steps": HISTORY, "bilinear_rank": RANK}
    small |= {"path_latents": PATH_LATENTS, "path_hidden": (6,), "path_rank": 1, "drift_rank": 2}
    return PRESETS["recommended"].model_copy(update={**small, **changes})


def a_model(sizes: Sizes = SIZES, **changes: object) -> MdkNet:
    torch.manual_seed(1)
    model = MdkNet(a_config(**changes), sizes)
    with torch.no_grad():
        model.B_rows.normal_()
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
    assert Sizes(6, 3, 1, 6, 0.025, PathColumns(3, 4, 5), (0,), speed=0) == SIZES


def test_progress_begins_as_the_speed():
    start = MdkNet(a_config(), SIZES).operator().A[3]
    assert start[0].item() == pytest.approx(1.0, abs=0.01)
    assert start[1:].abs().max().item() < 0.01


def test_the_lift_sees_states_exogenous_signals_and_history_oldest_first():
    now = instants(BATCH)
    expected = torch.cat([now.x, now.w, *now.past.unbind(1)], dim=-1)
    assert torch.equal(a_model().seen(now), expected)


@pytest.mark.parametrize("sees_w", [False, True])
@pytest.mark.parametrize("history", [0, HISTORY])
def test_the_lift_sees_only_what_is_configured(sees_w, history):
    model = a_model(lift_exogenous=sees_w, history_steps=history, separate_motion=False)
    shown = model.seen(instants(BATCH, history=history))
    assert shown.shape[-1] == STATES + sees_w + 6 * history
    (encoder,) = model.encoders
    assert encoder.layers[0].in_features == shown.shape[-1]


@pytest.mark.parametrize("sees_w", [False, True])
@pytest.mark.parametrize("history", [0, HISTORY])
def test_the_motion_is_encoded_from_motion_and_history_and_the_path_from_this_instant(
    sees_w, history
):
    """Columns: speeds and yaw rate, path states, curvature, history."""
    model = a_model(lift_exogenous=sees_w, history_steps=history)
    of_motion, of_path = model.encoders
    first_of_history = STATES + sees_w
    past = range(first_of_history, first_of_history + 6 * history)
    assert of_motion.columns.tolist() == [0, 1, 2, *past]
    assert of_path.columns.tolist() == list(range(first_of_history))
    assert (of_motion.present, of_path.present) == (3, first_of_history)


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
    latents = [encoder(model.seen(now)) for encoder in model.encoders]
    assert torch.equal(learned, torch.cat(latents, dim=-1))
    assert [each.shape[1] for each in latents] == [LATENTS - constant - PATH_LATENTS, PATH_LATENTS]
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


@pytest.mark.parametrize("follows", Follow)
@pytest.mark.parametrize(
    "changes",
    [
        {"bilinear_rank": 0, "drift_rank": 0},
        {"bilinear_rank": 0},
        {"bilinear_rank": 1, "saturating_gains": False},
        {"bilinear_rank": 3, "drift_rank": 0},
        {"bilinear_rank": 3},
        {"bilinear_rank": 2, "constant_observable": False},
        {"bilinear_rank": 2, "path_rank": 0},
        {"separate_motion": False},
    ],
)
def test_a_roll_out_equals_the_recursion_written_out(changes, follows):
    model = a_model(bilinear_follows=follows, **changes)
    assert_written_out(model)


ROADS = Schema(
    states=tuple(Signal(name, unit) for name, unit in VEHICLE.states),
    inputs=(Signal("steer_rad", "rad"), Signal("force_n", "N")),
    exogenous=(Signal("wind_mps", "m/s"), Signal("curvature_per_m", "1/m")),
    dt_s=0.025,
)


@pytest.mark.parametrize(
    "sizes",
    [
        Sizes(4, 2, 0, 5, 0.1),
        Sizes(4, 2, 3, 5, 0.1),
        sizes_of(ROADS, Roles(centred=(), odd=None, past=("steer_rad",))),
        Sizes(6, 2, 3, 1, 0.1, PathColumns(5, 0, 2), (0, 2)),
        Sizes(6, 1, 0, 1, 0.1, PathColumns(3, 4, 5), ()),
    ],
    ids=["no road", "no path", "wind and road", "two road signals", "path without road"],
)
def test_a_roll_out_of_other_signals_equals_the_recursion_written_out(sizes):
    model = a_model(sizes)
    assert_written_out(model)
    drift = a_config().drift_rank + bool(sizes.path) * len(sizes.road)
    assert int((model.factor_columns >= sizes.inputs).sum()) == drift


def assert_written_out(model: MdkNet) -> None:
    with torch.no_grad():
        model.A_rows += 0.1 * torch.randn_like(model.A_rows)
    model.double()  # rounding errors would grow in these roll-outs
    psi0 = torch.randn(BATCH, model.n_observables).double()
    u = torch.randn(6, BATCH, model.sizes.inputs).double()
    w = torch.randn(6, BATCH, model.sizes.exogenous).double()
    with torch.no_grad():
        found = model.roll_out(psi0, u, w)
        for b in range(BATCH):
            expected = transcribed_model.roll_out(model, psi0[b], u[:, b], w[:, b])
            torch.testing.assert_close(found[:, b], expected, rtol=1e-9, atol=1e-9)


def test_without_a_bilinear_part_the_drift_follows_the_prediction():
    """As in the controller, which has no other choice stored for it."""
    for follows in Follow:
        assert a_model(bilinear_rank=0, bilinear_follows=follows).follows is Follow.PREDICTION


@pytest.mark.parametrize("changes", [{}, {"saturating_gains": False}, {"separate_motion": False}])
def test_the_driven_matrix_is_the_derivative_of_a_step(changes):
    model = a_model(**changes).double()
    psi = 0.3 * torch.randn(model.n_observables, dtype=torch.float64)
    u, w = torch.randn(3, dtype=torch.float64), torch.randn(1, dtype=torch.float64)

    def after(psi: Tensor) -> Tensor:
        return transcribed_model.step(model, psi, psi, u, w)

    slopes = 1.0 - torch.tanh(model.gains().S @ psi).square()
    J = model.driven_matrices(torch.cat([u, w])[None], slopes[None])[0]
    torch.testing.assert_close(J, torch.autograd.functional.jacobian(after, psi))


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
        model = a_model(bilinear_rank=rank, drift_rank=0)
        here, there = torch.randn(2, BATCH, model.n_observables)
        same = torch.equal(model.forcing(here[None], u, w), model.forcing(there[None], u, w))
        assert same != changes


def test_without_saturation_exogenous_signals_have_no_bilinear_part():
    model = a_model(saturating_gains=False)
    assert model.factor_columns.max() < 3
    here, there = torch.randn(2, BATCH, model.n_observables)
    u, w = torch.zeros(1, BATCH, 3), torch.randn(1, BATCH, 1)
    assert torch.equal(model.forcing(here[None], u, w), model.forcing(there[None], u, w))


@pytest.mark.parametrize("rank", [0, RANK])
def test_the_constant_observable_stays_exactly_one(rank):
    model = a_model(bilinear_rank=rank)
    with torch.no_grad():
        model.N_rows *= 0.01  # with larger ones the roll-out diverges
    psi0 = model.lift(instants(BATCH))
    u, w = 0.1 * torch.randn(80, BATCH, 3), torch.randn(80, BATCH, 1)
    forcing = model.forcing(psi0[None], u, w)
    assert torch.equal(forcing[..., -1], torch.zeros(80, BATCH))
    assert forcing[..., :-1].abs().min() > 0.0
    psi = model.roll_out(psi0, u, w)
    assert torch.equal(psi[..., -1], torch.ones(80, BATCH))


def test_a_linear_model_has_no_gains():
    linear, bent = a_model(bilinear_rank=0, drift_rank=0), a_model()
    assert linear.N_rows.numel() == linear.S.numel() == 0
    assert bent.factor_columns.tolist() == [0, 1, 2] * (RANK + 1) + [3, 4, 4]
    assert bent.S.shape == (3 * (RANK + 1) + 3, STATES + LATENTS)


def test_one_block_of_observables_has_no_gains_of_the_path():
    model = a_model(separate_motion=False)
    assert model.factor_columns.tolist() == [0, 1, 2] * RANK + [4, 4]
    assert model.A_learned.all()
    assert model.N_learned.all()
    assert model.S_learned.all()


def test_fading_latents_start_with_the_configured_time_constants():
    model = a_model(latents=23)
    A = model.operator().A.detach()
    latents = A.diagonal()[STATES : STATES + 20]
    assert latents[0].item() == pytest.approx(exp(-0.025 / FADING_S[0]), abs=0.01)
    assert latents[-1].item() == pytest.approx(exp(-0.025 / FADING_S[1]), abs=0.01)
    assert torch.all(latents.diff() > -0.01)
    persistent = [0, 1, 2, 4, 5, 26, 27]
    assert torch.allclose(A.diagonal()[persistent], torch.ones(7), atol=0.01)
    assert A[-1].tolist() == [0.0] * 28 + [1.0]


def test_the_range_of_the_signals_is_one_if_it_is_not_known():
    assert a_model().signal_range.tolist() == [[-1.0] * 4, [1.0] * 4]


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
    u, w = torch.randn(2, BATCH, 3), torch.zeros(2, BATCH, 0)
    assert model.operator().B.shape == (STATES + LATENTS, 3)
    assert model.forcing(psi0[None], u, w).shape == (2, BATCH, STATES + LATENTS)
    assert torch.isfinite(model.roll_out(psi0, u, w)).all()
