"""MDK-Net: an encoder and the matrices A and B, learned together.

Works on scaled numbers (`offline.scaling`); export folds the scaling in.
Paper: section II, eqs. (6)-(8), and the table of hyperparameters.
"""

from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn

from offline.config import TrainingConfig
from rt_controller.contract.signals import EXOGENOUS_FIELDS, ControlInput, VehicleState

N_STATES = len(VehicleState._fields)
N_INPUTS = len(ControlInput._fields) + len(EXOGENOUS_FIELDS)

# The paper leaves the spread of its Gaussian start open. These keep 80 steps of the roll-out
# bounded before the first update.
NOISE_AROUND_IDENTITY = 1e-3
SPREAD_OF_INPUT_MATRIX = 1e-2


class Operator(NamedTuple):
    """The linear part of the model."""

    A: Tensor
    """(n, n)"""
    B: Tensor
    """(n, 4), columns: throttle, brake, steering wheel, curvature"""


class MdkNet(nn.Module):
    """psi(x_(k+1)) = A psi(x_k) + B u_k, with psi(x) = [x; z(x)].

    With a constant observable the last entry of psi is 1, and so is its row of A: [0 ... 0 1],
    exactly and for ever, so the constant cannot drift over the horizon.
    """

    def __init__(self, config: TrainingConfig) -> None:
        super().__init__()
        self.has_constant = config.constant_observable
        self.n_observables = N_STATES + config.latents
        learned = config.latents - int(self.has_constant)
        rows = self.n_observables - int(self.has_constant)
        self.encoder = _multilayer_perceptron((N_STATES, *config.hidden, learned))
        n = self.n_observables
        if config.operator_prior == "identity":
            start = torch.eye(n)[:rows] + NOISE_AROUND_IDENTITY * torch.randn(rows, n)
        else:
            start = torch.randn(rows, n) / n
        self.A_rows = nn.Parameter(start)
        self.B_rows = nn.Parameter(SPREAD_OF_INPUT_MATRIX * torch.randn(rows, N_INPUTS))

    def operator(self) -> Operator:
        """The matrices of eq. (6)."""
        if not self.has_constant:
            return Operator(self.A_rows, self.B_rows)
        last_A = torch.zeros_like(self.A_rows[:1])
        last_A[0, -1] = 1.0
        last_B = torch.zeros_like(self.B_rows[:1])
        return Operator(torch.cat([self.A_rows, last_A]), torch.cat([self.B_rows, last_B]))

    def lift(self, x: Tensor) -> Tensor:
        """Observables (..., n) of scaled states x (..., 6). Paper: eq. (7)."""
        parts = [x, self.encoder(x)]
        if self.has_constant:
            parts.append(x.new_ones(*x.shape[:-1], 1))
        return torch.cat(parts, dim=-1)


def _multilayer_perceptron(widths: tuple[int, ...]) -> nn.Sequential:
    """ReLU after every hidden layer, none on the output; Gaussian weights, zero biases.

    The spread sqrt(2 / fan_in) keeps the size of the signal through ReLU layers (He et al., 2015).
    """
    layers: list[nn.Module] = []
    for fan_in, fan_out in pairwise(widths):
        linear = nn.Linear(fan_in, fan_out)
        nn.init.normal_(linear.weight, std=(2.0 / fan_in) ** 0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear, nn.ReLU()]
    return nn.Sequential(*layers[:-1])
