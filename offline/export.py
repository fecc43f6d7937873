"""From a checkpoint to a bundle that drives: scaling folded in, checked, weighed, written.

The run time knows physical units only. The encoder of the bundle takes physical x and returns
[x, z(x)], its first six outputs being x itself bit by bit; A, B and c act on that vector.
"""

import copy
import logging
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from offline.checkpoint import Checkpoint
from offline.dataset import Dataset
from offline.model import N_STATES, MdkNet
from offline.predictor import BundlePredictor
from offline.provenance import describe_training
from offline.scaling import Scaling
from rt_controller.contract.artifact import Bundle
from rt_controller.contract.errors import ArtifactError, DatasetError
from rt_controller.contract.signals import ControlInput

Array = NDArray[np.float64]

LARGEST_SPECTRAL_RADIUS = 1.05
LARGEST_PARITY_ERROR = 1e-5
SELFTEST_STATES = 32


@dataclass(frozen=True, slots=True)
class Gate:
    """What a bundle is weighed by before it may leave."""

    spectral_radius: float
    growth_20: float
    """||A^20||, observables in units of their spread"""
    growth_80: float
    parity: float
    """largest difference torch / ONNX, observables in units of their spread"""


class PhysicalEncoder(nn.Module):
    """The trained encoder, taking physical x and returning [x; z], scaling folded in.

    Folding happens in float64; a constant observable becomes an output whose weights are zero and
    whose bias is 1.
    """

    def __init__(self, model: MdkNet, scaling: Scaling) -> None:
        super().__init__()
        self.layers = copy.deepcopy(model.encoder)
        first = _linear(self.layers[0])
        weight = first.weight.data.double() / torch.from_numpy(scaling.x_scale)
        bias = first.bias.data.double() - weight @ torch.from_numpy(scaling.x_centre)
        first.weight.data, first.bias.data = weight.float(), bias.float()
        if model.has_constant:
            last = _linear(self.layers[-1])
            last.weight.data = torch.cat([last.weight.data, torch.zeros_like(last.weight.data[:1])])
            last.bias.data = torch.cat([last.bias.data, torch.ones(1)])

    def forward(self, x: Tensor) -> Tensor:
        return torch.cat([x, self.layers(x)], dim=-1)


def make_bundle(checkpoint: Checkpoint, dataset: Dataset) -> tuple[Bundle, Gate]:
    """The bundle of a trained model, and the figures of its gate.

    Raises:
        ArtifactError: the model grows without bound, is not finite, or ONNX and torch disagree.
        DatasetError: the data set is not the one that the model was trained on.
    """
    if dataset.sha256 != checkpoint.data_sha256:
        raise DatasetError(
            f"export expects the data set that the model was trained on, "
            f"{checkpoint.data_sha256:.16}…, found {dataset.sha256:.16}…. Name its folder with "
            f"--data."
        )
    model = MdkNet(checkpoint.config)
    model.load_state_dict(checkpoint.model)
    model.eval()
    scaling = checkpoint.scaling
    encoder = PhysicalEncoder(model, scaling).eval()
    scaled = model.operator()
    A, B, c = fold_scaling(
        scaled.A.detach().double().numpy(), scaled.B.detach().double().numpy(), scaling
    )
    selftest_x = choose_selftest_states(dataset)
    with torch.no_grad():
        selftest_psi = encoder(torch.from_numpy(selftest_x.astype(np.float32))).double().numpy()
    n_inputs = len(ControlInput._fields)
    bundle = Bundle(
        name="mdk-net",
        A=A,
        B_uc=np.ascontiguousarray(B[:, :n_inputs]),
        B_uw=np.ascontiguousarray(B[:, n_inputs:]),
        c=c,
        encoder_onnx=to_onnx(encoder),
        selftest_x=selftest_x,
        selftest_psi=selftest_psi,
        training=describe_training(
            {**checkpoint.config.model_dump(mode="json"), "step": checkpoint.step}, dataset.origin
        ),
        data_sha256=checkpoint.data_sha256,
    )
    return bundle, pass_gate(bundle)


