"""Every bundle that ships passes the limits of an export, and its predictions stay bounded."""

import json
from math import radians
from pathlib import Path

import numpy as np
import pytest

import rt_controller
from offline.config import TrainingConfig
from offline.model.bundle_predictor import BundlePredictor
from offline.model.export_checks import box_stability, limits_of, require_stable, signal_box
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.model.artifact import load_bundle
from rt_controller.model.dynamics import roll_out

FOLDERS = sorted(
    file.parent for file in Path(rt_controller.__file__).parent.glob("models/*/koopman.npz")
)
STEPS = 80
LARGEST = np.array([100.0, 30.0, 5.0, 2.5, 200.0, 2 * np.pi])
"""of each state over two seconds: v_x, v_y, yaw rate, progress in one period, e_y, e_psi; in SI"""


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name)
def bundle(request):
    return load_bundle(request.param)


def test_radius_and_growth_over_the_box_of_signals_are_within_the_limits_of_an_export(bundle):
    stability = json.loads(bundle.training).get("stability")  # None: not a network
    limits = limits_of(TrainingConfig().model_copy(update={"stability": stability}))
    require_stable(box_stability(bundle, signal_box(bundle)), limits)


@pytest.mark.parametrize("steer_deg", [-180.0, 180.0])
@pytest.mark.parametrize("throttle", [0.0, INPUT_LIMITS.upper.throttle])
@pytest.mark.parametrize("brake_n", [0.0, INPUT_LIMITS.upper.brake_n])
def test_predictions_with_full_pedals_and_half_a_turn_of_the_wheel_are_bounded(
    bundle, throttle, brake_n, steer_deg
):
    """From every instant of the self-test, on a straight road."""
    count = len(bundle.selftest.x)
    u = np.tile((throttle, brake_n, radians(steer_deg)), (count, STEPS, 1))
    w = np.zeros((count, STEPS, 1))
    psi = BundlePredictor(bundle).lift(bundle.selftest._replace(w=w[:, 0]))
    states = roll_out(bundle, psi, u, w, len(LARGEST))
    assert (np.abs(states) < LARGEST).all()
