"""From a checkpoint to a bundle that drives: scaling folded in, checked, weighed, written.

The run time knows physical units only. The encoder of the bundle takes physical x, and curvature
and history where the model looks at them, and returns [x, z], its first outputs being x itself
bit by bit; A, B and c act on that vector.
"""

import copy
import logging
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from offline.checkpoint import Checkpoint
from offline.config import TrainingConfig
from offline.dataset import Dataset
from offline.model import MdkNet, sizes_of, with_zero_row
from offline.predictor import BundlePredictor
from offline.provenance import describe_training
from offline.roles import past_names
from offline.scaling import Scaling
from rt_controller.contract.artifact import Bilinear, Bundle, Lift, LiftSample
from rt_controller.contract.errors import ArtifactError, DatasetError

Array = NDArray[np.float64]

LARGEST_BOUNDED_RADIUS = 1.0005
"""of a model whose eigenvalues were kept in the unit circle; the rest is rounding to float32"""
LARGEST_RADIUS = 1.05
"""of any other: a mode that doubles within the controller's horizon is no model of a car"""
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
    """The trained encoder, taking physical signals and returning [x; z], scaling built in.

    Into the first layer it is folded, in float64; a constant observable becomes an output whose
    weights are zero and whose bias is 1.
    """

    def __init__(self, model: MdkNet, scaling: Scaling) -> None:
        super().__init__()
        self.encoder = copy.deepcopy(model.encoder)
        present = self.encoder.present
        of_all = _of_shown_signals(model, scaling)
        centre, spread = (torch.from_numpy(numbers) for numbers in of_all)
        first = _linear(self.encoder.layers[0])
        weight = first.weight.data.double() / spread
        bias = first.bias.data.double() - weight @ centre
        first.weight.data, first.bias.data = weight.float(), bias.float()
        self.centre: Tensor
        self.spread: Tensor
        self.register_buffer("centre", centre[:present].float())
        self.register_buffer("spread", spread[:present].float())
        if model.has_constant:
            last = _linear(self.encoder.layers[-1])
            last.weight.data = with_zero_row(last.weight.data)
            last.bias.data = torch.cat([last.bias.data, torch.ones(1)])
            if self.encoder.products is not None:
                weights = self.encoder.products.weights
                weights.weight.data = with_zero_row(weights.weight.data)

    def forward(self, x: Tensor, *more: Tensor) -> Tensor:
        shown = torch.cat([x, *(signal.flatten(1) for signal in more)], dim=-1)
        # Products stay those of scaled signals: folded, they would be sums of large numbers.
        present = (shown[..., : self.encoder.present] - self.centre) / self.spread
        return torch.cat([x, self.encoder.latents(shown, present)], dim=-1)


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
    schema, scaling = dataset.schema, checkpoint.scaling
    model = MdkNet(checkpoint.config, sizes_of(schema, dataset.roles))
    model.load_state_dict(checkpoint.model)
    model.eval()
    encoder = PhysicalEncoder(model, scaling).eval()
    lift = _lift_of(model, dataset)
    operator = fold_scaling(model, scaling)
    selftest = choose_selftest(dataset, lift)
    shown = [torch.from_numpy(getattr(selftest, name).astype(np.float32)) for name in lift.inputs]
    with torch.no_grad():
        selftest_psi = encoder(*shown).double().numpy()
    selftest_psi[:, : model.sizes.states] = selftest.x
    inputs = model.sizes.inputs
    bundle = Bundle(
        name=_name_of(checkpoint.config),
        schema=schema,
        A=operator.A,
        B_uc=np.ascontiguousarray(operator.B[:, :inputs]),
        B_uw=np.ascontiguousarray(operator.B[:, inputs:]),
        c=operator.c,
        bilinear=operator.bilinear,
        lift=lift,
        encoder_onnx=to_onnx(encoder, lift, selftest),
        selftest=selftest,
        selftest_psi=selftest_psi,
        training=describe_training(
            {**checkpoint.config.model_dump(mode="json"), "step": checkpoint.step}, dataset.origin
        ),
        data_sha256=checkpoint.data_sha256,
    )
    return bundle, pass_gate(bundle, largest_radius_of(checkpoint.config))


def largest_radius_of(config: TrainingConfig) -> float:
    """Largest spectral radius that a model trained like this may leave with."""
    return LARGEST_BOUNDED_RADIUS if config.stability == "projection" else LARGEST_RADIUS


class PhysicalOperator(NamedTuple):
    """psi+ = A psi + B [u; w] + c and what the lifted state adds to B, in physical units."""

    A: Array
    B: Array
    c: Array
    bilinear: Bilinear | None


