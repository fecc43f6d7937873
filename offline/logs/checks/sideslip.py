"""The rear axle's side force as a check of the time scale.

Lateral acceleration is v_y' + v_x r, whatever the car. Both terms have the same factor, and only
one contains a derivative. With w = v_y - b r, the lateral speed of the rear axle, and a side force
in proportion to its slip angle w / v_x, the balance of side force and yaw moment is

    v_y = b r - (v_x / C) (v_y' + v_x r) + d v_x r'

Least squares give b, C and two separate factors of v_x v_y' and v_x^2 r. Their ratio is 1, and the
factor by which the times are too long if they are wrong.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.logs.checks.pairs import slope
from rt_controller.contract.arrays import Array

LEAST_SPEED_MPS = 6.0
LEAST_BLOCKS = 8
"""pieces of a drive from which the interval of the ratio is estimated"""
BLOCK_SAMPLES = 400
LEAST_R2 = 0.75
WIDEST_INTERVAL = 1.8
"""largest ratio of the ends of the interval"""
STIFFNESS_MPS2 = (40.0, 300.0)
"""range of C of road tyres, the lateral acceleration per slip angle"""
_RESAMPLES = 200
_QUANTILES = (0.025, 0.975)


class RearAxle(NamedTuple):
    """What the sideslip of a drive gives."""

    distance_m: float
    """b, centre of gravity (or sensor) to rear axle"""
    stiffness_mps2: float
    """C"""
    time_scale: float
    """factor by which the times are too long"""
    time_scale_range: tuple[float, float]
    """95 % interval"""


def fit_rear_axle(
    speed_mps: Sequence[Array],
    side_mps: Sequence[Array],
    yaw_rate_radps: Sequence[Array],
    dt_s: float,
    reach: int,
) -> RearAxle | None:
    """The fit over all episodes; None if they do not determine it, or it is not that of tyres.

    Derivatives are taken over `reach` samples to both sides.
    """
    blocks = [
        block
        for signals in zip(speed_mps, side_mps, yaw_rate_radps, strict=True)
        for block in _normal_equations(*signals, dt_s, reach)
    ]
    if len(blocks) < LEAST_BLOCKS:
        return None
    stacked, rng = np.stack(blocks), np.random.default_rng(0)
    draws = rng.integers(0, len(blocks), (_RESAMPLES, len(blocks)))
    # Signals without motion give no factors, or infinite ones.
    with np.errstate(divide="ignore", invalid="ignore"):
        try:
            factors, r2 = _solve(stacked.sum(axis=0))
            ratios = [_ratio(_solve(stacked[drawn].sum(axis=0))[0]) for drawn in draws]
        except np.linalg.LinAlgError:
            return None
        low, high = (float(q) for q in np.quantile(ratios, _QUANTILES))
        stiffness_mps2 = -1.0 / factors[1]
    is_tyre = STIFFNESS_MPS2[0] <= stiffness_mps2 <= STIFFNESS_MPS2[1]
    if not (is_tyre and r2 >= LEAST_R2 and 0.0 < low <= high <= WIDEST_INTERVAL * low):
        return None
    return RearAxle(float(factors[0]), float(stiffness_mps2), _ratio(factors), (low, high))


def _normal_equations(vx: Array, vy: Array, r: Array, dt_s: float, reach: int) -> list[Array]:
    """Products (6, 6) of the terms and v_y, for each block of the drive."""
    terms = (r, vx * vx * r, vx * slope(vy, dt_s, reach), vx * slope(r, dt_s, reach))
    mean = np.full(2 * reach, 0.5 / reach)
    smooth = [np.convolve(each, mean, "same") for each in (*terms, np.ones(len(r)), vy)]
    rows = np.stack(smooth, axis=1)[vx >= LEAST_SPEED_MPS]
    begins = range(0, len(rows) - BLOCK_SAMPLES + 1, BLOCK_SAMPLES)
    return [rows[k : k + BLOCK_SAMPLES].T @ rows[k : k + BLOCK_SAMPLES] for k in begins]


def _solve(products: Array) -> tuple[Array, float]:
    """Factors (5,) of the terms, and the share of the variance of v_y that they explain."""
    square, mixed, total = products[:5, :5], products[:5, 5], products[5, 5]
    factors: Array = np.linalg.solve(square, mixed).astype(np.float64)
    spread = total - mixed[4] ** 2 / square[4, 4]
    return factors, float(1.0 - (total - mixed @ factors) / spread)


def _ratio(factors: Array) -> float:
    return float(factors[2] / factors[1])
