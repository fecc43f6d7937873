"""The exported bundle equals the trained network, in physical units."""

import copy
import getpass
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnxruntime
import pytest
import torch
from made_models import added_by_gains
from numpy.typing import NDArray

from offline.config import PAST_STEPS, PRESETS, TrainingConfig
from offline.data.sampling import Batch, scale
from offline.data.signals import VEHICLE_ROLES, Scaling, Trajectories
from offline.model.bundle_predictor import BundlePredictor
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.model.path import units_of
from offline.model.physical_units import PhysicalEncoder, physical_matrices, to_onnx
from rt_controller.contract.signals import PATH_STATES, VEHICLE
from rt_controller.model.bundle import Bundle
from rt_controller.model.follow import Follow
from rt_controller.model.lift import Lift, LiftSample
from rt_controller.model.path_kinematics import path_after

STEPS = 80

SCALING = Scaling(
    x_centre=np.array([22.0, 0.0, 0.0, 0.55, 0.0, 0.0]),
    x_scale=np.array([7.0, 0.2, 0.1, 0.18, 3.0, 0.15]),
    u_scale=np.array([0.4, 30.0, 0.3]),
    w_scale=np.array([2.8e-3]),
    past_centre=np.array([22.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    past_scale=np.array([7.0, 0.2, 0.1, 0.4, 30.0, 0.3]),
)

CONFIGS: dict[str, TrainingConfig] = {
    "x": PRESETS["paper"],
    "x, no constant": PRESETS["paper-literal"],
    "x and w": PRESETS["paper"].model_copy(update={"lift_exogenous": True}),
    "x and history": PRESETS["linear"].model_copy(
        update={"lift_exogenous": False, "history_steps": 2}
    ),
    "x, w and history": PRESETS["linear"],
    "x, w and history, without products": PRESETS["linear"].model_copy(update={"products": False}),
    "products of x": PRESETS["paper"].model_copy(update={"products": True}),
    "saturating": PRESETS["recommended"],
    "saturating along the free response": PRESETS["recommended"].model_copy(
        update={"bilinear_follows": Follow.FREE_RESPONSE}
    ),
    "drift alone": PRESETS["recommended"].model_copy(update={"bilinear_rank": 0}),
    "bilinear, motion not separate": PRESETS["recommended"].model_copy(
        update={"saturating_gains": False, "separate_motion": False}
    ),
    "saturating at the start, no constant": PRESETS["recommended"].model_copy(
        update={"bilinear_follows": Follow.START, "constant_observable": False, "latents": 7}
    ),
}


class Exported(NamedTuple):
    """A network and its exported encoder."""

    model: MdkNet
    lift: Lift
    onnx: bytes


def a_model(config: TrainingConfig) -> MdkNet:
    """Untrained, but with every parameter changed from its initial value."""
    torch.manual_seed(0)
    model = MdkNet(config, sizes_of(VEHICLE, VEHICLE_ROLES), units=units_of(SCALING))
    with torch.no_grad():
        model.A_rows += 0.002 * torch.randn_like(model.A_rows)
        model.B_rows += 0.02 * torch.randn_like(model.B_rows)
        model.N_rows += 0.02 * torch.randn_like(model.N_rows)
        for encoder in model.encoders:
            if encoder.products is not None:
                weight = encoder.products.weights.weight
                weight += 0.05 * torch.randn_like(weight)
            for layer in encoder.layers:
                if isinstance(layer, torch.nn.Linear):
                    layer.bias += 0.1 * torch.randn_like(layer.bias)
        if model.path is not None:
            model.path.change.normal_(std=0.01)
    return model


def lift_of(model: MdkNet) -> Lift:
    fields = VEHICLE_ROLES.past if model.history_steps else ()
    return Lift(model.reads_exogenous, model.history_steps, fields)


BY_NIGHT = {
    "x and w",
    "x, w and history, without products",
    "products of x",
    "saturating along the free response",
    "drift alone",
}
"""each part of them is in another one: an export takes a second"""


@pytest.fixture(
    params=[
        pytest.param(name, marks=[pytest.mark.nightly] if name in BY_NIGHT else [])
        for name in CONFIGS
    ],
    scope="module",
)
def exported(request) -> Exported:
    model = a_model(CONFIGS[request.param])
    lift = lift_of(model)
    encoder = PhysicalEncoder(model, SCALING).eval()
    return Exported(model, lift, to_onnx(encoder, lift, sample(drives(2), lift)))


@pytest.fixture(scope="module")
def session(exported) -> onnxruntime.InferenceSession:
    return onnxruntime.InferenceSession(exported.onnx, providers=["CPUExecutionProvider"])


def drives(n: int) -> Trajectories:
    """Random trajectories of a car's magnitude, in physical units and single precision."""
    rng = np.random.default_rng(1)
    s = SCALING
    return Trajectories(
        x=np.float32(rng.normal(size=(n, STEPS + 1, 6)) * s.x_scale + s.x_centre),
        u=np.float32(rng.normal(size=(n, STEPS, 3)) * s.u_scale),
        w=np.float32(rng.normal(size=(n, STEPS, 1)) * s.w_scale),
        past=np.float32(rng.normal(size=(n, PAST_STEPS, 6)) * s.past_scale + s.past_centre),
        episode=np.arange(n, dtype=np.int32),
    )


def sample(trajectories: Trajectories, lift: Lift) -> LiftSample:
    history = trajectories.past[:, PAST_STEPS - lift.history_steps :]
    return LiftSample(
        trajectories.x[:, 0].astype(np.float64),
        trajectories.w[:, 0].astype(np.float64),
        history[..., : len(lift.history_fields)].astype(np.float64),
    )


def scaled(trajectories: Trajectories, model: MdkNet) -> Batch:
    """Scaled as for the network, in double precision."""
    batch = scale(trajectories, SCALING, VEHICLE, VEHICLE_ROLES, model.history_steps)
    return Batch(*(series.double() for series in batch))


def precise(model: MdkNet) -> MdkNet:
    """In double precision, also the scaling that the path is computed with."""
    found = copy.deepcopy(model).double()
    if found.path is not None:
        found.path.centre = torch.from_numpy(SCALING.x_centre)
        found.path.scale = torch.from_numpy(SCALING.x_scale)
        found.path.curvature = torch.tensor(float(SCALING.w_scale[0]), dtype=torch.float64)
    return found


def lift_precisely(model: MdkNet, trajectories: Trajectories) -> NDArray[np.float64]:
    with torch.no_grad():
        batch = scaled(trajectories, model)
        return precise(model).lift(batch.at(torch.tensor([0])))[0].numpy()


def spread(psi: NDArray[np.float64]) -> NDArray[np.float64]:
    found = psi.std(axis=0)
    return np.where(found > 0.0, found, 1.0)


def run(session, lift: Lift, trajectories: Trajectories):
    shown = sample(trajectories, lift)
    feed = {name: getattr(shown, name).astype(np.float32) for name in lift.inputs}
    (psi,) = session.run(["psi"], feed)
    return psi


def test_the_onnx_inputs_are_those_that_the_lift_names(exported, session):
    lift = exported.lift
    shapes = {"x": [6], "w": [1], "history": [lift.history_steps, 6]}
    assert tuple(each.name for each in session.get_inputs()) == lift.inputs
    for each in session.get_inputs():
        assert each.type == "tensor(float)"
        assert each.shape[1:] == shapes[each.name]
        assert isinstance(each.shape[0], str)
    (output,) = session.get_outputs()
    assert (output.name, output.type) == ("psi", "tensor(float)")


@pytest.mark.parametrize("batch", [1, 2, 33])
def test_onnx_equals_the_scaled_network_for_any_batch_size(exported, session, batch):
    model = exported.model
    psi = run(session, exported.lift, drives(batch))
    expected = lift_precisely(model, drives(batch))
    assert psi.shape == (batch, model.n_observables)
    error = np.abs(psi[:, 6:] - expected[:, 6:]) / spread(lift_precisely(model, drives(200)))[6:]
    assert np.max(error) < 1e-5


def test_physical_states_pass_through_the_encoder_unchanged(exported, session):
    trajectories = drives(16)
    psi = run(session, exported.lift, trajectories)
    assert np.array_equal(psi[:, :6], trajectories.x[:, 0])


def test_the_constant_observable_is_exactly_one(exported, session):
    psi = run(session, exported.lift, drives(16))
    assert np.array_equal(psi[:, -1], np.ones(16)) == exported.model.has_constant


def roll_out_scaled(model: MdkNet, trajectories: Trajectories) -> NDArray[np.float64]:
    """Lifted states (K, batch, n) of the scaled model in double precision."""
    batch, double = scaled(trajectories, model), precise(model)
    with torch.no_grad():
        psi0 = double.lift(batch.at(torch.tensor([0])))[0]
        return double.roll_out(psi0, batch.u, batch.w).numpy()


def in_physical_units(psi: NDArray[np.float64]) -> NDArray[np.float64]:
    states = psi[..., :6] * SCALING.x_scale + SCALING.x_centre
    return np.concatenate([states, psi[..., 6:]], axis=-1)


def test_the_roll_out_in_physical_units_equals_the_scaled_one(exported):
    """The folded operator with its offset and its gains, in double precision."""
    model, trajectories = exported.model, drives(4)
    A, B_uc, B_uw, c, gains, movement = physical_matrices(precise(model), SCALING)
    batch = scaled(trajectories, model)
    u, w = batch.u.numpy() * SCALING.u_scale, batch.w.numpy() * SCALING.w_scale
    assert (gains is None) == (len(model.S) == 0)
    first = psi = free = in_physical_units(lift_precisely(model, trajectories))
    for k in range(STEPS):
        added = np.zeros(psi.shape)
        seen = {Follow.PREDICTION: psi, Follow.FREE_RESPONSE: free, Follow.START: first}
        if gains is not None:
            assert gains.follows is model.follows
            added = added_by_gains(gains, seen[model.follows], u[k], w[k])
            assert np.abs(added).max() > 1e-3
        undriven = w[k] @ B_uw.T + c
        before, psi = psi, psi @ A.T + u[k] @ B_uc.T + undriven + added
        if movement is not None:
            moved = before @ movement.S.T + movement.s0
            psi[:, PATH_STATES] = path_after(moved, w[k, :, 0], before[:, PATH_STATES])
        free = free @ A.T + undriven
    expected = in_physical_units(roll_out_scaled(model, trajectories)[-1])
    assert np.allclose(psi, expected, rtol=1e-9, atol=1e-9)


def test_the_bundle_predicts_the_same_as_the_network(exported):
    """In units of the spread of each state."""
    model, lift, trajectories = exported.model, exported.lift, drives(5)
    shown = sample(trajectories, lift)
    bundle = Bundle(
        name="mdk-net",
        **physical_matrices(model, SCALING)._asdict(),
        lift=lift,
        encoder_onnx=exported.onnx,
        selftest=shown,
        selftest_psi=in_physical_units(lift_precisely(model, trajectories)),
        training="{}",
        data_sha256="0" * 64,
    )
    x0, past, u, w = (
        each.astype(np.float64)
        for each in (trajectories.x[:, 0], trajectories.past, trajectories.u, trajectories.w)
    )
    found = BundlePredictor(bundle).predict(x0, past, u, w)
    expected = in_physical_units(roll_out_scaled(model, trajectories))[..., :6]
    assert np.array_equal(found[:, 0], x0)
    error = np.abs(found[:, 1:] - expected.swapaxes(0, 1)) / SCALING.x_scale
    assert np.max(error) < 1e-5


def test_the_exported_encoder_contains_no_path_or_name_of_the_machine(exported):
    places = {Path.cwd(), Path.home(), Path(tempfile.gettempdir()), Path(torch.__file__).parent}
    words = ["site-packages", "export.py", "File ", *(str(place) for place in places)]
    if getpass.getuser() != "root":  # "root" also occurs in other words
        words.append(getpass.getuser())
    for word in words:
        assert word.encode() not in exported.onnx, word
