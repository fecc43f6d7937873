"""A fair linear rival: one linear model with offset, by least squares, for all speeds and roads.

It starts from the measured state, has a constant term, and is fitted to every transition of the
training part at once. It ships as a bundle whose lift is the identity, so the controller drives
with it through the same code as with any other model.
"""

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper

from offline.dataset import Dataset, Trajectories
from offline.provenance import describe_training
from offline.scaling import Scaling, fit_scaling
from rt_controller.contract.artifact import N_STATES, Bundle
from rt_controller.contract.signals import ControlInput

Array = NDArray[np.float64]

CHUNK = 1_000
OPSET = 18
IR_VERSION = 10
"""of the file format, low enough for every onnxruntime this project admits"""


def fit_lti(dataset: Dataset, selftest_x: Array) -> Bundle:
    """The best one-step linear model of the training part, as a bundle named "lti".

    selftest_x (m, 6) are states to keep in the bundle for its self-test.
    """
    train = dataset.select("train")
    scaling = fit_scaling(train.x, train.u, train.kappa)
    A, B, offset = _least_squares(train, scaling)

    # From scaled to physical: x = S x_n + m, u = U u_n.
    S, m, U = scaling.x_scale, scaling.x_centre, scaling.u_scale
    A_physical = A * S[:, None] / S[None, :]
    B_physical = B * S[:, None] / U[None, :]
    c = m + S * offset - A_physical @ m
    n_inputs = len(ControlInput._fields)
    return Bundle(
        name="lti",
        A=A_physical,
        B_uc=np.ascontiguousarray(B_physical[:, :n_inputs]),
        B_uw=np.ascontiguousarray(B_physical[:, n_inputs:]),
        c=c,
        encoder_onnx=identity_encoder(),
        selftest_x=selftest_x,
        selftest_psi=selftest_x.astype(np.float32).astype(np.float64),
        training=describe_training(
            {"kind": "lti", "method": "one-step least squares with offset"}, dataset.origin
        ),
        data_sha256=dataset.sha256,
    )


def identity_encoder() -> bytes:
    """An ONNX model that lifts x (batch, 6) to psi = x."""
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, ["batch", N_STATES])
    psi = helper.make_tensor_value_info("psi", TensorProto.FLOAT, ["batch", N_STATES])
    graph = helper.make_graph([helper.make_node("Identity", ["x"], ["psi"])], "lift", [x], [psi])
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION
    )
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def _least_squares(train: Trajectories, scaling: Scaling) -> tuple[Array, Array, Array]:
    """A (6, 6), B (6, 4) and offset (6,) on scaled numbers.

    The triangular factor of [regressors, targets] is updated chunk by chunk: the accuracy of a QR
    factorisation of all transitions, in the memory of one chunk. Speed and progress are nearly
    proportional, so normal equations would square a large condition number.
    """
    n_regressors = N_STATES + len(scaling.u_scale) + 1
    R = np.zeros((0, n_regressors + N_STATES))
    for first in range(0, len(train.kappa), CHUNK):
        chunk = train.take(slice(first, first + CHUNK))
        x = scaling.normalise_states(chunk.x)
        kappa = np.broadcast_to(chunk.kappa[:, None, None], (*chunk.u.shape[:2], 1))
        u = np.concatenate([chunk.u, kappa], axis=-1) / scaling.u_scale
        ones = np.ones((*u.shape[:2], 1))
        rows = np.concatenate([x[:, :-1], u, ones, x[:, 1:]], axis=-1)
        _, R = np.linalg.qr(np.vstack([R, rows.reshape(-1, rows.shape[-1])]))
    found, *_ = np.linalg.lstsq(R[:, :n_regressors], R[:, n_regressors:], rcond=None)
    solution = np.asarray(found.T, dtype=np.float64)
    return solution[:, :N_STATES], solution[:, N_STATES:-1], solution[:, -1]
