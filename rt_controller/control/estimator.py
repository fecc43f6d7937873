"""Filtered state, steering factor and disturbance, from predictions of model and kinematics."""

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.kinematics import heading_change_rad, lateral_change_along_m
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import N_STATES, ControlInput, StateColumn, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.steering_factor import SteeringFactor
from rt_controller.model.bundle import Bundle
from rt_controller.model.roll_outs import STEPS, DrivenStep, OneStep, RollOuts

MOTION_GAIN = 0.12
"""share of what a prediction did not explain of v_y and yaw rate that becomes disturbance in one
period; the faster, the sooner a model that is wrong about the gain of its steering oscillates"""
FAST_MPS = 22.0
"""above this speed the share is multiplied by (FAST_MPS / v_x)^6, for the same car"""
SPEED_GAIN, PLACE_GAIN = 0.03, 0.04
"""the same of v_x, and of e_y and e_psi"""
MOVED = 0.03
"""share of its range that a pedal is from its average; more, and the error of v_x is that of its
engine or brake, not of a grade: learned from, it makes the pedal of a car oscillate whose engine is
not that of the model"""
KEPT = np.array(VehicleState(1.0, 0.95, 0.95, 0.0, 1.0, 1.0))
"""share of a deviation of each state that is left after one period: lateral motion is damped"""
LARGEST_DISTURBANCE = np.array(VehicleState(0.1, 0.1, 0.05, 0.0, 0.01, 0.005))
"""change of each state in one period"""

GAIN = VehicleState(1.0, 1.0, 0.7, 1.0, 0.05, 0.05)
"""share of the difference between the measured and the predicted state that is taken over in one
period: the noise of a sensor is averaged where the prediction is good. v_y is taken as measured:
its prediction is too early for a car that follows its wheel later, and that car oscillates"""
OFFSET_GAIN = VehicleState(0.0, 0.0, 0.0, 0.0, 0.001, 0.001)
"""the same of the offset of the prediction: with it a wrong model or a sensor with an offset leaves
no constant difference"""


def low_pass(motion_gain: float) -> VehicleState:
    """Share of what a prediction of each state did not explain that becomes disturbance."""
    return VehicleState(SPEED_GAIN, motion_gain, motion_gain, 0.0, PLACE_GAIN, PLACE_GAIN)


MOTION, PLACE = range(StateColumn.ey_m), range(StateColumn.ey_m, N_STATES)
"""columns predicted by the model and by kinematics"""


class DisturbanceResponse:
    """Deviation of the states after k periods of a constant disturbance, by kinematics.

    A disturbance changes each state in every period. Deviations of v_y and yaw rate fade; those of
    the yaw rate turn the car, and the heading and v_y move it sideways:

        e_psi+ = e_psi + T r,  e_y+ = e_y + T (v_x e_psi + v_y)

    No model is asked: what a learned model answers to a change of a single state that its other
    observables contradict is arbitrary.
    """

    def __init__(self, periods: int) -> None:
        """For k = 0 .. `periods`."""

        def summed(terms: Array) -> Array:
            sums: Array = np.zeros(terms.shape)
            np.cumsum(terms[:-1], axis=0, out=sums[1:])
            return sums

        self._first = summed(KEPT ** np.arange(periods + 1)[:, None])
        """(periods + 1, 6), of each state by its own disturbance"""
        self._second = PERIOD_S * summed(self._first)
        self._third = PERIOD_S * summed(self._second)

    def at(self, k: NDArray[np.int64] | int, disturbance: Array, vx_mps: float) -> Array:
        """Deviations (..., 6) after k (...) periods of a disturbance (6,)."""
        c, second, third = StateColumn, self._second[k], self._third[k]
        _, vy, yaw_rate, _, _, epsi = disturbance.tolist()
        found: Array = self._first[k] * disturbance
        found[..., c.epsi_rad] += second[..., c.yaw_rate_radps] * yaw_rate
        turned_rad = third[..., c.yaw_rate_radps] * yaw_rate + second[..., c.epsi_rad] * epsi
        found[..., c.ey_m] += second[..., c.vy_mps] * vy + vx_mps * turned_rad
        return found

    def cause(self, k: int, deviation: Array, vx_mps: float) -> Array:
        """The disturbance (6,) of which a deviation (6,) is left after k periods."""
        found: Array = deviation / np.maximum(self._first[k], 1.0)
        found[StateColumn.epsi_rad] = found[StateColumn.ey_m] = 0.0
        for column in (StateColumn.epsi_rad, StateColumn.ey_m):
            rest = deviation[column] - self.at(k, found, vx_mps)[column]
            found[column] = rest / self._first[k, column]
        return found


