"""The matrices in physical units predict what the scaled network predicts, for any signals."""

import numpy as np
import onnxruntime
import pytest
import torch

from offline.config import PRESETS
from offline.data.sampling import Instants
from offline.data.signals import Roles, Scaling
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.model.path import units_of
from offline.model.physical_units import PhysicalEncoder, physical_matrices, tensors_of, to_onnx
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import PATH_STATES, VEHICLE, Schema, Signal
from rt_controller.model.dynamics import Shape, roll_out
from rt_controller.model.lift import Lift, LiftSample

STEPS, BATCH, HISTORY = 40, 5, 2
CURVATURE, WIND = VEHICLE.exogenous[0], Signal("wind_mps", "m/s")
MOTION, PATH = VEHICLE.states[:3], VEHICLE.states[3:]
SCHEMAS = {
    "no road": Schema(MOTION, VEHICLE.inputs, (), 0.025),
    "road without path": Schema(MOTION, VEHICLE.inputs, (CURVATURE,), 0.025),
    "path without road": Schema(VEHICLE.states, VEHICLE.inputs[:1], (), 0.025),
    "wind, then road": Schema(VEHICLE.states, VEHICLE.inputs, (WIND, CURVATURE), 0.025),
    "road, then wind": Schema(VEHICLE.states, VEHICLE.inputs[1:], (CURVATURE, WIND), 0.025),
    "path first": Schema((*PATH[::-1], *MOTION), VEHICLE.inputs, (WIND, CURVATURE), 0.025),
}


def made(schema: Schema) -> tuple[MdkNet, Scaling]:
    torch.manual_seed(1)
    roles = Roles(centred=("vx_mps",), odd=None, past=("vx_mps", schema.input_names[0]))
    small = {"hidden": (8,), "latents": 7}
    ranks = {"history_steps": HISTORY, "bilinear_rank": 2, "drift_rank": 2}
    config = PRESETS["recommended"].model_copy(update=small | ranks)
    rng = np.random.default_rng(2)
    n_x, m, p = len(schema.states), len(schema.inputs), len(schema.exogenous)
    at = schema.state_names.index("vx_mps")
    centre, scale = np.zeros(n_x), rng.uniform(0.1, 0.5, n_x)
    centre[at] = 20.0
    u_scale, w_scale = rng.uniform(0.1, 50.0, m), rng.uniform(1e-3, 5e-3, p)
    past = np.array([20.0, 0.0]), np.array([scale[at], u_scale[0]])
    scaling = Scaling(centre, scale, u_scale, w_scale, *past)
    sizes = sizes_of(schema, roles)
    units = units_of(scaling) if sizes.has_path else None
    model = MdkNet(config, sizes, units=units).eval()
    with torch.no_grad():
        for parameter in (model.B_rows, model.N_rows):
            parameter.add_(0.05 * torch.randn_like(parameter))
        for encoder in model.encoders:
            encoder.products.weights.weight.normal_(std=0.05)
    return model, scaling


def drive(scaling: Scaling) -> tuple[LiftSample, Array, Array]:
    """What the lift is shown, inputs (batch, K, m) and exogenous signals (batch, K, p)."""
    rng = np.random.default_rng(3)

    def drawn(*shape: int) -> Array:
        return rng.normal(size=(BATCH, *shape))

    w = drawn(STEPS, scaling.w_scale.size) * scaling.w_scale
    return (
        LiftSample(
            drawn(scaling.x_scale.size) * scaling.x_scale + scaling.x_centre,
            w[:, 0],
            drawn(HISTORY, 2) * scaling.past_scale + scaling.past_centre,
        ),
        drawn(STEPS, scaling.u_scale.size) * scaling.u_scale,
        w,
    )


def by_the_network(
    model: MdkNet, scaling: Scaling, shown: LiftSample, u: Array, w: Array
) -> tuple[Array, Array]:
    """Lifted states (batch, n) and predicted ones (batch, K, n), in physical units."""
    double = model.double()
    x = (shown.x - scaling.x_centre) / scaling.x_scale
    past = (shown.history - scaling.past_centre) / scaling.past_scale
    now = Instants(*map(torch.from_numpy, (x, w[:, 0] / scaling.w_scale, past)))
    inputs = torch.from_numpy((u / scaling.u_scale).swapaxes(0, 1))
    exogenous = torch.from_numpy((w / scaling.w_scale).swapaxes(0, 1))
    with torch.no_grad():
        psi0 = double.lift(now)
        predicted = double.roll_out(psi0, inputs, exogenous)
    n_x = scaling.x_scale.size
    found = [psi0.numpy().copy(), predicted.numpy().swapaxes(0, 1).copy()]
    for psi in found:
        psi[..., :n_x] = psi[..., :n_x] * scaling.x_scale + scaling.x_centre
    return found[0], found[1]


@pytest.mark.parametrize("schema", SCHEMAS.values(), ids=SCHEMAS.keys())
def test_the_matrices_in_physical_units_predict_what_the_network_predicts(schema: Schema) -> None:
    model, scaling = made(schema)
    shown, u, w = drive(scaling)
    psi0, expected = by_the_network(model, scaling, shown, u, w)
    matrices = physical_matrices(model, scaling)
    assert {*matrices.gains.shape} == {Shape.TANH, Shape.SATURATION}
    found = roll_out(matrices, psi0, u, w, outputs=psi0.shape[1])
    spread = np.append(scaling.x_scale, np.ones(psi0.shape[1] - scaling.x_scale.size))
    error = np.abs((found[:, 1:] - expected) / spread)
    if model.path is not None:  # its scaling is in single precision
        assert error[..., PATH_STATES].max() < 1e-4
        error[..., PATH_STATES] = 0.0
    assert error.max() < 1e-9
    assert np.abs((expected[:, -1] - psi0) / spread).max() > 0.1


@pytest.mark.parametrize("name", ["no road", "path first"])
def test_the_exported_encoder_lifts_as_the_network_does(name: str) -> None:
    model, scaling = made(SCHEMAS[name])
    lift = Lift(model.reads_exogenous, HISTORY, ("vx_mps", SCHEMAS[name].input_names[0]))
    shown, u, w = drive(scaling)
    encoder = PhysicalEncoder(model, scaling).eval()
    session = onnxruntime.InferenceSession(
        to_onnx(encoder, lift, shown), providers=["CPUExecutionProvider"]
    )
    given = zip(lift.inputs, tensors_of(shown, lift), strict=True)
    (psi,) = session.run(["psi"], {key: tensor.numpy() for key, tensor in given})
    expected, _ = by_the_network(model, scaling, shown, u, w)
    n_x = scaling.x_scale.size
    assert np.array_equal(psi[:, :n_x], shown.x.astype(np.float32))
    assert np.abs(psi[:, n_x:] - expected[:, n_x:]).max() < 1e-5
