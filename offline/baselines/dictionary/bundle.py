"""A dictionary model as a bundle: its lift in ONNX, the scaling folded into the matrices."""

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper, parser

from offline.baselines.baseline import describe_fit
from offline.baselines.dictionary.functions import Family, Functions
from offline.baselines.dictionary.model import Dictionary, LiftedModel
from offline.data.dataset import Dataset
from offline.data.signals import last_rows, past_names
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.identity_encoder import IR_VERSION, OPSET
from rt_controller.contract.model.lift import Lift, LiftSample

Constants = dict[str, NDArray[np.generic]]


def to_bundle(name: str, model: LiftedModel, dataset: Dataset, sample: LiftSample) -> Bundle:
    """The model as a bundle; `sample` are instants with at least the past that it needs."""
    dictionary, scaling = model.dictionary, model.dictionary.scaling
    past_steps = dictionary.past_steps
    fields = past_names(dataset.schema, dataset.roles) if past_steps else ()
    lift = Lift(dictionary.functions.family is not Family.NONE, past_steps, fields)
    history = last_rows(sample.history, past_steps)[..., : len(fields)]
    sample = LiftSample(sample.x, sample.w, history)
    psi = dictionary.lift(sample.x, sample.w, sample.history)
    psi[:, : len(scaling.x_scale)] = sample.x
    return Bundle(
        name=name,
        schema=dataset.schema,
        geometry=dataset.geometry,
        **scaling.to_physical(model.matrices)._asdict(),
        lift=lift,
        encoder_onnx=_encoder(dictionary, lift, psi.shape[1]),
        selftest=sample,
        selftest_psi=psi,
        training=describe_fit(name, model, dataset),
        data_sha256=dataset.sha256,
    )


def _encoder(dictionary: Dictionary, lift: Lift, n: int) -> bytes:
    """The lift in ONNX: psi = [x, scaled history, functions of scaled x and w, 1]."""
    scaling = dictionary.scaling
    constants: Constants = {"one_width": np.array([1])}
    nodes = [
        "rows = Shape <start = 0, end = 1> (x)",
        "one_shape = Concat <axis = 0> (rows, one_width)",
        "one = ConstantOfShape <value = float[1] {1.0}> (one_shape)",
    ]
    inputs, psi = [f"float[batch, {len(scaling.x_scale)}] x"], ["x"]
    if lift.sees_exogenous:
        inputs.append(f"float[batch, {len(scaling.w_scale)}] w")
    if lift.sees_history:
        inputs.append(f"float[batch, {dictionary.past_steps}, {len(scaling.past_scale)}] history")
        constants |= {"p_centre": scaling.past_centre, "p_scale": scaling.past_scale}
        nodes += [
            "p_centred = Sub (history, p_centre)",
            "p_scaled = Div (p_centred, p_scale)",
            "past = Flatten (p_scaled)",
        ]
        psi.append("past")
    if lift.sees_exogenous:
        for constant in ("x_centre", "x_scale", "w_scale"):
            constants[constant] = getattr(scaling, constant)
        nodes += [
            "x_centred = Sub (x, x_centre)",
            "x_scaled = Div (x_centred, x_scale)",
            "w_scaled = Div (w, w_scale)",
            "v = Concat <axis = 1> (x_scaled, w_scaled)",
            *_evaluation(dictionary.functions, constants),
        ]
        psi.append("values")
    nodes.append(f"psi = Concat <axis = 1> ({', '.join(psi)}, one)")
    signature = f"lift ({', '.join(inputs)}) => (float[batch, {n}] psi)"
    graph = parser.parse_graph("\n".join([signature, "{", *nodes, "}"]))
    for name, value in constants.items():
        kind = value.dtype if value.dtype == np.int64 else np.float32
        graph.initializer.append(
            numpy_helper.from_array(np.ascontiguousarray(value, dtype=kind), name)
        )
    opset = [helper.make_opsetid("", OPSET)]
    encoder = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION)
    onnx.checker.check_model(encoder)
    return bytes(encoder.SerializeToString())


def _evaluation(functions: Functions, constants: Constants) -> list[str]:
    """Nodes that compute `values` from `v`; what they need is added to the constants."""
    if functions.family is Family.MONOMIALS:
        columns = functions.rows.T.astype(np.int64)
        constants |= {f"column_{i}": column for i, column in enumerate(columns)}
        nodes = ["factors = Concat <axis = 1> (v, one)"]
        nodes += [f"f_{i} = Gather <axis = 1> (factors, column_{i})" for i in range(len(columns))]
        product = "f_0"
        for i in range(1, len(columns)):
            nodes.append(f"product_{i} = Mul ({product}, f_{i})")
            product = f"product_{i}"
        return [*nodes, f"values = Identity ({product})"]
    if functions.family is Family.GAUSSIANS:
        constants |= {"middle": np.array([1]), "last": np.array([2])}
        constants |= {"centres": functions.rows[None], "minus": np.array(-0.5 / functions.width**2)}
        return [
            "v_each = Unsqueeze (v, middle)",
            "difference = Sub (v_each, centres)",
            "squares = Mul (difference, difference)",
            "distance = ReduceSum <keepdims = 0> (squares, last)",
            "exponent = Mul (distance, minus)",
            "values = Exp (exponent)",
        ]
    constants |= {"frequencies": functions.rows.T, "phases": functions.shifts}
    return [
        "products = MatMul (v, frequencies)",
        "angles = Add (products, phases)",
        "values = Cos (angles)",
    ]
