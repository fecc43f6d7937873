"""Residuals and predictions with given contents, for tests."""

from math import inf

import numpy as np

from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import NEUTRAL_INPUT, VehicleState
from rt_controller.model.dynamics import Matrices
from rt_controller.safety.motion import MotionPrediction, Residuals

CRUISING = VehicleState(20.0, 0.0, 0.0, 0.5, 0.0, 0.0)
Q = Quantity


def residuals(
    prediction: MotionPrediction | None = None, begin: VehicleState = CRUISING
) -> tuple[Residuals, list[float]]:
    """Residuals that begin at this state, and their values by `Quantity`."""
    values = [0.0] * len(Quantity)
    limits = [inf] * len(Quantity)
    limits[Q.LATERAL_SPEED_STEP_MPS], limits[Q.LATERAL_SPEED_TEN_MPS] = 0.5, 0.8
    limits[Q.YAW_RATE_STEP_RADPS], limits[Q.YAW_RATE_TEN_RADPS] = 0.1, 0.2
    found = Residuals(values, prediction, limits)
    found.begin(begin)
    return found, values


def steady() -> MotionPrediction:
    """Of a model in which the motion does not change."""
    nothing = np.zeros((3, 3))
    return MotionPrediction(Matrices(np.eye(3), nothing, nothing[:, :1], nothing[0]), 3)


def predicted(*motions: tuple[float, float, float]) -> MotionPrediction:
    """Roll-outs of these (v_x, v_y, yaw rate), the last one the newest."""
    prediction = steady()
    for motion in motions:
        prediction.begin(np.array(motion))
        prediction.advance(NEUTRAL_INPUT, 0.0)
    return prediction