def fold_scaling(model: MdkNet, scaling: Scaling) -> PhysicalOperator:
    """The model's operator for psi = [x physical; z].

    With psi_n = (psi - t) / s of the scaled model, psi+ = S A S^-1 psi + S B U^-1 u + (I - S A
    S^-1) t, where s and t scale and centre the physical states and leave the latents alone. The
    gains S_ri psi_n become (S_ri / s) psi - (S_ri / s) t.
    """
    scaled = model.operator()
    A, B = scaled.A.detach().double().cpu().numpy(), scaled.B.detach().double().cpu().numpy()
    n, states = A.shape[0], model.sizes.states
    s, t = np.ones(n), np.zeros(n)
    s[:states], t[:states] = scaling.x_scale, scaling.x_centre
    driven = np.concatenate([scaling.u_scale, scaling.w_scale])
    A_physical = A * s[:, None] / s[None, :]
    B_physical = B * s[:, None] / driven[None, :]
    bilinear = None
    if model.rank:
        N = model.bilinear_columns().detach().double().cpu().numpy()
        S = model.S.detach().double().cpu().numpy() / s
        bilinear = Bilinear(
            N=N * s[None, :, None] / scaling.u_scale,
            S=S,
            s0=-S @ t,
            follows=model.follows,
        )
    return PhysicalOperator(A_physical, B_physical, t - A_physical @ t, bilinear)


def choose_selftest(dataset: Dataset, lift: Lift) -> LiftSample:
    """What the encoder may see at 32 instants spread evenly over the test part."""
    test = dataset.select("test")
    rows = np.linspace(0, len(test.episode) - 1, SELFTEST_STATES).astype(int)
    chosen = test.take(rows)
    history = chosen.past[:, chosen.past.shape[1] - lift.history_steps :]
    if not lift.sees_history:
        history = history[..., :0]
    return LiftSample(
        chosen.x[:, 0].astype(np.float64),
        chosen.w[:, 0].astype(np.float64),
        history.astype(np.float64),
    )


def to_onnx(encoder: nn.Module, lift: Lift, sample: LiftSample) -> bytes:
    """The encoder as ONNX: what `lift` names, float32 -> "psi" float32 (batch, n), any batch."""
    example = tuple(
        torch.from_numpy(getattr(sample, name)[:2].astype(np.float32)) for name in lift.inputs
    )
    batch = torch.export.Dim("batch")
    shapes: tuple[object, ...] = ({0: batch},)
    if len(example) > 1:
        shapes += (tuple({0: batch} for _ in example[1:]),)
    with tempfile.TemporaryDirectory() as folder, _quiet_exporter():
        path = Path(folder) / "encoder.onnx"
        torch.onnx.export(
            encoder,
            example,
            str(path),
            input_names=list(lift.inputs),
            output_names=["psi"],
            dynamic_shapes=shapes,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        serialised: bytes = _without_traces(onnx.load(path)).SerializeToString()
    return serialised


def _name_of(config: TrainingConfig) -> str:
    """Two networks that drive one after the other should not share a name in the logs."""
    is_default = config.preset == TrainingConfig().preset
    return "mdk-net" if is_default else f"mdk-net-{config.preset}"


def _lift_of(model: MdkNet, dataset: Dataset) -> Lift:
    shown = ["x"]
    if model.shows_exogenous:
        shown.append("w")
    if not model.history_steps:
        return Lift(tuple(shown))
    fields = past_names(dataset.schema, dataset.roles)
    return Lift((*shown, "history"), model.history_steps, fields)


def _of_shown_signals(model: MdkNet, scaling: Scaling) -> tuple[Array, Array]:
    """Centre and spread of every number the encoder sees, in the order of `MdkNet.show`."""
    centre, spread = [scaling.x_centre], [scaling.x_scale]
    if model.shows_exogenous:
        centre.append(np.zeros_like(scaling.w_scale))
        spread.append(scaling.w_scale)
    centre += [scaling.past_centre] * model.history_steps
    spread += [scaling.past_scale] * model.history_steps
    return np.concatenate(centre), np.concatenate(spread)


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


def pass_gate(bundle: Bundle, largest_radius: float = LARGEST_RADIUS) -> Gate:
    """The figures of a bundle that may drive.

    Raises:
        ArtifactError: a number is not finite, the spectral radius is too large, or the encoder
            answers its self-test otherwise than where it was trained.
    """
    numbers = [bundle.A, bundle.B_uc, bundle.B_uw, bundle.c, bundle.selftest_psi]
    if bundle.bilinear is not None:
        numbers += [bundle.bilinear.N, bundle.bilinear.S, bundle.bilinear.s0]
    if not all(np.all(np.isfinite(array)) for array in numbers):
        raise ArtifactError(
            "export expects a model of finite numbers, found some that are not: the training "
            "diverged. Train again with a smaller --learning-rate."
        )
    if bundle.spectral_radius > largest_radius:
        raise ArtifactError(
            f"export expects a spectral radius of at most {largest_radius}, found "
            f"{bundle.spectral_radius:.4f}: over the horizon its predictions would grow without "
            f"bound. Train with --stability projection, or longer; a rival that grows so is none "
            f"to drive with."
        )
    lifted = BundlePredictor(bundle).lift(bundle.selftest)
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
