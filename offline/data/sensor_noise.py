"""Measurement noise on what a model reads: the first state of a prediction, and the past."""

import numpy as np

from rt_controller.contract.arrays import Array

STANDARD_DEVIATIONS = {
    "vx_mps": 0.03,
    "vy_mps": 0.03,
    "yaw_rate_radps": float(np.radians(0.1)),
    "ey_m": 0.02,
    "epsi_rad": float(np.radians(0.1)),
}
"""by state, at level 1; normally distributed, independent between signals and instants"""
PROGRESS, SPEED = "ds_m", "vx_mps"


def noise_matrix(names: tuple[str, ...], dt_s: float) -> Array:
    """M (len(STANDARD_DEVIATIONS), len(names)): z @ M is noise of level 1 on the named signals.

    z (..., len(STANDARD_DEVIATIONS)) is standard normal. Progress has the noise of the longitudinal
    speed times the period, from which a car computes it.
    """
    matrix = np.zeros((len(STANDARD_DEVIATIONS), len(names)))
    for row, (state, deviation) in enumerate(STANDARD_DEVIATIONS.items()):
        for column, name in enumerate(names):
            if name == state:
                matrix[row, column] = deviation
            elif name == PROGRESS and state == SPEED:
                matrix[row, column] = deviation * dt_s
    return matrix
