"""MDK-Net: an encoder and the matrices A and B, learned together.

All signals are scaled (`offline.data.signals`). Paper: section II, eqs. (6)-(8), and the table of
hyperparameters. Beyond the paper, the encoder may also read exogenous signals and the history and
add a layer of products, one observable may be constant, and B may depend on the lifted state.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn

from offline.config import TrainingConfig
from offline.data.sampling import Instants
from offline.data.signals import Roles, past_columns
from offline.model.rollout import roll_out, roll_out_bilinear
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.schema import Schema

# Standard deviations of the Gaussian start, which the paper leaves open. With these, roll-outs of
# 80 steps are bounded before the first update.
OPERATOR_NOISE = 1e-3
INPUT_MATRIX_SPREAD = 1e-2
GAIN_SPREAD = 0.1

FADING_S = (0.05, 5.0)
"""range of the initial time constants of the latents, from tyre to engine dynamics"""
FADING_LAST_LAYER_SHARE = 0.1
"""of the usual spread, for the last layer of the encoder if the latents fade at the start"""


@dataclass(frozen=True, slots=True)
class Sizes:
    """Number of signals of each kind, and the sampling period."""

    states: int
    inputs: int
    exogenous: int
    remembered: int
    """signals in one row of the history"""
    dt_s: float


def sizes_of(schema: Schema, roles: Roles) -> Sizes:
    """The sizes of a model of these signals."""
    states, inputs = past_columns(schema, roles)
    return Sizes(
        len(schema.states),
        len(schema.inputs),
        len(schema.exogenous),
        len(states) + len(inputs),
        schema.dt_s,
    )


class Operator(NamedTuple):
    """The linear part of the model."""

    A: Tensor
    """(n, n)"""
    B: Tensor
    """(n, m + p), columns: inputs, then exogenous signals"""


class Products(nn.Module):
    """A linear layer of the products of every two signals, squares included.

    Kinematics consists of such products (speed times heading error, yaw rate or curvature), which
    a multilayer perceptron can only approximate.
    """

    def __init__(self, signals: int, latents: int) -> None:
        super().__init__()
        first, second = torch.triu_indices(signals, signals)
        self.first: Tensor
        self.second: Tensor
        self.register_buffer("first", first, persistent=False)
        self.register_buffer("second", second, persistent=False)
        self.weights = nn.Linear(len(first), latents, bias=False)
        nn.init.zeros_(self.weights.weight)

    def forward(self, signals: Tensor) -> Tensor:
        """Latents (..., latents) of signals (..., signals)."""
        latents: Tensor = self.weights(signals[..., self.first] * signals[..., self.second])
        return latents


class Encoder(nn.Module):
    """Latents of the encoder's input: a multilayer perceptron, plus products if asked for.

    Paper: phi_theta of eq. (7).
    """

    def __init__(
        self,
        inputs: int,
        present: int,
        hidden: tuple[int, ...],
        latents: int,
        *,
        activation: type[nn.Module],
        last_layer_share: float,
        has_products: bool,
    ) -> None:
        """Only the first `present` inputs, those of the current instant, enter the products."""
        super().__init__()
        self.present = present
        self.layers = _perceptron((inputs, *hidden, latents), activation, last_layer_share)
        self.products = Products(present, latents) if has_products else None

    def forward(self, inputs: Tensor) -> Tensor:
        """Latents (..., latents) of scaled inputs (..., inputs)."""
        return self.latents(inputs, inputs[..., : self.present])

    def latents(self, inputs: Tensor, factors: Tensor) -> Tensor:
        """Latents if the factors (..., present) of the products are scaled unlike the inputs."""
        latents: Tensor = self.layers(inputs)
        return latents if self.products is None else latents + self.products(factors)


class MdkNet(nn.Module):
    """psi(x_(k+1)) = A psi(x_k) + B u_k, with psi(x) = [x; z(x)].

    With a constant observable the last entry of psi is 1 and the last row of A is [0 ... 0 1];
    neither is trained.

    With a bilinear rank R the column of input i is B_i + sum_r N_ri (S_ri psi). Over a roll-out,
    this psi is the predicted lifted state of each step, the free response of psi_0, or psi_0
    (`config.bilinear_follows`).
    """

    def __init__(self, config: TrainingConfig, sizes: Sizes) -> None:
        super().__init__()
        self.sizes = sizes
        self.has_constant = config.constant_observable
        self.reads_exogenous = config.lift_exogenous
        self.history_steps = config.history_steps if sizes.remembered else 0
        self.rank = config.bilinear_rank
        self.follows = config.bilinear_follows
        self.n_observables = sizes.states + config.latents
        learned = config.latents - int(self.has_constant)
        rows = self.n_observables - int(self.has_constant)
        present = sizes.states + (sizes.exogenous if self.reads_exogenous else 0)
        self.encoder = Encoder(
            present + self.history_steps * sizes.remembered,
            present,
            config.hidden,
            learned,
            activation=nn.ReLU if config.activation == "relu" else nn.SiLU,
            last_layer_share=FADING_LAST_LAYER_SHARE if config.latents_start == "fading" else 1.0,
            has_products=config.products,
        )
        start = _first_operator(config, sizes, self.n_observables, learned)[:rows]
        self.A_rows = nn.Parameter(start)
        columns = sizes.inputs + sizes.exogenous
        self.B_rows = nn.Parameter(INPUT_MATRIX_SPREAD * torch.randn(rows, columns))
        if self.rank:
            self.N_rows = nn.Parameter(
                INPUT_MATRIX_SPREAD * torch.randn(self.rank, rows, sizes.inputs)
            )
            self.S = nn.Parameter(
                GAIN_SPREAD * torch.randn(self.rank, sizes.inputs, self.n_observables)
            )

    def operator(self) -> Operator:
        """The matrices of eq. (6)."""
        if not self.has_constant:
            return Operator(self.A_rows, self.B_rows)
        last_A = torch.zeros_like(self.A_rows[:1])
        last_A[0, -1] = 1.0
        return Operator(torch.cat([self.A_rows, last_A]), with_zero_row(self.B_rows))

    def bilinear_columns(self) -> Tensor:
        """N (R, n, m)."""
        return with_zero_row(self.N_rows, dim=1) if self.has_constant else self.N_rows

    def encoder_input(self, instants: Instants) -> Tensor:
        """The numbers (..., s) that the encoder reads: x, then w and the history if configured."""
        parts = [instants.x]
        if self.reads_exogenous:
            parts.append(instants.w)
        if self.history_steps:
            parts.append(instants.past.flatten(-2))
        return torch.cat(parts, dim=-1)

    def lift(self, instants: Instants) -> Tensor:
        """Observables (..., n). Paper: eq. (7)."""
        parts = [instants.x, self.encoder(self.encoder_input(instants))]
        if self.has_constant:
            parts.append(instants.x.new_ones(*instants.x.shape[:-1], 1))
        return torch.cat(parts, dim=-1)

    def roll_out(self, psi0: Tensor, u: Tensor, w: Tensor) -> Tensor:
        """Lifted states (K, batch, n) after 1..K steps from psi0 (batch, n).

        u is (K, batch, m) and w (K, batch, p). Paper: the predicted term of eq. (10).
        """
        A, B = self.operator()
        if self.rank and self.follows is Follow.PREDICTION:
            return roll_out_bilinear(psi0, A, B, self.S, self.bilinear_columns(), u, w)
        psi = psi0[None]
        if self.rank and self.follows is Follow.FREE_RESPONSE:
            exogenous = w @ B[:, self.sizes.inputs :].t()
            psi = torch.cat([psi, roll_out(psi0, A, exogenous)[:-1]])
        return roll_out(psi0, A, self.forcing(psi, u, w))

    def forcing(self, psi: Tensor, u: Tensor, w: Tensor) -> Tensor:
        """B u_k, the effect of inputs and exogenous signals in one step: (times, batch, n).

        u is (times, batch, m), w (times, batch, p); psi, which the bilinear part is read from,
        (times, batch, n), or (1, batch, n) for all times.
        """
        _, B = self.operator()
        forcing = torch.cat([u, w], dim=-1) @ B.t()
        if not self.rank:
            return forcing
        gains = torch.einsum("rin,kbn->kbri", self.S, psi)
        scaled = (u[:, :, None] * gains).flatten(-2)
        columns = self.bilinear_columns().permute(0, 2, 1).flatten(0, 1)
        return forcing + scaled @ columns


def with_zero_row(matrix: Tensor, dim: int = 0) -> Tensor:
    """The matrix with one more row of zeros, or with zeros appended along `dim`."""
    return torch.cat([matrix, torch.zeros_like(matrix.narrow(dim, 0, 1))], dim=dim)


def _first_operator(config: TrainingConfig, sizes: Sizes, n: int, learned: int) -> Tensor:
    if config.operator_prior == "zero":
        return torch.randn(n, n) / n
    start = torch.eye(n)
    if config.latents_start == "fading":
        low, high = torch.log(torch.tensor(FADING_S))
        fading_s = torch.exp(torch.linspace(float(low), float(high), learned))
        latents = slice(sizes.states, sizes.states + learned)
        start[latents, latents] = torch.diag(torch.exp(-sizes.dt_s / fading_s))
    return start + OPERATOR_NOISE * torch.randn(n, n)


def _perceptron(
    widths: tuple[int, ...], activation: type[nn.Module], last_layer_share: float
) -> nn.Sequential:
    """Hidden layers with `activation`, a linear output; Gaussian weights, zero biases.

    The spread sqrt(2 / fan_in) keeps the size of the signal through ReLU layers (He et al., 2015);
    the last layer has `last_layer_share` of it.
    """
    layers: list[nn.Module] = []
    last = len(widths) - 2
    for i, (fan_in, fan_out) in enumerate(pairwise(widths)):
        linear = nn.Linear(fan_in, fan_out)
        share = last_layer_share if i == last else 1.0
        nn.init.normal_(linear.weight, std=share * (2.0 / fan_in) ** 0.5)
        nn.init.zeros_(linear.bias)
        layers.append(linear)
        if i < last:
            layers.append(activation())
    return nn.Sequential(*layers)
