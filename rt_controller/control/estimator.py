"""Filtered state and constant disturbance, from predictions of the model and of kinematics."""

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.kinematics import heading_change_rad, lateral_change_along_m
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.rollout import Step
from rt_controller.contract.schema import N_INPUTS, N_STATES
from rt_controller.contract.signals import ControlInput, StateColumn, VehicleState

STEPS = 10
"""periods of the prediction whose error is the disturbance"""
LOW_PASS_GAIN = np.array(VehicleState(0.01, 0.05, 0.05, 0.0, 0.05, 0.05))
"""of the disturbance of each state, in one period"""
OBSERVED = [c for c in StateColumn if c is not StateColumn.ds_m]
LARGEST_DISTURBANCE = np.array(VehicleState(0.1, 0.1, 0.05, 0.0, 0.01, 0.005))
"""change of each state in one period"""

GAIN = VehicleState(1.0, 0.25, 0.7, 1.0, 0.05, 0.05)
"""share of the difference between the measured and the predicted state that is taken over in one
period: the noise of a sensor is averaged where the prediction is good"""
OFFSET_GAIN = VehicleState(0.0, 0.03, 0.0, 0.0, 0.001, 0.001)
"""the same of the offset of the prediction: with it a wrong model or a sensor with an offset leaves
no constant difference"""

MOTION, PLACE = range(StateColumn.ey_m), range(StateColumn.ey_m, N_STATES)
"""columns predicted by the model and by kinematics"""


class Estimator:
    """State and disturbance between two measurements; one instance for a controller.

    The motion is predicted by the model, the place on the road by kinematics. The disturbance is
    what has to be added to the predicted states in every period so that a prediction of ten periods
    under the inputs that were applied ends at the estimated state: bank, wind, a grade, a road that
    is more slippery than those of the training, an offset of a sensor.
    """

    def __init__(self, bundle: Bundle, jacobian: Array) -> None:
        """`jacobian` (n, n): derivative of psi+ by psi at a typical state."""
        self._step = Step(bundle)
        self._gains = LOW_PASS_GAIN[OBSERVED, None] * np.linalg.inv(_response(jacobian))
        self._psi = np.zeros((STEPS, bundle.n_observables))
        self._inputs = np.ones(N_INPUTS + 2)
        """inputs, curvature, and 1"""
        self._newest = 0
        self._begun = 0
        """roll-outs in a row without a gap between them"""
        self._is_advanced = False
        self._before: VehicleState | None = None
        self._offset = [0.0] * N_STATES
        """of the prediction of the next state"""
        self.disturbance = np.zeros(N_STATES)
        """(6,), what is added to the predicted states in every period"""

    def forget(self) -> None:
        """A period is missing: the predictions end, and the disturbance stays."""
        self._begun = 0
        self._is_advanced = False

    def reset(self) -> None:
        """Another drive begins."""
        self.forget()
        self.disturbance[:] = 0.0

    def estimate(self, measured: VehicleState, curvature_per_m: float) -> VehicleState:
        """The state of this period, from its measurement and the estimate of the period before.

        `curvature_per_m`: of the road in the period before.
        """
        before = self._before
        if not self._is_advanced or before is None:
            self.forget()
            self._offset = [0.0] * N_STATES
            self._before = measured
            return measured
        self._is_advanced = False
        predicted, found = self._psi[self._newest, :N_STATES].tolist(), list(measured)
        self._correct(found, predicted, MOTION)
        now = VehicleState(*found)
        turned_rad = heading_change_rad(before, now, curvature_per_m, now.ds_m)
        mean_rad = before.epsi_rad + 0.5 * turned_rad
        predicted[StateColumn.ey_m] = before.ey_m + lateral_change_along_m(before, now, mean_rad)
        predicted[StateColumn.epsi_rad] = before.epsi_rad + turned_rad
        self._correct(found, predicted, PLACE)
        self._before = VehicleState(*found)
        return self._before

    def _correct(self, found: list[float], predicted: list[float], columns: range) -> None:
        """Replace some columns of the measured state `found` by their estimates."""
        offset = self._offset
        for column in columns:
            expected = predicted[column] + offset[column]
            error = found[column] - expected
            found[column] = expected + GAIN[column] * error
            offset[column] += OFFSET_GAIN[column] * error

    def advance(self, psi: Array, applied: ControlInput, curvature_per_m: float) -> None:
        """Begin a roll-out at the lifted state (n,) of this period; advance all by the next one.

        `applied` acts in it. If a roll-out has begun ten periods ago, its error changes the
        disturbance.
        """
        oldest = (self._newest + 1) % STEPS
        if self._begun >= STEPS:
            error = psi[OBSERVED] - self._psi[oldest, OBSERVED]
            self.disturbance[OBSERVED] += self._gains @ error
            np.clip(
                self.disturbance, -LARGEST_DISTURBANCE, LARGEST_DISTURBANCE, out=self.disturbance
            )
        self._newest = oldest
        self._psi[oldest] = psi
        self._begun += 1
        self._psi = self.step(self._psi, applied, curvature_per_m)
        self._is_advanced = True

    def step(self, psi: Array, applied: ControlInput, curvature_per_m: float) -> Array:
        """Lifted states (..., n) a period after psi (..., n), with the disturbance."""
        self._inputs[:-1] = *applied, curvature_per_m
        following = self._step(psi, self._inputs)
        following[..., :N_STATES] += self.disturbance
        return following


def _response(jacobian: Array) -> Array:
    """(5, 5), derivative of the observed states after `STEPS` periods by a constant disturbance."""
    response = np.zeros((len(jacobian), N_STATES))
    for _ in range(STEPS):
        response = jacobian @ response
        response[:N_STATES] += np.eye(N_STATES)
    return response[np.ix_(OBSERVED, OBSERVED)]
