"""Scaling between physical units and the numbers the network sees.

Fitted once, on the training trajectories only. A signal whose zero means something (straight
ahead, on the line, pedal released) is divided by its root mean square and never shifted, so that
left and right stay mirror images and a released pedal stays zero. Speed and progress, which are
never near zero, are centred too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.signals import VehicleState

Array = NDArray[np.float64]

CENTRED_STATES = frozenset({"vx_mps", "ds_m"})


@dataclass(frozen=True, slots=True)
class Scaling:
    """Centre and spread of every signal, in physical units."""

    x_centre: Array
    """(6,) as `VehicleState`"""
    x_scale: Array
    """(6,)"""
    u_scale: Array
    """(4,) throttle, brake, steering wheel, curvature"""

    def normalise_states(self, x: NDArray[np.floating]) -> Array:
        """States (..., 6) in units of their spread."""
        return np.asarray((x - self.x_centre) / self.x_scale, dtype=np.float64)

    def restore_states(self, x: NDArray[np.floating]) -> Array:
        """States (..., 6) in physical units: the inverse of `normalise_states`."""
        return np.asarray(x * self.x_scale + self.x_centre, dtype=np.float64)


def fit_scaling(
    x: NDArray[np.floating], u: NDArray[np.floating], kappa: NDArray[np.floating]
) -> Scaling:
    """Scaling of the trajectories x (N, K+1, 6), u (N, K, 3), kappa (N,).

    A signal that never moves keeps its unit: its scale is 1.
    """
    states = np.asarray(x, dtype=np.float64).reshape(-1, x.shape[-1])
    centred = np.array([name in CENTRED_STATES for name in VehicleState._fields])
    x_centre = np.where(centred, states.mean(axis=0), 0.0)
    inputs = np.asarray(u, dtype=np.float64).reshape(-1, u.shape[-1])
    u_scale = np.append(_root_mean_square(inputs), _root_mean_square(np.asarray(kappa)[:, None]))
    return Scaling(x_centre, _root_mean_square(states - x_centre), u_scale)


def _root_mean_square(rows: NDArray[np.floating]) -> Array:
    spread = np.sqrt(np.mean(np.square(rows, dtype=np.float64), axis=0))
    return np.where(spread > 1e-12, spread, 1.0)