class Estimator:
    """State, steering factor and disturbance; one instance for a controller.

    The motion is predicted by the model, the place on the road by kinematics. The disturbance is
    what explains the error of a prediction over ten periods under the inputs that were applied:
    bank, wind, a grade, a road that is more slippery than those of the training, an offset of a
    sensor.
    """

    def __init__(
        self,
        bundle: Bundle,
        periods: int,
        motion_gain: float = MOTION_GAIN,
        step: OneStep | None = None,
    ) -> None:
        """`periods`: of the longest prediction asked of `deviations`.

        `step`: of a model that is not learned, in place of that of the bundle.
        """
        self.step = step or DrivenStep(bundle)
        self._roll_outs = RollOuts(bundle.n_observables, self.step)
        self._response = DisturbanceResponse(max(periods, STEPS))
        self._low_pass = np.array(low_pass(motion_gain))
        self.steering = SteeringFactor(motion_gain, learns_at_rate=step is not None)
        self._pedals = 0.0
        """throttle less brake, of their ranges, averaged over about ten periods"""
        self._is_advanced = False
        self._before: VehicleState | None = None
        self._offset = [0.0] * N_STATES
        """of the prediction of the next state"""
        self.disturbance = np.zeros(N_STATES)
        """(6,), change of the states in every period that the model does not predict"""

    def deviations(self, periods: NDArray[np.int64], vx_mps: float) -> Array:
        """What the disturbance adds to the states predicted after (K,) `periods`, (K, 6)."""
        return self._response.at(periods, self.disturbance, vx_mps)

    def forget(self) -> None:
        """A period is missing: the predictions end, and the disturbance stays."""
        self._roll_outs.begun = 0
        self._is_advanced = False

    def reset(self) -> None:
        """Another drive begins."""
        self.forget()
        self.disturbance[:] = 0.0
        self.steering.reset()
        self._pedals = 0.0

    def assume_steady(self, psi: Array, applied: ControlInput, curvature_per_m: float) -> None:
        """Take as disturbance what keeps the motion of a lifted state (n,) under this input.

        A driver who hands over may accelerate, so not the speed. A car with a heading error moves
        off its place on the road meanwhile: that is no disturbance.
        """
        predicted, of_model = psi, self.steering.of_model(applied)
        for _ in range(STEPS):
            predicted = self.step(predicted, of_model, curvature_per_m)
        error = (psi - predicted)[:N_STATES]
        now = VehicleState(*psi[:N_STATES].tolist())
        turned_rad = heading_change_rad(now, now, curvature_per_m, now.ds_m)
        error[StateColumn.epsi_rad] += STEPS * turned_rad
        mean_rad = now.epsi_rad + 0.5 * STEPS * turned_rad
        error[StateColumn.ey_m] += STEPS * lateral_change_along_m(now, now, mean_rad)
        error[StateColumn.vx_mps] = 0.0
        found = self._response.cause(STEPS, error, float(psi[StateColumn.vx_mps]))
        np.clip(found, -LARGEST_DISTURBANCE, LARGEST_DISTURBANCE, out=self.disturbance)

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
        predicted = (self._roll_outs.newest[:N_STATES] + self.disturbance).tolist()
        found = list(measured)
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

        `applied` acts in it. If a roll-out has begun ten periods ago, its error changes steering
        factor and disturbance.
        """
        pedals = applied.throttle - applied.brake_n / INPUT_LIMITS.upper.brake_n
        self._pedals += (pedals - self._pedals) / STEPS
        steady = 1.0 / (1.0 + ((pedals - self._pedals) / MOVED) ** 2)
        roll_outs = self._roll_outs
        if roll_outs.begun >= STEPS:
            predicted, yaw_rate = roll_outs.oldest[:N_STATES], StateColumn.yaw_rate_radps
            self.steering.learn(float(predicted[yaw_rate]), float(psi[yaw_rate]))
            error = psi[:N_STATES] - predicted
            found = self._response.cause(STEPS, error, float(psi[StateColumn.vx_mps]))
            change = self._low_pass * (found - self.disturbance)
            change[StateColumn.vx_mps] *= steady
            fast = FAST_MPS / max(float(psi[StateColumn.vx_mps]), FAST_MPS)
            change[[StateColumn.vy_mps, StateColumn.yaw_rate_radps]] *= fast**6
            self.disturbance += change
            np.clip(
                self.disturbance, -LARGEST_DISTURBANCE, LARGEST_DISTURBANCE, out=self.disturbance
            )
        roll_outs.begin(psi)
        self.steering.turn(applied.steer_rad)
        of_model = self.steering.of_model(applied)
        roll_outs.advance(roll_outs.after(of_model, curvature_per_m))
        self._is_advanced = True
