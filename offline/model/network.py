"""MDK-Net: an encoder and the matrices A and B, learned together.

All signals are scaled (`offline.data.signals`). Paper: section II, eqs. (6)-(8), and the table of
hyperparameters. Beyond the paper, the path may follow from the motion by kinematics, the encoder
may also read exogenous signals and the history and add a layer of products, one observable may be
constant, B may depend on the lifted state, and gains and drift may saturate.

The motion of a car on a plane does not depend on the road that is drawn on it: speeds and yaw rate
follow from themselves and the inputs. So psi = [x; latents of the motion; 1], the motion depends on
the motion alone, and progress, lateral and heading error follow from it by kinematics
(`offline.model.path`). Signals without a path have one block of all observables.

Of a car whose left and right side are alike each observable, and the function of each gain, is even
or odd in a mirror image, and only products that are even have an effect on an even observable, odd
ones on an odd one: A consists of two blocks, and the model drives to the left as to the right.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from offline.config import TrainingConfig
from offline.data.sampling import Instants
from offline.model.encoder import Encoder, MakeEncoder
from offline.model.observables import Observables, Sizes, alternating, observables_of, signs_of
from offline.model.path import Path, Units
from offline.model.rollout import roll_out
from rt_controller.contract.signals import PATH_STATES
from rt_controller.model.dynamics import Shape
from rt_controller.model.follow import Follow

# Standard deviations of the Gaussian start, which the paper leaves open. With these, roll-outs of
# 80 steps are bounded before the first update.
OPERATOR_NOISE = 1e-3
INPUT_MATRIX_SPREAD = 1e-2
GAIN_SPREAD = 0.1

FADING_S = (0.05, 5.0)
"""range of the initial time constants of the latents, from tyre to engine dynamics"""
FADING_LAST_LAYER_SHARE = 0.1
"""of the usual spread, for the last layer of the encoder if the latents fade at the start"""


class Operator(NamedTuple):
    """The linear part of the model."""

    A: Tensor
    """(n, n)"""
    B: Tensor
    """(n, m + p), columns: inputs, then exogenous signals"""


class GainMatrices(NamedTuple):
    """Those of the q gains (`rt_controller.model.dynamics.Gains`)."""

    S: Tensor
    """(q, n)"""
    N: Tensor
    """(n, q)"""


class Term(NamedTuple):
    """Gains of one kind; a variant of the model is another list of these (`terms_of`)."""

    shape: Shape
    factors: tuple[int, ...]
    """columns of [u; w; 1], one for each gain"""


class MdkNet(nn.Module):
    """psi(x_(k+1)) = A psi(x_k) + B u_k, with psi(x) = [x; z(x)].

    With a constant observable the last entry of psi is 1 and the last row of A is [0 ... 0 1];
    neither is trained.

    To it come the gains N g(S psi) f of `rt_controller.model.dynamics.Gains`, with the terms of
    `terms_of`. Over a roll-out, the psi of a gain is the predicted lifted state of each step, the
    free response of psi_0, or psi_0 (`config.bilinear_follows`).
    """

    def __init__(
        self,
        config: TrainingConfig,
        sizes: Sizes,
        signal_range: Tensor | None = None,
        encoder: MakeEncoder | None = None,
        units: Units | None = None,
    ) -> None:
        """`signal_range` (2, m + p): lowest and highest inputs and exogenous signals; None: ±1.

        `units` of the scaled states and of the curvature; None: not scaled. `encoder` makes the
        module of each encoder; None: multilayer perceptrons.
        """
        super().__init__()
        self.sizes = sizes
        if signal_range is None:
            ones = torch.ones(sizes.inputs + sizes.exogenous)
            signal_range = torch.stack([-ones, ones])
        self.signal_range: Tensor
        self.register_buffer("signal_range", signal_range)
        self.observables = observables_of(config, sizes)
        self.has_constant = config.constant_observable
        has_path = self.observables.has_path
        self._signs = signs_of(config, sizes)
        self.is_symmetric = self._signs is not None and sizes.is_symmetric
        self.path = None
        if has_path:
            self.path = Path(self.observables, sizes.dt_s, units, self.is_symmetric)
        # The motion does not depend on the road, whose curvature is the first exogenous signal.
        self.reads_exogenous = config.lift_exogenous and sizes.exogenous > int(has_path)
        self.history_steps = config.history_steps if sizes.remembered else 0
        self.follows = config.bilinear_follows if config.bilinear_rank else Follow.PREDICTION
        self.saturates = config.saturating_gains
        self.terms = terms_of(config, sizes)
        self.encoders = nn.ModuleList([self._encoder(config, encoder)])
        self._add_operator(config)

    @property
    def n_observables(self) -> int:
        return self.observables.n

    def operator(self) -> Operator:
        """The matrices of eq. (6)."""
        A = self.A_rows * self.A_learned
        B = self.B_rows * self.B_learned
        if not self.has_constant:
            return Operator(A, B)
        last_A = torch.zeros_like(A[:1])
        last_A[0, -1] = 1.0
        return Operator(torch.cat([A, last_A]), with_zero_row(B))

    def gains(self) -> GainMatrices:
        """S and N."""
        N = self.N_rows * self.N_learned
        return GainMatrices(self.S * self.S_learned, with_zero_row(N) if self.has_constant else N)

    def seen(self, instants: Instants) -> Tensor:
        """The signals (..., s) that the lift sees: x, then w and the history if configured."""
        parts = [instants.x]
        if self.reads_exogenous:
            parts.append(instants.w)
        if self.history_steps:
            parts.append(instants.past.flatten(-2))
        return torch.cat(parts, dim=-1)

    def lift(self, instants: Instants) -> Tensor:
        """Observables (..., n). Paper: eq. (7)."""
        seen = self.seen(instants)
        parts = [instants.x, *(encoder(seen) for encoder in self.encoders)]
        if self.has_constant:
            parts.append(instants.x.new_ones(*instants.x.shape[:-1], 1))
        return torch.cat(parts, dim=-1)

    def roll_out(self, psi0: Tensor, u: Tensor, w: Tensor) -> Tensor:
        """Lifted states (K, batch, n) after 1..K steps from psi0 (batch, n).

        u is (K, batch, m) and w (K, batch, p). Paper: the predicted term of eq. (10).
        """
        psi = self._roll_out(psi0, u, w)
        return psi if self.path is None else self.path(psi0, psi, w)

    def _roll_out(self, psi0: Tensor, u: Tensor, w: Tensor) -> Tensor:
        """Lifted states, the path states zero where they follow from the motion."""
        A, B = self.operator()
        if self.follows is Follow.PREDICTION and len(self.S):
            S, N = self.gains()
            forcing = torch.cat([u, w], dim=-1) @ B.t()
            # tanh(a) - a: its linear part belongs to the operator of the recursion.
            linear = sum(len(t.factors) for t in self.terms if t.shape is not Shape.SATURATION)
            A = A - N[:, linear:] @ S[linear:]
            return roll_out(psi0, A, forcing, (S, N, self.factors(u, w)), self.saturates)
        psi = psi0[None]
        if self.follows is Follow.FREE_RESPONSE:
            exogenous = w @ B[:, self.sizes.inputs :].t()
            psi = torch.cat([psi, roll_out(psi0, A, exogenous)[:-1]])
        return roll_out(psi0, A, self.forcing(psi, u, w))

    def forcing(self, psi: Tensor, u: Tensor, w: Tensor) -> Tensor:
        """What one step adds to A psi: (times, batch, n).

        u is (times, batch, m), w (times, batch, p); psi, which gains and saturation are computed
        from, (times, batch, n), or (1, batch, n) for all times.
        """
        _, B = self.operator()
        forcing = torch.cat([u, w], dim=-1) @ B.t()
        if not len(self.S):
            return forcing
        S, N = self.gains()
        shares = psi @ S.t()
        terms = (torch.tanh(shares) if self.saturates else shares) * self.factors(u, w)
        return forcing + (terms - shares * self.is_saturation) @ N.t()

    def factors(self, u: Tensor, w: Tensor) -> Tensor:
        """What each gain is multiplied by (..., q): inputs u (..., m), signals of w (..., p), 1."""
        signals = torch.cat([u, w, u.new_ones(*u.shape[:-1], 1)], dim=-1)
        return signals[..., self.factor_columns]

    def driven_matrices(self, signals: Tensor, slopes: Tensor) -> Tensor:
        """J (c, n, n): what a difference of lifted states is multiplied by in each step.

        Under constant inputs and exogenous signals (c, m + p), with the slopes (c, q) of the gains:
        1 not saturated, 0 saturated.
        """
        A, (S, N) = self.operator().A, self.gains()
        if not self.saturates:
            slopes = torch.ones_like(slopes)
        m = self.sizes.inputs
        weights = self.factors(signals[:, :m], signals[:, m:]) * slopes - self.is_saturation
        return A + (N * weights[:, None]) @ S

    def _encoder(self, config: TrainingConfig, make: MakeEncoder | None) -> Encoder:
        """That of the motion, or of all states."""
        sizes = self.sizes
        now = [*range(sizes.states)]
        if self.path is not None:
            del now[PATH_STATES]
        road = 1 if self.path is not None else 0
        if self.reads_exogenous:
            now += range(sizes.states + road, sizes.states + sizes.exogenous)
        first = sizes.states + (sizes.exogenous if self.reads_exogenous else 0)
        history = range(first, first + self.history_steps * sizes.remembered)
        known, signs = self.observables, None
        if self._signs is not None:
            of_seen = torch.tensor(
                [
                    *self._signs.states,
                    *self._signs.exogenous * self.reads_exogenous,
                    *self._signs.remembered * self.history_steps,
                ]
            )
            latents = slice(known.states, known.states + known.latents)
            signs = of_seen[[*now, *history]], known.signs[latents]
        return Encoder(
            [*now, *history],
            len(now),
            config.hidden,
            known.latents,
            activation=nn.ReLU if config.activation == "relu" else nn.SiLU,
            last_layer_share=(FADING_LAST_LAYER_SHARE if config.latents_start == "fading" else 1.0),
            has_products=config.products,
            make=make,
            signs=signs,
        )

    def _add_operator(self, config: TrainingConfig) -> None:
        """Parameters of A, B, N and S, and which of their entries are learned."""
        known, sizes = self.observables, self.sizes
        rows, is_motion = known.n - int(self.has_constant), known.is_motion
        self.A_learned: Tensor
        self.B_learned: Tensor
        self.N_learned: Tensor
        self.S_learned: Tensor
        can_change = is_motion[:rows, None]
        signs, factor_signs = self._mask_signs()
        row_signs = signs[:rows, None]
        self._add_mask("A_learned", can_change & is_motion & (row_signs == signs))
        self.A_rows = nn.Parameter(_first_operator(config, sizes, known)[:rows])
        columns = sizes.inputs + sizes.exogenous
        acts = torch.ones(columns, dtype=torch.bool)
        if known.has_path:
            acts[sizes.inputs] = False
        self._add_mask("B_learned", can_change & acts & (row_signs == factor_signs[:-1]))
        self.B_rows = nn.Parameter(INPUT_MATRIX_SPREAD * torch.randn(rows, columns))
        self._add_gains(rows)

    def _mask_signs(self) -> tuple[Tensor, Tensor]:
        """Of the observables and of [u; w; 1], for what parity allows; all +1: everything."""
        sizes = self.sizes
        if self._signs is None or not self.is_symmetric:
            return torch.ones(self.n_observables), torch.ones(sizes.inputs + sizes.exogenous + 1)
        return self.observables.signs, torch.tensor(
            [*self._signs.inputs, *self._signs.exogenous, 1.0]
        )

    def _add_gains(self, rows: int) -> None:
        known = self.observables
        of_gain = [term for term in self.terms for _ in term.factors]
        q = len(of_gain)
        self.factor_columns: Tensor
        self.shape: Tensor
        self.is_saturation: Tensor
        columns = torch.tensor([c for term in self.terms for c in term.factors], dtype=torch.long)
        self.register_buffer("factor_columns", columns, False)
        shape = torch.tensor([int(term.shape) for term in of_gain], dtype=torch.long)
        self.register_buffer("shape", shape, False)
        self._add_mask("is_saturation", shape == Shape.SATURATION)
        # Even and odd functions in turn, of each factor.
        signs = torch.ones(q)
        if self.is_symmetric:
            for factor in torch.unique(columns):
                signs[columns == factor] = alternating(int((columns == factor).sum()))
        observed, factor_signs = self._mask_signs()
        learned = observed[:rows, None] == signs * factor_signs[columns]
        self._add_mask("N_learned", known.is_motion[:rows, None] & learned)
        self._add_mask("S_learned", known.is_motion & (signs[:, None] == observed))
        self.N_rows = nn.Parameter(INPUT_MATRIX_SPREAD * torch.randn(rows, q))
        self.S = nn.Parameter(GAIN_SPREAD * torch.randn(q, known.n))

    def _add_mask(self, name: str, learned: Tensor) -> None:
        self.register_buffer(name, learned.to(torch.get_default_dtype()), persistent=False)


def terms_of(config: TrainingConfig, sizes: Sizes) -> tuple[Term, ...]:
    """The terms that are not linear, as `Shape` orders them.

    Each input acts through gains; where they saturate, the motion without inputs does too.
    """
    inputs, one = tuple(range(sizes.inputs)), sizes.inputs + sizes.exogenous
    if not config.saturating_gains:
        return (Term(Shape.LINEAR, inputs * config.bilinear_rank),)
    return (
        Term(Shape.TANH, inputs * config.bilinear_rank),
        Term(Shape.SATURATION, (one,) * config.drift_rank),
    )


def with_zero_row(matrix: Tensor, dim: int = 0) -> Tensor:
    """The matrix with one more row of zeros, or with zeros appended along `dim`."""
    return torch.cat([matrix, torch.zeros_like(matrix.narrow(dim, 0, 1))], dim=dim)


def _first_operator(config: TrainingConfig, sizes: Sizes, known: Observables) -> Tensor:
    n = known.n
    if config.operator_prior == "zero":
        return torch.randn(n, n) / n
    start = torch.eye(n)
    if config.latents_start == "fading":
        low, high = torch.log(torch.tensor(FADING_S))
        fading_s = torch.exp(torch.linspace(float(low), float(high), known.latents))
        latents = slice(sizes.states, sizes.states + known.latents)
        start[latents, latents] = torch.diag(torch.exp(-sizes.dt_s / fading_s))
    return start + OPERATOR_NOISE * torch.randn(n, n)
