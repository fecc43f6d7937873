"""Checks that a bundle must pass before it is written."""

from typing import NamedTuple

import numpy as np

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.model.bundle_predictor import BundlePredictor
from offline.model.driven import (
    BoxStability,
    DrivenStability,
    box_stability,
    signal_box,
)
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.model.bundle import Bundle

PENALISED = DrivenStability(radius=1.001, growth=10.0)
"""of a model whose growth under inputs is penalised in training, gains not or entirely saturated"""
OTHERS = DrivenStability(radius=1.05, growth=100.0)
"""of any other model, and of gains that saturate partly, as those of a car that slides; a mode that
doubles within the controller's horizon is not a car's"""
LARGEST_PARITY_ERROR = 1e-5
MOST_HELD_OUT = 1_000
"""validation trajectories on which a bundle is compared with persistence"""


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


def check_export(
    bundle: Bundle, dataset: Dataset, limits: DrivenStability = OTHERS
) -> ExportFigures:
    """The figures of a bundle that may be exported.

    A state that does not change in the validation part is not compared with persistence.

    Raises:
        ArtifactError: a number is not finite; the model grows too much under inputs within their
            bounds; it predicts a state of the validation part worse than persistence; or the ONNX
            encoder differs from the trained one on the self-test.
    """
    _require_finite(bundle)
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
    for name, found in stability._asdict().items():
        largest = limits
        if name == "at_states":
            pairs = zip(limits, OTHERS, strict=True)
            largest = DrivenStability(*(max(pair) for pair in pairs))
        if not (found.radius <= largest.radius and found.growth <= largest.growth):
            raise ArtifactError(
                f"export expects, under all inputs within their bounds and with gains "
                f"{name.replace('_', ' ')}, a spectral radius of at most {largest.radius} and a "
                f"growth of at most {largest.growth:g} in 80 steps, found {found.radius:.4f} and "
                f"{found.growth:.3g}: predictions may grow without bound. Train longer or with a "
                f"larger --weight-stability; a baseline that grows like this cannot drive."
            )


def _require_finite(bundle: Bundle) -> None:
    numbers = [bundle.A, bundle.B_uc, bundle.B_uw, bundle.c, bundle.selftest_psi]
    if bundle.bilinear is not None:
        numbers += [bundle.bilinear.N, bundle.bilinear.S, bundle.bilinear.s0]
    if bundle.drift is not None:
        numbers += [bundle.drift.N, bundle.drift.S, bundle.drift.s0]
    if not all(np.all(np.isfinite(array)) for array in numbers):
        raise ArtifactError(
            "export expects a model of finite numbers, found some that are not: the training "
            "diverged. Train again with a smaller --learning-rate."
        )


def _require_better_than_persistence(predictor: BundlePredictor, dataset: Dataset) -> Array:
    held_out = dataset.select("validation").take(slice(MOST_HELD_OUT))
    x, u, w, past = (array.astype(np.float64) for array in held_out[:4])
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        error = np.square(predictor.predict(x[:, 0], past, u, w) - x)[:, 1:].mean(axis=(0, 1))
        persistence = np.square(x[:, :1] - x)[:, 1:].mean(axis=(0, 1))
        ratio = np.asarray(persistence / error)
    worse = [
        f"{name} (mean squared error {found:.3g}, of persistence {expected:.3g})"
        for name, found, expected in zip(
            dataset.schema.state_names, error, persistence, strict=True
        )
        if not (found < expected or expected == 0.0)
    ]
    if worse:
        raise ArtifactError(
            f"export expects predictions over two seconds that are better than the last measured "
            f"state, found worse ones on the validation part for {', '.join(worse)}. Train longer, "
            f"or check the data with offline-import: a state that does not depend on the inputs "
            f"cannot be learned from them."
        )
    return ratio
