"""The trained model in physical units: scaling folded into the encoder and the operator."""

import copy

import numpy as np
import torch
from torch import Tensor, nn

from offline.data.signals import Scaling
from offline.model.network import MdkNet, with_zero_row
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bilinear import Bilinear
from rt_controller.contract.model.rollout import Matrices


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


def physical_matrices(model: MdkNet, scaling: Scaling) -> Matrices:
    """The trained matrices in physical units and double precision."""
    A, B = (_numbers(matrix) for matrix in model.operator())
    B_uc, B_uw = np.split(B, [model.sizes.inputs], axis=1)
    bilinear = None
    if model.rank:
        N, S = _numbers(model.bilinear_columns()), _numbers(model.S)
        bilinear = Bilinear(N, S, np.zeros(S.shape[:2]), model.follows)
    return scaling.to_physical(Matrices(A, B_uc, B_uw, np.zeros(len(A)), bilinear))


def _scaling_of_inputs(model: MdkNet, scaling: Scaling) -> tuple[Array, Array]:
    """Centre and scale of every encoder input, in the order of `MdkNet.encoder_input`."""
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
