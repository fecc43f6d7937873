"""Checks that a bundle must pass before it is written, and its growth under constant inputs.

A difference d between two lifted states follows d_(k+1) = J d_k, where
J = A + sum_r N_r (v_r s_r - o_r) S_r over all gains: v is the input or exogenous signal that the
gain is multiplied by, or 1; the slope s is between 0 (saturated) and 1 (not saturated; always, if
the gains of a bilinear model do not saturate); o is 1 for the saturation of the drift, which is
tanh(a) - a, and otherwise 0.
"""

from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.signals import noise_matrix
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Step

STEPS = 80
SAMPLES = 500
"""of signals inside the box"""
MOST_SIGNALS = 10
"""more would have too many corners"""
LARGEST_PARITY_ERROR = 1e-5
MOST_HELD_OUT = 1_000
"""validation trajectories on which a bundle is compared with persistence"""


class DrivenStability(NamedTuple):
    """Largest spectral radius of J, and largest ||J^80||_2 in units of the spread of psi."""

    radius: float
    growth: float


PENALISED = DrivenStability(radius=1.001, growth=10.0)
"""of a model whose growth under inputs is penalised in training, gains not or entirely saturated"""
LARGEST_CHANGE = 2.0
"""of the growth of the model that a training began with"""
OTHERS = DrivenStability(radius=1.05, growth=100.0)
"""of any other model, and of gains that saturate partly, as those of a car that slides; a mode that
doubles within the controller's horizon is not a car's"""


class BoxStability(NamedTuple):
    """Stability at all corners of a box of signals, and at `SAMPLES` random points of it."""

    unsaturated: DrivenStability
    """gains not saturated"""
    saturated: DrivenStability
    """at the corners alone, gains entirely saturated: with it every prediction is bounded"""
    at_states: DrivenStability
    """gains as at lifted states of the self-test"""


class ExportFigures(NamedTuple):
    """What the checks found."""

    parity: float
    """largest difference torch / ONNX, observables in units of their spread"""
    stability: BoxStability
    persistence_over_model: Array
    """(n_x,) mean squared error of persistence over that of the bundle, on validation data"""


def limits_of(config: TrainingConfig) -> DrivenStability:
    """Largest values over the box of signals with which such a model may be exported."""
    return PENALISED if config.stability == "driven" else OTHERS


def limits_beside(first: Bundle, bundle: Bundle, limits: DrivenStability) -> DrivenStability:
    """The limits for a `bundle` whose training began with the model `first`.

    In units of the spread of few data that one may grow much too.
    """
    same_data = replace(first, selftest=bundle.selftest, selftest_psi=bundle.selftest_psi)
    found = box_stability(same_data, signal_box(bundle)).unsaturated
    growth = max(limits.growth, LARGEST_CHANGE * found.growth)
    return DrivenStability(max(limits.radius, found.radius), growth)


def check_export(
    bundle: Bundle, dataset: Dataset, limits: DrivenStability = OTHERS
) -> ExportFigures:
    """The figures of a bundle that may be exported.

    A state that changes less in the validation part than the noise of production sensors is not
    compared with persistence.

    Raises:
        ArtifactError: a number is not finite; the model grows too much under inputs within their
            bounds; it predicts a state of the validation part worse than persistence; or the ONNX
            encoder differs from the trained one on the self-test.
    """
    parts = (bundle.A, bundle.B_uc, bundle.B_uw, bundle.c, bundle.selftest_psi)
    gains = Step(bundle)
    if not all(np.isfinite(array).all() for array in (*parts, gains.N, gains.S, gains.s0)):
        raise ArtifactError(
            "export expects a model of finite numbers, found some that are not: the training "
            "diverged. Train again with a smaller --learning-rate."
        )
    stability = box_stability(bundle, signal_box(bundle))
    require_stable(stability, limits)
    predictor = BundlePredictor(bundle)
    parity = bundle.parity_error(predictor.lift(bundle.selftest))
    if not parity < LARGEST_PARITY_ERROR:
        raise ArtifactError(
            f"export expects torch and ONNX to agree within {LARGEST_PARITY_ERROR:g} of the spread "
            f"of each observable, found a difference of {parity:.2e}. Check the versions of torch, "
            f"onnxscript and onnxruntime."
        )
    return ExportFigures(parity, stability, _require_better_than_persistence(predictor, dataset))


