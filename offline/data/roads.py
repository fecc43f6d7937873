"""Roads that are laid under the windows of a recording with poses.

Those of the paper have one of a few curvatures, whatever the car does on them. A car that turns
leaves such a road within the window, so a model of its path never sees a bend that is followed.
Roads near the car have about the curvature of its own turn.
"""

import numpy as np
from numpy.typing import NDArray

from offline.config import STEPS, TRAJECTORY_S
from offline.data.dataset import Dataset
from offline.data.recording import Recording
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.signals import MOTION, VEHICLE, StateColumn

LARGEST_PER_M = 0.15
"""a radius of 6.7 m"""
SPREAD_M = 2.5
"""standard deviation of the distance by which car and road separate in a window"""
LARGEST_SPREAD_PER_M = 0.03
_LEAST_SPEED_MPS = 1.0


class RoadsNearCar:
    """Curvatures near the car's own turn, for windows of a recording of a car."""

    def __init__(self, recording: Recording) -> None:
        """Speed and yaw rate are the first states, as in `VehicleState`."""
        moved = recording.x[:, [StateColumn.vx_mps, StateColumn.yaw_rate_radps]]
        total = np.zeros((len(moved) + 1, 2))
        np.cumsum(moved, axis=0, dtype=np.float64, out=total[1:])
        self._total = total

    def draw(self, rows: NDArray[np.int64], normal: Array) -> Array:
        """Curvatures (N,) for the windows that begin at these rows; `normal` (N,) is random."""
        sums = self._total[rows + STEPS] - self._total[rows]
        speed, yaw_rate = np.maximum(sums[:, 0] / STEPS, _LEAST_SPEED_MPS), sums[:, 1] / STEPS
        spread = np.minimum(2.0 * SPREAD_M / (TRAJECTORY_S * speed) ** 2, LARGEST_SPREAD_PER_M)
        most = np.minimum(LARGEST_PER_M, DEFAULT_CAR.plan_lateral_mps2 / speed**2)
        found: Array = np.clip(yaw_rate / speed + spread * normal, -most, most)
        return found


def roads_near_car(dataset: Dataset) -> RoadsNearCar | None:
    """Such roads; None if the data have no poses, or begin with other states."""
    names = VEHICLE.state_names[MOTION]
    is_of_car = dataset.schema.state_names[MOTION] == names
    return RoadsNearCar(dataset.recording) if dataset.recording.has_poses and is_of_car else None
