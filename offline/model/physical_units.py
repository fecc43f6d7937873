"""The trained model in physical units, for a bundle: scaling folded in, encoders as ONNX."""

import copy
import logging
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from offline.data.dataset import Dataset
from offline.data.signals import Scaling, last_rows
from offline.model.encoder import Encoder
from offline.model.network import MdkNet, with_zero_row
from rt_controller.contract.arrays import Array
from rt_controller.model.dynamics import Gains, Matrices
from rt_controller.model.lift import Lift, LiftSample
from rt_controller.model.path_kinematics import Movement


class PhysicalEncoder(nn.Module):
    """The trained encoders, from physical signals to [x; z].

    The scaling is folded into the first layer of each perceptron, in float64, and prepended to
    other modules. A constant observable becomes an output with zero weights and bias 1 of the last
    encoder. x is passed through unchanged.
    """

    def __init__(self, model: MdkNet, scaling: Scaling) -> None:
        super().__init__()
        centre, spread = (torch.from_numpy(numbers) for numbers in scaling_of_lift(model, scaling))
        folded = []
        for encoder in model.encoders:
            assert isinstance(encoder, Encoder)
            columns = encoder.columns.cpu()
            folded.append(_FoldedEncoder(encoder, centre[columns], spread[columns]))
        if model.has_constant:
            folded[-1].add_constant()
        self.encoders = nn.ModuleList(folded)

    def forward(self, x: Tensor, *more: Tensor) -> Tensor:
        seen = torch.cat([x, *(signal.flatten(1) for signal in more)], dim=-1)
        return torch.cat([x, *(encoder(seen) for encoder in self.encoders)], dim=-1)


class _FoldedEncoder(nn.Module):
    """One encoder, from physical signals to its latents, or one more of 1."""

    def __init__(self, encoder: Encoder, centre: Tensor, spread: Tensor) -> None:
        super().__init__()
        self.encoder = copy.deepcopy(encoder).cpu()
        self.is_perceptron, self.pads_constant = isinstance(encoder.layers, nn.Sequential), False
        # Products use scaled signals; folded, they would be differences of large numbers. The
        # names of the buffers tell a training that begins with the bundle which encoder it has.
        self.centre: Tensor
        self.spread: Tensor
        self.own_centre: Tensor
        self.own_spread: Tensor
        prefix, scaled = ("", encoder.present) if self.is_perceptron else ("own_", len(centre))
        self.register_buffer(f"{prefix}centre", centre[:scaled].float())
        self.register_buffer(f"{prefix}spread", spread[:scaled].float())
        if self.is_perceptron:
            first = _linear(self.encoder.layers, 0)
            weight = first.weight.data.double() / spread
            bias = first.bias.data.double() - weight @ centre
            first.weight.data, first.bias.data = weight.float(), bias.float()

    def add_constant(self) -> None:
        """One more latent, which is 1."""
        if not self.is_perceptron:
            self.pads_constant = True
            return
        last = _linear(self.encoder.layers, -1)
        last.weight.data = with_zero_row(last.weight.data)
        last.bias.data = torch.cat([last.bias.data, torch.ones(1)])
        if self.encoder.is_symmetric:
            self.encoder.latent_signs = torch.cat([self.encoder.latent_signs, torch.ones(1)])
        if self.encoder.products is not None:
            weights = self.encoder.products.weights
            weights.weight.data = with_zero_row(weights.weight.data)

    def forward(self, seen: Tensor) -> Tensor:
        inputs = seen.index_select(-1, self.encoder.columns)
        present = self.encoder.present
        if self.is_perceptron:
            factors = (inputs[..., :present] - self.centre) / self.spread
            return self.encoder.latents(inputs, factors)
        scaled = (inputs - self.own_centre) / self.own_spread
        latents = self.encoder.latents(scaled, scaled[..., :present])
        return nn.functional.pad(latents, (0, 1), value=1.0) if self.pads_constant else latents


def physical_matrices(model: MdkNet, scaling: Scaling) -> Matrices:
    """The trained matrices in physical units and double precision."""
    A, B = (_numbers(matrix) for matrix in model.operator())
    B_uc, B_uw = np.split(B, [model.sizes.inputs], axis=1)
    S, N = (_numbers(matrix) for matrix in model.gains())
    factor, shape = model.factor_columns.cpu().numpy(), model.shape.cpu().numpy()
    gains = Gains(N, S, np.zeros(len(S)), factor, shape, model.follows) if len(S) else None
    movement = None
    if model.path is not None:
        movement = Movement(*map(_numbers, model.path.movement()))
    return scaling.to_physical(Matrices(A, B_uc, B_uw, np.zeros(len(A)), gains, movement))


def scaling_of_lift(model: MdkNet, scaling: Scaling) -> tuple[Array, Array]:
    """Centre and scale of all signals that the lift sees, in the order of `MdkNet.seen`."""
    centre, spread = [scaling.x_centre], [scaling.x_scale]
    if model.reads_exogenous:
        centre.append(np.zeros_like(scaling.w_scale))
        spread.append(scaling.w_scale)
    centre += [scaling.past_centre] * model.history_steps
    spread += [scaling.past_scale] * model.history_steps
    return np.concatenate(centre), np.concatenate(spread)


def _numbers(tensor: Tensor) -> Array:
    return np.asarray(tensor.detach().double().cpu().numpy())


def _linear(layers: nn.Module, index: int) -> nn.Linear:
    assert isinstance(layers, nn.Sequential)
    layer = layers[index]
    assert isinstance(layer, nn.Linear)
    return layer


SELFTEST_STATES = 32


def choose_selftest(dataset: Dataset, lift: Lift) -> LiftSample:
    """Encoder inputs at 32 instants spread evenly over the test part."""
    test = dataset.select("test")
    rows = np.linspace(0, len(test.episode) - 1, SELFTEST_STATES).astype(int)
    chosen = test.take(rows)
    history = last_rows(chosen.past, lift.history_steps)[..., : len(lift.history_fields)]
    return LiftSample(
        chosen.x[:, 0].astype(np.float64),
        chosen.w[:, 0].astype(np.float64),
        history.astype(np.float64),
    )


def to_onnx(encoder: nn.Module, lift: Lift, sample: LiftSample) -> bytes:
    """The encoder as ONNX: the inputs of `lift` -> "psi" (batch, n), float32, any batch size."""
    example = tuple(tensor[:2] for tensor in tensors_of(sample, lift))
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


def tensors_of(sample: LiftSample, lift: Lift) -> list[torch.Tensor]:
    """The encoder's inputs in float32, in the order of `lift.inputs`."""
    return [torch.from_numpy(getattr(sample, name).astype(np.float32)) for name in lift.inputs]


def _without_traces(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model without the exporter's metadata: stack traces with paths of this machine."""
    graph = model.graph
    values = (*graph.value_info, *graph.initializer, *graph.input, *graph.output)
    for part in (model, graph, *graph.node, *values):
        del part.metadata_props[:]
        part.doc_string = ""
    return model


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """Suppress the exporter's messages on unused packages and its own deprecations."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