def fold_scaling(A: Array, B: Array, scaling: Scaling) -> tuple[Array, Array, Array]:
    """A (n, n), B (n, 4) and offset c (n,) for psi = [x physical; z].

    With psi_n = (psi - t) / s of the scaled model, psi+ = S A S^-1 psi + S B U^-1 u + (I - S A
    S^-1) t, where s and t scale and centre the physical states and leave the latents alone.
    """
    n = A.shape[0]
    s, t = np.ones(n), np.zeros(n)
    s[:N_STATES], t[:N_STATES] = scaling.x_scale, scaling.x_centre
    A_physical = A * s[:, None] / s[None, :]
    B_physical = B * s[:, None] / scaling.u_scale[None, :]
    return A_physical, B_physical, t - A_physical @ t


def choose_selftest_states(dataset: Dataset) -> Array:
    """States (32, 6) spread evenly over the test part."""
    states = dataset.select("test").x[:, 0]
    rows = np.linspace(0, len(states) - 1, SELFTEST_STATES).astype(int)
    return np.asarray(states[rows], dtype=np.float64)


def to_onnx(encoder: nn.Module) -> bytes:
    """The encoder as ONNX: "x" float32 (batch, 6) -> "psi" float32 (batch, n), any batch."""
    example = torch.zeros(2, N_STATES)
    with tempfile.TemporaryDirectory() as folder, _quiet_exporter():
        path = Path(folder) / "encoder.onnx"
        torch.onnx.export(
            encoder,
            (example,),
            str(path),
            input_names=["x"],
            output_names=["psi"],
            dynamic_shapes={"x": {0: torch.export.Dim("batch")}},
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        serialised: bytes = _without_traces(onnx.load(path)).SerializeToString()
    return serialised


def _without_traces(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model without the exporter's notes: stack traces with the paths of this machine."""
    graph = model.graph
    values = (*graph.value_info, *graph.initializer, *graph.input, *graph.output)
    for noted in (model, graph, *graph.node, *values):
        del noted.metadata_props[:]
        noted.doc_string = ""
    return model


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """The exporter reports packages that this model does not use, and its own deprecations."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)


def pass_gate(bundle: Bundle) -> Gate:
    """The figures of a bundle that may drive.

    Raises:
        ArtifactError: a number is not finite, the spectral radius is too large, or the encoder
            answers its self-test otherwise than where it was trained.
    """
    numbers = (bundle.A, bundle.B_uc, bundle.B_uw, bundle.c, bundle.selftest_psi)
    if not all(np.all(np.isfinite(array)) for array in numbers):
        raise ArtifactError(
            "export expects a model of finite numbers, found some that are not: the training "
            "diverged. Train again with a smaller --learning-rate."
        )
    if bundle.spectral_radius > LARGEST_SPECTRAL_RADIUS:
        raise ArtifactError(
            f"export expects a spectral radius of at most {LARGEST_SPECTRAL_RADIUS}, found "
            f"{bundle.spectral_radius:.4f}: over the horizon its predictions would grow without "
            f"bound. Train longer, or with a larger --weight-stability."
        )
    lifted = BundlePredictor(bundle).lift(bundle.selftest_x)
    parity = bundle.parity_error(lifted)
    if not parity < LARGEST_PARITY_ERROR:
        raise ArtifactError(
            f"export expects torch and ONNX to agree within {LARGEST_PARITY_ERROR:g} of the spread "
            f"of each observable, found a difference of {parity:.2e}. Check the versions of torch, "
            f"onnxscript and onnxruntime."
        )
    return Gate(bundle.spectral_radius, bundle.growth(20), bundle.growth(80), parity)


def _linear(layer: nn.Module) -> nn.Linear:
    if not isinstance(layer, nn.Linear):
        raise TypeError(f"expected a linear layer, found {type(layer).__name__}")
    return layer
