"""Reference states over the horizon, from the path polynomial and the curvature on the bus."""

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.preview import KNOTS
from rt_controller.contract.signals import (
    CurvaturePreview,
    PathReference,
    StateColumn,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.knots import Knots

_POWERS = 4
_OF_RAMPS = np.array([[1.0 / 6.0], [1.0 / 2.0], [1.0]])
"""factors of the third, second and first power of a ramp, in e_y, its slope and the curvature"""


class ReferenceHorizon:
    """Reference states x_r at the knots 0 … K - 1 and at the end of the horizon, preallocated.

    They are where the car will be then, counted from the `delay` of the inputs on. Heading and yaw
    rate follow the path's slope and curvature. Holding the present reference over the horizon would
    give several times the lateral error.

    e_y and e_psi are counted from the circle that has the curvature of the road at the car, because
    a model predicts along it, as it was trained. A road of other curvature ahead turns away from
    the circle: its heading is the integral of the difference of curvature, its lateral place the
    integral of the heading. With straight lines between its values, that difference is a sum of
    ramps c_j max(sigma - sigma_j, 0).
    """

    def __init__(self, knots: Knots) -> None:
        stages = knots.count + 1
        self.states = np.zeros((stages, len(VehicleState._fields)))
        """(K + 1, 6), columns as `VehicleState`"""
        self._stage_s = PERIOD_S * np.array((0, *knots.ends), dtype=np.float64)
        self._elapsed_s = self._stage_s.copy()
        self._speed_mps = np.zeros(stages)
        self._terms = np.ones((_POWERS + 3 * KNOTS, stages))
        """1, sigma, sigma^2, sigma^3; then third, second and first powers of the ramps"""
        _, self._sigma_m, self._sigma2, self._sigma3 = self._powers = self._terms[:_POWERS]
        self._cubes, self._squares, self._ramps = self._terms[_POWERS:].reshape(3, KNOTS, -1)
        self._coefficients = np.zeros((3, len(self._terms)))
        """of e_y, its slope and the curvature of the path"""
        self._path_coefficients = np.zeros((3, _POWERS))
        """the same where the road is the circle"""
        ramps = self._coefficients[:, _POWERS:].reshape(3, 3, KNOTS)
        self._ramp_coefficients = np.einsum("iij->ij", ramps)
        """(3, 5), a view"""
        self._numbers = np.arange(KNOTS, dtype=np.float64)[:, None]
        self._starts_m = np.zeros((KNOTS, 1))
        self._values = np.zeros((3, stages))
        """e_y, slope and curvature of each stage"""
        self._is_circle = True
        self._constant_per_m = 0.0
        """what the preview adds to the curvature at the car"""

    def expand(
        self,
        path: PathReference,
        state: VehicleState,
        curvature_per_m: float,
        preview: CurvaturePreview | None = None,
        delay: int = 0,
    ) -> Array:
        """Reference states (K + 1, 6) along `path`, seen from the present `state`.

        That of the lateral velocity is zero. The first knot is `delay` periods ahead; without a
        `preview` the curvature of the road is constant.
        """
        np.add(self._stage_s, delay * PERIOD_S, out=self._elapsed_s)
        c0, c1, c2, c3, v_mps, a_mps2 = path
        speed_mps, sigma_m = self._speed_mps, self._sigma_m
        np.multiply(self._elapsed_s, a_mps2, out=speed_mps)
        speed_mps += v_mps
        np.maximum(speed_mps, 0.0, out=speed_mps)
        # Arc length at the mean of the present speed and the reference speed of the stage.
        np.add(speed_mps, state.vx_mps, out=sigma_m)
        sigma_m *= 0.5
        sigma_m *= self._elapsed_s
        np.multiply(sigma_m, sigma_m, out=self._sigma2)
        np.multiply(self._sigma2, sigma_m, out=self._sigma3)
        coefficients = self._path_coefficients
        coefficients[0] = c0, c1, c2, c3
        coefficients[1, :3] = c1, 2.0 * c2, 3.0 * c3
        coefficients[2, :2] = curvature_per_m + 2.0 * c2, 6.0 * c3
        terms = self._powers
        self._is_circle = preview is None or preview[1:] == (curvature_per_m,) * KNOTS
        if preview is not None and not self._is_circle:
            self._coefficients[:, :_POWERS] = coefficients
            coefficients, terms = self._coefficients, self._terms
            self._turn_away(preview, curvature_per_m)
        ey_m, slope, curvature = np.dot(coefficients, terms, out=self._values)

        x = self.states
        x[:, StateColumn.vx_mps] = speed_mps
        np.multiply(speed_mps, curvature, out=x[:, StateColumn.yaw_rate_radps])
        np.multiply(speed_mps, PERIOD_S, out=x[:, StateColumn.ds_m])
        x[:, StateColumn.ey_m] = ey_m
        np.arctan(slope, out=x[:, StateColumn.epsi_rad])
        return x

    def counted_from_road(self, states: Array) -> Array:
        """Predicted `states` (K + 1, 6), of which e_y and e_psi were counted from the circle.

        At the arc lengths of the last `expand`. Allocates memory.
        """
        if self._is_circle:
            return states
        lateral_m, slope, _ = self._coefficients[:, _POWERS:] @ self._terms[_POWERS:]
        lateral_m += 0.5 * self._constant_per_m * self._sigma2
        slope += self._constant_per_m * self._sigma_m
        states = states.copy()
        states[:, StateColumn.ey_m] -= lateral_m
        states[:, StateColumn.epsi_rad] -= np.arctan(slope)
        return states

    def _turn_away(self, preview: CurvaturePreview, curvature_per_m: float) -> None:
        """Add the road ahead to the coefficients, and evaluate its ramps."""
        spacing_m, k0, k1, k2, k3, k4 = preview
        # The preview of an older tick can begin with another curvature than that of the state.
        self._constant_per_m = constant = k0 - curvature_per_m
        coefficients = self._coefficients
        coefficients[0, 2] += 0.5 * constant
        coefficients[1, 1] += constant
        coefficients[2, 0] += constant
        first, second = (k1 - k0) / spacing_m, (k2 - k1) / spacing_m
        third, fourth = (k3 - k2) / spacing_m, (k4 - k3) / spacing_m
        # The last one makes the curvature constant behind the last value.
        ramps = first, second - first, third - second, fourth - third, -fourth
        np.multiply(_OF_RAMPS, ramps, out=self._ramp_coefficients)
        np.multiply(self._numbers, spacing_m, out=self._starts_m)
        np.subtract(self._sigma_m, self._starts_m, out=self._ramps)
        np.maximum(self._ramps, 0.0, out=self._ramps)
        np.multiply(self._ramps, self._ramps, out=self._squares)
        np.multiply(self._squares, self._ramps, out=self._cubes)
