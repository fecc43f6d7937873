"""MDK-Net: an encoder and the matrices A and B, learned together.

Works on scaled numbers (`offline.scaling`); export folds the scaling in.
Paper: section II, eqs. (6)-(8), and the table of hyperparameters. What the encoder is shown
beside the state, and the bilinear part of B, go beyond it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from offline.batch import Instants
from offline.config import TrainingConfig
from offline.encoder import Encoder
from offline.roles import Roles, past_columns
from offline.rollout import roll_out, roll_out_bilinear
from rt_controller.contract.follow import Follow
from rt_controller.contract.schema import Schema

# The paper leaves the spread of its Gaussian start open. These keep 80 steps of the roll-out
# bounded before the first update.
NOISE_AROUND_START = 1e-3
SPREAD_OF_INPUT_MATRIX = 1e-2
SPREAD_OF_GAINS = 0.1

FADING_S = (0.05, 5.0)
"""time constants that the latents start with, from a tyre's to an engine's"""

QUIET_SHARE = 0.1
"""of the usual spread, for the encoder's last layer where latents fade: what they say at first is
noise, and learning would begin with undoing it"""


@dataclass(frozen=True, slots=True)
class Sizes:
    """How many signals of each kind a model works on."""

    states: int
    inputs: int
    exogenous: int
    remembered: int
    """signals in one row of history"""
    dt_s: float


def sizes_of(schema: Schema, roles: Roles) -> Sizes:
    """The sizes of models of these signals."""
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


class MdkNet(nn.Module):
    """psi(x_(k+1)) = A psi(x_k) + B u_k, with psi(x) = [x; z(x)].

    With a constant observable the last entry of psi is 1, and so is its row of A: [0 ... 0 1],
    exactly and for ever, so the constant cannot drift over the horizon.

    With a bilinear rank R, B depends on the lifted state: column i of the inputs' part is
    B_i + sum_r N_ri (S_ri psi), the bilinear model with inputs' matrices sum_r N_ri S_ri. Over a
    roll-out psi is the lifted state of each step, or, for a model that is linear in all inputs to
    come, psi_0 or what psi_0 becomes without inputs.
    """

    def __init__(self, config: TrainingConfig, sizes: Sizes) -> None:
        super().__init__()
        self.sizes = sizes
        self.has_constant = config.constant_observable
        self.shows_exogenous = config.lift_exogenous
        # A data set may say that no signal is worth remembering.
        self.history_steps = config.history_steps if sizes.remembered else 0
        self.rank = config.bilinear_rank
        self.follows = config.bilinear_follows
        self.n_observables = sizes.states + config.latents
        learned = config.latents - int(self.has_constant)
        rows = self.n_observables - int(self.has_constant)
        present = sizes.states + (sizes.exogenous if self.shows_exogenous else 0)
        self.encoder = Encoder(
            present + self.history_steps * sizes.remembered,
            present,
            config.hidden,
            learned,
            activation=nn.ReLU if config.activation == "relu" else nn.SiLU,
            last_share=QUIET_SHARE if config.latents_start == "fading" else 1.0,
            has_products=config.products,
        )
        start = _first_operator(config, sizes, self.n_observables, learned)[:rows]
        self.A_rows = nn.Parameter(start)
        driven = sizes.inputs + sizes.exogenous
        self.B_rows = nn.Parameter(SPREAD_OF_INPUT_MATRIX * torch.randn(rows, driven))
        if self.rank:
            self.N_rows = nn.Parameter(
                SPREAD_OF_INPUT_MATRIX * torch.randn(self.rank, rows, sizes.inputs)
            )
            self.S = nn.Parameter(
                SPREAD_OF_GAINS * torch.randn(self.rank, sizes.inputs, self.n_observables)
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

    def show(self, instants: Instants) -> Tensor:
        """What the encoder sees (..., s) of the instants: x, and what else the lift needs."""
        parts = [instants.x]
        if self.shows_exogenous:
            parts.append(instants.w)
        if self.history_steps:
            parts.append(instants.past.flatten(-2))
        return torch.cat(parts, dim=-1)

    def lift(self, instants: Instants) -> Tensor:
        """Observables (..., n). Paper: eq. (7)."""
        parts = [instants.x, self.encoder(self.show(instants))]
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
            undriven = w @ B[:, self.sizes.inputs :].t()
            psi = torch.cat([psi, roll_out(psi0, A, undriven)[:-1]])
        return roll_out(psi0, A, self.drive(psi, u, w))

    def drive(self, psi: Tensor, u: Tensor, w: Tensor) -> Tensor:
        """What inputs add in one step from each psi, (times, batch, n).

        u is (times, batch, m) and w (times, batch, p), psi (times, batch, n), or (1, batch, n)
        for all times.
        """
        _, B = self.operator()
        driven = torch.cat([u, w], dim=-1) @ B.t()
        if not self.rank:
            return driven
        gains = torch.einsum("rin,kbn->kbri", self.S, psi)
        scaled = (u[:, :, None] * gains).flatten(-2)
        columns = self.bilinear_columns().permute(0, 2, 1).flatten(0, 1)
        return driven + scaled @ columns


def _first_operator(config: TrainingConfig, sizes: Sizes, n: int, learned: int) -> Tensor:
    if config.operator_prior == "zero":
        return torch.randn(n, n) / n
    start = torch.eye(n)
    if config.latents_start == "fading":
        low, high = torch.log(torch.tensor(FADING_S))
        fading_s = torch.exp(torch.linspace(float(low), float(high), learned))
        latents = slice(sizes.states, sizes.states + learned)
        start[latents, latents] = torch.diag(torch.exp(-sizes.dt_s / fading_s))
    return start + NOISE_AROUND_START * torch.randn(n, n)


def with_zero_row(matrix: Tensor, dim: int = 0) -> Tensor:
    """The matrix and one more row, or whatever lies along `dim`, of zeros."""
    return torch.cat([matrix, torch.zeros_like(matrix.narrow(dim, 0, 1))], dim=dim)
