"""The trained model in physical units: scaling folded into the encoder and the operator."""

import copy

import numpy as np
import torch
from torch import Tensor, nn

from offline.data.signals import Scaling
from offline.model.network import Encoder, MdkNet, with_zero_row
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bilinear import Bilinear
from rt_controller.contract.model.drift import Drift
from rt_controller.contract.model.rollout import Matrices


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


class _ScaledLayers(nn.Module):
    """Own layers, from physical inputs (..., width) to latents (..., latents), or one more of 1."""

    def __init__(self, layers: nn.Module, centre: Tensor, spread: Tensor) -> None:
        super().__init__()
        self.layers, self.has_constant = layers, False
        self.input_centre: Tensor
        self.input_spread: Tensor
        self.register_buffer("input_centre", centre.float())
        self.register_buffer("input_spread", spread.float())

    def forward(self, inputs: Tensor) -> Tensor:
        latents: Tensor = self.layers((inputs - self.input_centre) / self.input_spread)
        return nn.functional.pad(latents, (0, 1), value=1.0) if self.has_constant else latents


class _FoldedEncoder(nn.Module):
    """One encoder, from physical signals to its latents."""

    def __init__(self, encoder: Encoder, centre: Tensor, spread: Tensor) -> None:
        super().__init__()
        self.encoder = copy.deepcopy(encoder).cpu()
        layers = self.encoder.layers
        if isinstance(layers, nn.Sequential):
            first = _linear(layers[0])
            weight = first.weight.data.double() / spread
            bias = first.bias.data.double() - weight @ centre
            first.weight.data, first.bias.data = weight.float(), bias.float()
        else:
            self.encoder.layers = _ScaledLayers(layers, centre, spread)
        self.centre: Tensor
        self.spread: Tensor
        present = encoder.present
        self.register_buffer("centre", centre[:present].float())
        self.register_buffer("spread", spread[:present].float())

    def add_constant(self) -> None:
        """One more latent, which is 1."""
        layers = self.encoder.layers
        if isinstance(layers, nn.Sequential):
            last = _linear(layers[-1])
            last.weight.data = with_zero_row(last.weight.data)
            last.bias.data = torch.cat([last.bias.data, torch.ones(1)])
        elif isinstance(layers, _ScaledLayers):
            layers.has_constant = True
        if self.encoder.products is not None:
            weights = self.encoder.products.weights
            weights.weight.data = with_zero_row(weights.weight.data)

    def forward(self, seen: Tensor) -> Tensor:
        inputs = seen[..., self.encoder.columns]
        # Products use scaled signals; folded, they would be differences of large numbers.
        present = (inputs[..., : self.encoder.present] - self.centre) / self.spread
        return self.encoder.latents(inputs, present)


def physical_matrices(model: MdkNet, scaling: Scaling) -> Matrices:
    """The trained matrices in physical units and double precision."""
    A, B = (_numbers(matrix) for matrix in model.operator())
    B_uc, B_uw = np.split(B, [model.sizes.inputs], axis=1)
    S, N = (_numbers(matrix) for matrix in model.gains())
    n, m, R = len(A), model.sizes.inputs, model.rank
    bilinear = drift = None
    if R:
        bilinear = Bilinear(
            N[:, : R * m].reshape(n, R, m).transpose(1, 0, 2),
            S[: R * m].reshape(R, m, n),
            np.zeros((R, m)),
            model.follows,
            model.saturates,
        )
    if model.drift_rank:
        drift = Drift(
            N[:, R * m :], S[R * m :], np.zeros(model.drift_rank), np.array(model.drift_signal)
        )
    return scaling.to_physical(Matrices(A, B_uc, B_uw, np.zeros(len(A)), bilinear, drift))


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


def _linear(layer: nn.Module) -> nn.Linear:
    if not isinstance(layer, nn.Linear):
        raise TypeError(f"expected a linear layer, found {type(layer).__name__}")
    return layer
