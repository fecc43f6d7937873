"""The trained model in physical units: scaling folded into the encoder and the operator."""

import copy
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from offline.data.signals import Scaling
from offline.model.network import MdkNet, with_zero_row
from rt_controller.contract.arrays import Array
from rt_controller.contract.artifact import Bilinear


class PhysicalEncoder(nn.Module):
    """The trained encoder, from physical signals to [x; z].

    The scaling is folded into the first layer, in float64. A constant observable becomes an output
    with zero weights and bias 1. x is passed through unchanged.
    """

    def __init__(self, model: MdkNet, scaling: Scaling) -> None:
        super().__init__()
        self.encoder = copy.deepcopy(model.encoder)
        present = self.encoder.present
        of_inputs = _scaling_of_inputs(model, scaling)
        centre, spread = (torch.from_numpy(numbers) for numbers in of_inputs)
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
        inputs = torch.cat([x, *(signal.flatten(1) for signal in more)], dim=-1)
        # Products use scaled signals; folded, they would be differences of large numbers.
        present = (inputs[..., : self.encoder.present] - self.centre) / self.spread
        return torch.cat([x, self.encoder.latents(inputs, present)], dim=-1)


class PhysicalOperator(NamedTuple):
    """psi+ = A psi + B [u; w] + c, and the bilinear part of B, in physical units."""

    A: Array
    B: Array
    c: Array
    bilinear: Bilinear | None


def fold_scaling(model: MdkNet, scaling: Scaling) -> PhysicalOperator:
    """The model's operator for psi = [x physical; z].

    With psi_n = (psi - t) / s of the scaled model, psi+ = S A S^-1 psi + S B U^-1 u + (I - S A
    S^-1) t, where s and t scale and centre the physical states and leave the latents unchanged.
    The gains S_ri psi_n become (S_ri / s) psi - (S_ri / s) t.
    """
    scaled = model.operator()
    A, B = scaled.A.detach().double().cpu().numpy(), scaled.B.detach().double().cpu().numpy()
    n, states = A.shape[0], model.sizes.states
    s, t = np.ones(n), np.zeros(n)
    s[:states], t[:states] = scaling.x_scale, scaling.x_centre
    columns = np.concatenate([scaling.u_scale, scaling.w_scale])
    A_physical = A * s[:, None] / s[None, :]
    B_physical = B * s[:, None] / columns[None, :]
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


def _scaling_of_inputs(model: MdkNet, scaling: Scaling) -> tuple[Array, Array]:
    """Centre and scale of every encoder input, in the order of `MdkNet.encoder_input`."""
    centre, spread = [scaling.x_centre], [scaling.x_scale]
    if model.reads_exogenous:
        centre.append(np.zeros_like(scaling.w_scale))
        spread.append(scaling.w_scale)
    centre += [scaling.past_centre] * model.history_steps
    spread += [scaling.past_scale] * model.history_steps
    return np.concatenate(centre), np.concatenate(spread)


def _linear(layer: nn.Module) -> nn.Linear:
    if not isinstance(layer, nn.Linear):
        raise TypeError(f"expected a linear layer, found {type(layer).__name__}")
    return layer
