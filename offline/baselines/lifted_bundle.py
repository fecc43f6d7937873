"""A dictionary model as a bundle: its lift written as ONNX, its scaling folded in.

The controller drives with it as with any other model.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper

from offline.baselines.functions import Family, Functions
from offline.baselines.lifted_model import LiftedModel
from offline.baselines.onnx_file import IR_VERSION, OPSET
from offline.dataset import Dataset
from offline.provenance import describe_training
from offline.roles import past_names
from rt_controller.contract.artifact import Bilinear, Bundle, Lift, LiftSample
from rt_controller.contract.follow import Follow

Array = NDArray[np.float64]


def as_bundle(name: str, model: LiftedModel, dataset: Dataset, selftest: LiftSample) -> Bundle:
    """The model as a bundle; `selftest` are instants with at least as much history as it needs."""
    lift = _lift_of(model, dataset)
    history = selftest.history[:, selftest.history.shape[1] - model.past_steps :]
    if not model.past_steps:
        history = np.zeros((len(selftest.x), 0, 0))  # nothing is remembered, so no columns either
    sample = LiftSample(selftest.x, selftest.w, history)
    psi = model.lift(sample.x, sample.w, sample.history)
    n, n_x, m = len(model.A), len(model.x_scale), len(model.u_scale)
    s, t = np.ones(n), np.zeros(n)
    s[:n_x], t[:n_x] = model.x_scale, model.x_centre
    psi[:, :n_x] = selftest.x
    A = model.A * s[:, None] / s[None, :]
    bilinear = None
    if len(model.gains):
        # u_i psi_g(r) with psi_g = (physical - t) / s: one gain each, the same for every input.
        N = (model.N * s[:, None]).reshape(n, -1, m).transpose(1, 0, 2) / model.u_scale
        S = np.zeros((len(model.gains), m, n))
        S[np.arange(len(model.gains)), :, model.gains] = 1.0 / s[model.gains, None]
        s0 = np.repeat((-t / s)[model.gains, None], m, axis=1)
        bilinear = Bilinear(N, S, s0, Follow(model.follow))
    findings = {finding.name: finding.value for finding in model.findings()}
    return Bundle(
        name=name,
        schema=dataset.schema,
        A=A,
        B_uc=model.B_uc * s[:, None] / model.u_scale,
        B_uw=model.B_uw * s[:, None] / model.w_scale,
        c=t - A @ t,
        bilinear=bilinear,
        lift=lift,
        encoder_onnx=_encoder(model, lift),
        selftest=sample,
        selftest_psi=psi,
        training=describe_training({"kind": name, **findings}, dataset.origin),
        data_sha256=dataset.sha256,
    )


def _lift_of(model: LiftedModel, dataset: Dataset) -> Lift:
    shown = ["x"]
    if model.functions.family is not Family.NONE:
        shown.append("w")
    if not model.past_steps:
        return Lift(tuple(shown))
    fields = past_names(dataset.schema, dataset.roles)
    return Lift((*shown, "history"), model.past_steps, fields)


class _Part(NamedTuple):
    """A step of the lift: nodes, and the constants they use."""

    nodes: list[NodeProto]
    constants: dict[str, NDArray[np.generic]]


def _encoder(model: LiftedModel, lift: Lift) -> bytes:
    """The lift: [x, scaled history, functions of scaled x and w, 1]."""
    n_x, p, h = len(model.x_scale), len(model.w_scale), len(model.past_scale)
    inputs = [_tensor("x", ["batch", n_x])]
    psi = ["x"]
    parts = []
    if lift.sees_history:
        inputs.append(_tensor("history", ["batch", model.past_steps, h]))
        parts.append(_scaling("history", model.past_centre, model.past_scale))
        parts.append(_Part([helper.make_node("Flatten", ["history_scaled"], ["past"])], {}))
        psi.append("past")
    if lift.sees_exogenous:
        inputs.insert(1, _tensor("w", ["batch", p]))
        parts.append(_scaling("x", model.x_centre, model.x_scale))
        parts.append(_scaling("w", np.zeros(p), model.w_scale))
        parts += _evaluation(model.functions)
        psi.append("values")
    parts.append(_one())
    nodes = [node for part in parts for node in part.nodes]
    nodes.append(helper.make_node("Concat", [*psi, "one"], ["psi"], axis=1))
    constants = [
        numpy_helper.from_array(value, name)
        for part in parts
        for name, value in part.constants.items()
    ]
    output = _tensor("psi", ["batch", len(model.A)])
    graph = helper.make_graph(nodes, "lift", inputs, [output], constants)
    encoder = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION
    )
    onnx.checker.check_model(encoder)
    return bytes(encoder.SerializeToString())


def _tensor(name: str, shape: list[str | int]) -> ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def _scaling(name: str, centre: Array, scale: Array) -> _Part:
    """`name` to `name`_scaled."""
    return _Part(
        [
            helper.make_node("Sub", [name, f"{name}_centre"], [f"{name}_moved"]),
            helper.make_node("Div", [f"{name}_moved", f"{name}_scale"], [f"{name}_scaled"]),
        ],
        {f"{name}_centre": _single(centre), f"{name}_scale": _single(scale)},
    )


def _evaluation(functions: Functions) -> Iterator[_Part]:
    """`x_scaled` and `w_scaled` to `values`."""
    yield _Part([helper.make_node("Concat", ["x_scaled", "w_scaled"], ["v"], axis=1)], {})
    if functions.family is Family.MONOMIALS:
        yield _one("factor")
        nodes = [helper.make_node("Concat", ["v", "factor"], ["factors"], axis=1)]
        constants: dict[str, NDArray[np.generic]] = {}
        degree = functions.rows.shape[1]
        for i, column in enumerate(functions.rows.T.astype(np.int64)):
            constants[f"column_{i}"] = column
            nodes.append(
                helper.make_node("Gather", ["factors", f"column_{i}"], [f"factor_{i}"], axis=1)
            )
        product = "factor_0"
        for i in range(1, degree):
            target = "values" if i == degree - 1 else f"product_{i}"
            nodes.append(helper.make_node("Mul", [product, f"factor_{i}"], [target]))
            product = target
        yield _Part(nodes, constants)
    elif functions.family is Family.GAUSSIANS:
        yield _Part(
            [
                helper.make_node("Unsqueeze", ["v", "middle"], ["v_each"]),
                helper.make_node("Sub", ["v_each", "centres"], ["apart"]),
                helper.make_node("Mul", ["apart", "apart"], ["squares"]),
                helper.make_node("ReduceSum", ["squares", "last"], ["distance"], keepdims=0),
                helper.make_node("Mul", ["distance", "sharpness"], ["exponent"]),
                helper.make_node("Exp", ["exponent"], ["values"]),
            ],
            {
                "middle": np.array([1], dtype=np.int64),
                "last": np.array([2], dtype=np.int64),
                "centres": _single(functions.rows[None]),
                "sharpness": _single(np.array(-0.5 / functions.width**2)),
            },
        )
    else:
        yield _Part(
            [
                helper.make_node("MatMul", ["v", "frequencies"], ["turns"]),
                helper.make_node("Add", ["turns", "phases"], ["angles"]),
                helper.make_node("Cos", ["angles"], ["values"]),
            ],
            {"frequencies": _single(functions.rows.T), "phases": _single(functions.shifts)},
        )


def _one(name: str = "one") -> _Part:
    """`name`: a column of ones, one for each row of x."""
    rows, shape, width = f"{name}_rows", f"{name}_shape", f"{name}_width"
    filled = helper.make_tensor("value", TensorProto.FLOAT, [1], [1.0])
    return _Part(
        [
            helper.make_node("Shape", ["x"], [rows], start=0, end=1),
            helper.make_node("Concat", [rows, width], [shape], axis=0),
            helper.make_node("ConstantOfShape", [shape], [name], value=filled),
        ],
        {width: np.array([1], dtype=np.int64)},
    )


def _single(array: Array) -> NDArray[np.generic]:
    return np.ascontiguousarray(array, dtype=np.float32)
