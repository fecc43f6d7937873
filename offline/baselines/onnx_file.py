"""ONNX models written without torch: the version of the format, and the plainest of all."""

import onnx
from onnx import TensorProto, helper

OPSET = 18
IR_VERSION = 10
"""of the file format, low enough for every onnxruntime this project admits"""


def identity_encoder(states: int) -> bytes:
    """An ONNX model that lifts x (batch, states) to psi = x."""
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, ["batch", states])
    psi = helper.make_tensor_value_info("psi", TensorProto.FLOAT, ["batch", states])
    graph = helper.make_graph([helper.make_node("Identity", ["x"], ["psi"])], "lift", [x], [psi])
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION
    )
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())
