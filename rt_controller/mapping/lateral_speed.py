"""Lateral speed of the centre of gravity from yaw rate and speed: the equation of the rear axle.

At the rear axle the side-slip angle is the lateral force over the cornering stiffness, and by the
balance of moments that force follows from lateral acceleration and yaw acceleration:

    v_y = b r - tau v_x (dv_y/dt + r v_x) + tau q v_x dr/dt

with b the distance from the centre of gravity to the rear axle, tau = m a / (L C_r) and
q = I_z / (m a). With v_y = z + q r no derivative of the yaw rate is needed:

    tau v_x dz/dt = (b - q - tau v_x^2) r - z

Steering and front tyres do not occur, so an offset of the steering wheel has no effect. The gateway
steps it once a period; `offline-import` runs it over whole drives with the same constants.
"""

from math import exp, isfinite, nan
from typing import Any, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.timing import PERIOD_S

SLOWEST_MPS = 1.0
"""the equation has no solution at rest; below, v_y is that of rolling: b r"""


class RearAxle(NamedTuple):
    """The constants of the equation above."""

    rear_axle_m: float
    """b"""
    slip_s2_per_m: float
    """tau: side-slip angle of the rear axle per lateral acceleration"""
    inertia_m: float
    """q"""

    def steady(self, vx_mps: Any) -> Any:
        """z of a steady turn over yaw rate, in m, of a speed or of an array of speeds."""
        b, tau, q = self
        return b - q - tau * vx_mps**2


class LateralSpeed:
    """Estimates v_y once a period; nothing is allocated."""

    def __init__(self, rear_axle: RearAxle) -> None:
        self.rear_axle = rear_axle
        self._z: float | None = None
        self._yaw_rate_radps = 0.0

    def forget(self) -> None:
        """The next period does not follow on the last one."""
        self._z = None

    def update(self, vx_mps: float, yaw_rate_radps: float) -> float:
        """v_y in m/s of a period; NaN if a value is.

        The first one assumes a steady turn; the assumption decays with tau v_x, 0.1 s at 20 m/s.
        """
        b, tau, q = self.rear_axle
        if not (isfinite(vx_mps) and isfinite(yaw_rate_radps)):
            self.forget()
            return nan
        if vx_mps < SLOWEST_MPS or tau <= 0.0:
            self.forget()
            return b * yaw_rate_radps if vx_mps > 0.0 else 0.0
        if self._z is None:
            self._z = float(self.rear_axle.steady(vx_mps) * yaw_rate_radps)
        else:
            mean_radps = 0.5 * (self._yaw_rate_radps + yaw_rate_radps)
            target = self.rear_axle.steady(vx_mps) * mean_radps
            self._z = float(target + (self._z - target) * exp(-PERIOD_S / (tau * vx_mps)))
        self._yaw_rate_radps = yaw_rate_radps
        return self._z + q * yaw_rate_radps


def lateral_speed(rear_axle: RearAxle, vx_mps: Array, yaw_rate: Array, period_s: float) -> Array:
    """v_y in m/s of whole drives (..., T), as `LateralSpeed.update` gives it step by step."""
    b, tau, q = rear_axle
    mean = 0.5 * (yaw_rate + np.roll(yaw_rate, 1, axis=-1))
    is_slow = vx_mps < SLOWEST_MPS
    starts = is_slow | np.roll(is_slow, 1, axis=-1)
    starts[..., 0] = True
    target = rear_axle.steady(vx_mps) * np.where(starts, yaw_rate, mean)
    kept = np.where(starts, 0.0, np.exp(-period_s / (tau * np.maximum(vx_mps, SLOWEST_MPS))))
    z = target.copy()
    for k in range(1, z.shape[-1]):
        z[..., k] += (z[..., k - 1] - target[..., k]) * kept[..., k]
    return np.where(is_slow, np.where(vx_mps > 0.0, b * yaw_rate, 0.0), z + q * yaw_rate)
