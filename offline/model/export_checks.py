"""Checks that a bundle must pass before it is written."""

import numpy as np

from offline.config import TrainingConfig
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.model.bundle import Bundle

LARGEST_PROJECTED_RADIUS = 1.0005
"""of a model whose A was projected; above 1 only by rounding to float32"""
LARGEST_RADIUS = 1.05
"""of any other model; a mode that doubles within the controller's horizon is not a car's"""
LARGEST_PARITY_ERROR = 1e-5


def largest_radius_of(config: TrainingConfig) -> float:
    """Largest spectral radius that a model of this configuration may be exported with."""
    return LARGEST_PROJECTED_RADIUS if config.stability == "projection" else LARGEST_RADIUS


def check_export(bundle: Bundle, largest_radius: float = LARGEST_RADIUS) -> float:
    """Largest difference torch / ONNX, observables in units of their spread.

    Raises:
        ArtifactError: a number is not finite, the spectral radius is too large, or the ONNX encoder
            differs from the trained one on the self-test.
    """
    numbers = [bundle.A, bundle.B_uc, bundle.B_uw, bundle.c, bundle.selftest_psi]
    if bundle.bilinear is not None:
        numbers += [bundle.bilinear.N, bundle.bilinear.S, bundle.bilinear.s0]
    if not all(np.all(np.isfinite(array)) for array in numbers):
        raise ArtifactError(
            "export expects a model of finite numbers, found some that are not: the training "
            "diverged. Train again with a smaller --learning-rate."
        )
    if bundle.spectral_radius > largest_radius:
        raise ArtifactError(
            f"export expects a spectral radius of at most {largest_radius}, found "
            f"{bundle.spectral_radius:.4f}: predictions would grow without bound over the horizon. "
            f"Train longer or with a larger --weight-stability; a baseline of this radius cannot "
            f"drive."
        )
    parity = bundle.parity_error(BundlePredictor(bundle).lift(bundle.selftest))
    if not parity < LARGEST_PARITY_ERROR:
        raise ArtifactError(
            f"export expects torch and ONNX to agree within {LARGEST_PARITY_ERROR:g} of the spread "
            f"of each observable, found a difference of {parity:.2e}. Check the versions of torch, "
            f"onnxscript and onnxruntime."
        )
    return parity
