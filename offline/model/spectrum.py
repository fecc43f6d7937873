"""Spectral radius of a model in training."""

import numpy as np
import torch
from torch import Tensor

from offline.model.network import MdkNet
from offline.model.stability import all_corners


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