def require_stable(stability: BoxStability, limits: DrivenStability) -> None:
    """Refuse a model that grows too much under inputs.

    Raises:
        ArtifactError: radius or growth exceed the limits; at states, also those of any other model.
    """
    at_states = DrivenStability(*map(max, zip(limits, OTHERS, strict=True)))
    for name, found in stability._asdict().items():
        largest = at_states if name == "at_states" else limits
        if not (found.radius <= largest.radius and found.growth <= largest.growth):
            raise ArtifactError(
                f"export expects, under all inputs within their bounds and with gains "
                f"{name.replace('_', ' ')}, a spectral radius of at most {largest.radius} and a "
                f"growth of at most {largest.growth:g} in 80 steps, found {found.radius:.4f} and "
                f"{found.growth:.3g}: predictions may grow without bound. Train a network for "
                f"longer or with a larger --weight-stability, or choose another baseline."
            )


def _require_better_than_persistence(predictor: BundlePredictor, dataset: Dataset) -> Array:
    held_out = dataset.select("validation").take(slice(MOST_HELD_OUT))
    x, u, w, past = (array.astype(np.float64) for array in held_out[:4])
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        error = np.square(predictor.predict(x[:, 0], past, u, w) - x)[:, 1:].mean(axis=(0, 1))
        persistence = np.square(x[:, :1] - x)[:, 1:].mean(axis=(0, 1))
        ratio = np.asarray(persistence / error)
    names = dataset.schema.state_names
    noises = np.square(noise_matrix(names, dataset.schema.dt_s)).sum(axis=0)
    worse = [
        f"{name} (mean squared error {found:.3g}, of persistence {expected:.3g})"
        for name, found, expected, noise in zip(names, error, persistence, noises, strict=True)
        if not (found < expected or expected <= noise)
    ]
    if worse:
        raise ArtifactError(
            f"export expects predictions over two seconds that are better than the last measured "
            f"state, found worse ones on the validation part for {', '.join(worse)}. Train longer, "
            f"or check the data with offline-import: a state that does not depend on the inputs "
            f"cannot be learned from them."
        )
    return ratio


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
    points = np.concatenate([corners, rng.uniform(box[0], box[1], size=(SAMPLES, count))])
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


def driven_matrices(bundle: Bundle, signals: Array, slopes: Array) -> Array:
    """J (c, n, n) under constant signals (c, m + p), with slopes (c, q) of the gains of `Step`."""
    gains = Step(bundle)
    slopes = np.where(np.arange(gains.count) < gains.first_saturating, 1.0, slopes)
    factors = np.column_stack([signals, np.ones(len(signals))])[:, gains.factors]
    matrices: Array = gains.A + (gains.N * (slopes * factors)[:, None]) @ gains.S
    return matrices


def stability_of(matrices: Array, bundle: Bundle) -> DrivenStability:
    """Of matrices J (c, n, n), without the observables in which no two predictions differ.

    Those keep the value that every self-test instant has.
    """
    if not np.isfinite(matrices).all():
        return DrivenStability(np.inf, np.inf)
    forcing = np.column_stack([bundle.B_uc, bundle.B_uw, bundle.c, Step(bundle).N])
    is_kept = np.all(np.eye(len(bundle.A)) == bundle.A, axis=1) & ~forcing.any(axis=1)
    changing = ~(is_kept & (np.ptp(bundle.selftest_psi, axis=0) == 0.0))
    matrices, spread = matrices[:, changing][:, :, changing], bundle.spread[changing]
    scaled = matrices * spread[None, :] / spread[:, None]
    with np.errstate(over="ignore", invalid="ignore"):
        powers = np.linalg.matrix_power(scaled, STEPS)
    is_finite = np.isfinite(powers).all()
    growth = float(np.linalg.norm(powers, 2, axis=(1, 2)).max()) if is_finite else np.inf
    return DrivenStability(float(np.abs(np.linalg.eigvals(scaled)).max()), growth)
