"""Growth of a lifted model under constant inputs, for every saturation of its gains.

A difference d between two lifted states follows d_(k+1) = J d_k, where
J = A + sum_r N_r (v_r s_r - o_r) S_r over all gains: v is the input or exogenous signal that the
gain is multiplied by, or 1; the slope s is between 0 (saturated) and 1 (not saturated; always, if
the gains of a bilinear model do not saturate); o is 1 for the saturation of the drift, which is
tanh(a) - a, and otherwise 0.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Step

STEPS = 80
SAMPLES = 500
"""of signals inside the box"""
MOST_SIGNALS = 10
"""more would have too many corners"""


class DrivenStability(NamedTuple):
    """Largest spectral radius of J, and largest ||J^80||_2 in units of the spread of psi."""

    radius: float
    growth: float


class BoxStability(NamedTuple):
    """Stability over all signals of a box."""

    unsaturated: DrivenStability
    """at all corners and at `SAMPLES` random points, gains not saturated"""
    saturated: DrivenStability
    """at all corners, gains entirely saturated: with it every prediction is bounded"""
    at_states: DrivenStability
    """at all corners and at `SAMPLES` random points, gains as at lifted states of the self-test"""


def signal_box(bundle: Bundle) -> Array:
    """Lowest and highest value (2, m + p) of each input and exogenous signal.

    Of a bundle that does not know them: the car's limits, or zero.
    """
    if bundle.signal_range is not None:
        return bundle.signal_range
    m, p = bundle.B_uc.shape[1], bundle.B_uw.shape[1]
    box = np.zeros((2, m + p))
    if bundle.schema.inputs == VEHICLE.inputs:
        box[:, :m] = INPUT_LIMITS.lower, INPUT_LIMITS.upper
    return box


def box_stability(bundle: Bundle, box: Array, seed: int = 0) -> BoxStability:
    """Stability over the box (2, m + p) of signals: at all corners, and at random points of it."""
    rng = np.random.default_rng(seed)
    count = box.shape[1]
    corners = np.array(list(product(*box.T)) if count <= MOST_SIGNALS else [*box])
    inside = rng.uniform(box[0], box[1], size=(SAMPLES, count))
    points = np.concatenate([corners, inside])
    gains = Step(bundle)
    slopes = np.ones((len(points), gains.count))
    psi = bundle.selftest_psi[rng.integers(len(bundle.selftest_psi), size=len(points))]
    slopes_at_psi = 1.0 - np.square(np.tanh(psi @ gains.S.T + gains.s0))

    def stability(signals: Array, slopes: Array) -> DrivenStability:
        return stability_of(driven_matrices(bundle, signals, slopes), bundle)

    return BoxStability(
        stability(points, slopes),
        stability(corners, 0.0 * slopes[: len(corners)]),
        stability(points, slopes_at_psi),
    )


def is_constant(bundle: Bundle) -> NDArray[np.bool_]:
    """(n,) True for observables that keep the value that every self-test instant has."""
    forcing = np.column_stack([bundle.B_uc, bundle.B_uw, bundle.c, Step(bundle).N])
    is_kept = np.all(np.eye(len(bundle.A)) == bundle.A, axis=1) & ~forcing.any(axis=1)
    return np.asarray(is_kept & (np.ptp(bundle.selftest_psi, axis=0) == 0.0))


def driven_matrices(bundle: Bundle, signals: Array, slopes: Array) -> Array:
    """J (c, n, n) under constant signals (c, m + p), with slopes (c, q) of the gains of `Step`."""
    gains = Step(bundle)
    slopes = np.where(np.arange(gains.count) < gains.first_saturating, 1.0, slopes)
    factors = np.column_stack([signals, np.ones(len(signals))])[:, gains.factors]
    columns = gains.N * (slopes * factors - gains.is_saturation)[:, None]
    matrices: Array = bundle.A + columns @ gains.S
    return matrices


def stability_of(matrices: Array, bundle: Bundle) -> DrivenStability:
    """Of matrices J (c, n, n), without the observables in which no two predictions differ."""
    if not np.isfinite(matrices).all():
        return DrivenStability(np.inf, np.inf)
    changing = ~is_constant(bundle)
    matrices, spread = matrices[:, changing][:, :, changing], bundle.spread[changing]
    scaled = matrices * spread[None, :] / spread[:, None]
    with np.errstate(over="ignore", invalid="ignore"):
        powers = np.linalg.matrix_power(scaled, STEPS)
    if not np.isfinite(powers).all():
        return DrivenStability(float(np.abs(np.linalg.eigvals(scaled)).max()), np.inf)
    return DrivenStability(
        float(np.abs(np.linalg.eigvals(scaled)).max()),
        float(np.linalg.norm(powers, 2, axis=(1, 2)).max()),
    )
