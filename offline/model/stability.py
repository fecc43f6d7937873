"""Stability terms of the loss: eq. (11), and substitutes for it.

A model whose input matrix depends on the lifted state, or whose drift saturates, may grow under
inputs although no eigenvalue of A exceeds 1. A difference between two lifted states is multiplied
by J (`MdkNet.driven_matrices`) in each step.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.model.network import MdkNet

GROWTH_DOUBLINGS = 6
GROWTH_BOUND_OF_A = 1.035
"""slightly above the value for the chain yaw rate -> heading error -> lateral error: a Jordan
block at 1, whose powers grow although no eigenvalue exceeds 1"""

DRAWN = 8
"""matrices J in each training step"""
MOST_CORNERS = 256
"""of the box of signals, in an evaluation"""
SPREADING = 0x1E3779B97F4A7
"""an odd number, as in Fibonacci hashing; its multiples have all patterns of the lowest bits"""
LARGEST_STRETCH = 1.5
"""of the arguments of the gains at a lifted state: saturation beyond that of the data"""
GROWTH_BOUND = 1.025
"""of ||J^64||_F^(1/64), observables in units of their spread: a growth of 4.9 in 64 steps"""
RADIUS_DOUBLINGS = 10
LEAST_SPREAD = 1e-3
"""of an observable; one with less is constant"""


def stability_loss(model: MdkNet, A: Tensor, psi0: Tensor, config: TrainingConfig) -> Tensor:
    """Eq. (11) or its substitute."""
    if config.stability == "eigenvalue":
        return eigenvalue_excess(A)
    if config.stability == "gelfand":
        return growth_excess(A)
    return driven_excess(model, psi0)


def eigenvalue_excess(A: Tensor) -> Tensor:
    """Sum over the eigenvalues of the magnitude above 1. Paper: eq. (11), eq:sl loss.

    In float64. The gradient is unbounded where eigenvalues coincide, which they do at 1; the
    training skips steps whose gradient is not finite.
    """
    magnitudes = torch.linalg.eigvals(A.double()).abs()
    return torch.relu(magnitudes - 1.0).sum().to(A.dtype)


def growth_excess(A: Tensor, bound: float = GROWTH_BOUND_OF_A) -> Tensor:
    """||A^64||_F^(1/64) above its bound, of one matrix (n, n) or of several (..., n, n).

    A substitute for eq. (11): by Gelfand's formula the root tends to the spectral radius, and its
    gradient stays near 1 where eigenvalues coincide.
    """
    power = A
    for _ in range(GROWTH_DOUBLINGS):
        power = power @ power
    return torch.relu(torch.linalg.matrix_norm(power) ** (0.5**GROWTH_DOUBLINGS) - bound)


class Points(NamedTuple):
    """Constant signals, and slopes of the gains, of c matrices J."""

    signals: Tensor
    """(c, m + p)"""
    slopes: Tensor
    """(c, q), 1 not saturated, 0 saturated"""


def driven_excess(model: MdkNet, psi0: Tensor) -> Tensor:
    """Mean over several J of growth and spectral radius above their bounds.

    In training J is computed at `_drawn_points`, and observables are in units of their spread over
    psi0 (batch, n). In evaluation it is computed at all corners of the box of inputs and exogenous
    signals, without saturation; then the value, of the spectral radius alone, does not depend on
    psi0.
    """
    if not model.training:
        return _radius_excess(model, model.driven_matrices(*all_corners(model))).mean()
    spread = psi0.detach().std(dim=0, unbiased=False)
    spread = torch.where(spread > LEAST_SPREAD, spread, torch.ones_like(spread))
    J = model.driven_matrices(*_drawn_points(model, psi0)) * spread[None, :] / spread[:, None]
    if model.has_constant:  # in which no two predictions differ
        J = J[:, :-1, :-1]
    return (growth_excess(J, GROWTH_BOUND) + _radius_excess(model, J)).mean()


def _radius_excess(model: MdkNet, J: Tensor) -> Tensor:
    """(c,), of the observables that change."""
    block = model.observables.changing
    return radius_excess(J[:, block][:, :, block])


def radius_excess(J: Tensor) -> Tensor:
    """||J^1024||_F^(1/1024) above 1 (c,), of matrices (c, n, n) without integrators.

    By Gelfand's formula it is close to the excess of the spectral radius. The power is normalised
    at each squaring, so that it neither overflows nor vanishes.
    """
    log_norm = J.new_zeros(len(J))
    for _ in range(RADIUS_DOUBLINGS):
        norm = torch.linalg.matrix_norm(J)
        J = J / norm[:, None, None]
        J, log_norm = J @ J, 2.0 * (log_norm + norm.log())
    log_norm = log_norm + torch.linalg.matrix_norm(J).log()
    return torch.relu(torch.exp(log_norm * 0.5**RADIUS_DOUBLINGS) - 1.0)


def all_corners(model: MdkNet) -> Points:
    """All corners of the box of signals, without saturation.

    At most `MOST_CORNERS`, spread over all of them.
    """
    lowest, highest = model.signal_range
    count = len(lowest)
    numbers = torch.arange(min(2**count, MOST_CORNERS), device=lowest.device) * SPREADING
    is_high = (numbers[:, None] >> torch.arange(count, device=lowest.device)) % 2 == 1
    signals = torch.where(is_high, highest, lowest)
    return Points(signals, signals.new_ones(len(signals), len(model.S)))


def _drawn_points(model: MdkNet, psi0: Tensor) -> Points:
    """Random points of the box of signals, every other one a corner.

    At the first of them the gains are entirely saturated, up to the half of them not at all, and at
    the others as at a random one of psi0 (batch, n), or beyond.
    """
    lowest, highest = model.signal_range
    share = torch.rand(DRAWN, len(lowest)).to(lowest.device)
    share[::2] = share[::2].round()
    count = DRAWN // 2
    with torch.no_grad():
        rows = torch.randint(len(psi0), (count,)).to(psi0.device)
        stretch = 1.0 + (LARGEST_STRETCH - 1.0) * torch.rand(count, 1).to(psi0)
        gains = torch.tanh(stretch * (psi0[rows] @ model.gains().S.t()))
    slopes = torch.cat([torch.ones_like(gains), 1.0 - gains.square()])
    slopes[0] = 0.0
    return Points(lowest + share * (highest - lowest), slopes)


def spectral_radius(model: MdkNet) -> float:
    """Largest magnitude of an eigenvalue of A, in float64; NaN if A is not finite."""
    with torch.no_grad():
        return _largest_magnitude(model.operator().A)


def driven_radius(model: MdkNet) -> float:
    """The same under inputs and exogenous signals at their bounds, without saturation."""
    with torch.no_grad():
        return _largest_magnitude(model.driven_matrices(*all_corners(model)))


def _largest_magnitude(matrices: Tensor) -> float:
    numbers = matrices.double().cpu().numpy()
    if not np.all(np.isfinite(numbers)):
        return float("nan")
    return float(np.abs(np.linalg.eigvals(numbers)).max())
