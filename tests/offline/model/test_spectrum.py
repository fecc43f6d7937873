"""The spectral radius of a model in training, without inputs and at their bounds."""

import math

import numpy as np
import pytest
import torch

from offline.config import PRESETS
from offline.model.network import MdkNet
from offline.model.observables import Sizes
from offline.model.stability import all_corners, driven_radius, spectral_radius

SIZES = Sizes(states=3, inputs=2, exogenous=1, remembered=0, dt_s=0.1)
SMALL = {"hidden": (4,), "latents": 2, "history_steps": 0, "bilinear_rank": 1, "drift_rank": 1}


def a_model() -> MdkNet:
    torch.manual_seed(0)
    return MdkNet(PRESETS["recommended"].model_copy(update=SMALL), SIZES)


def test_the_spectral_radius_is_that_of_a() -> None:
    model = a_model()
    with torch.no_grad():
        model.A_rows[:, :4] = torch.diag(torch.tensor([0.5, -1.25, 0.9, 0.0]))
        model.A_rows[0, 2] = 7.0
    assert spectral_radius(model) == pytest.approx(1.25)


def test_the_driven_radius_is_the_largest_of_all_corners() -> None:
    model = a_model()
    with torch.no_grad():
        model.N_rows *= 50.0
    matrices = model.driven_matrices(*all_corners(model)).detach().double().numpy()
    expected = max(abs(np.linalg.eigvals(J)).max() for J in matrices)
    assert driven_radius(model) == pytest.approx(expected)
    assert driven_radius(model) > spectral_radius(model) + 0.01


def test_a_model_that_is_not_finite_has_no_radius() -> None:
    model = a_model()
    with torch.no_grad():
        model.A_rows[0, 0] = torch.nan
    assert math.isnan(spectral_radius(model))
    assert math.isnan(driven_radius(model))
