"""Objective of the condensed QP: 1/2 v' H v + f' v over the inputs v at the knots."""

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import N_INPUTS, N_STATES, InputColumn, StateColumn
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.linearisation import Linearisation
from rt_controller.control.terms import Knots, TrackingCost
from rt_controller.model.bundle import Bundle

SLOWEST_MPS = 3.0
"""the course of a slower car is computed with this speed"""


def require_convex(H: Array) -> None:
    """Refuse a Hessian H that is not positive definite."""
    smallest = float(np.linalg.eigvalsh(H)[0])
    if smallest <= 0.0:
        raise ArtifactError(
            f"The QP is not strictly convex: expected a positive smallest eigenvalue of its "
            f"Hessian, found {smallest:.3g}. Give every input a finite tolerance of change in "
            f"`mpc.tolerance`."
        )


class QpParameters:
    """What changes from one period to the next."""

    def __init__(self, n_observables: int, knots: Knots) -> None:
        self.psi = np.zeros(n_observables)
        """(n,), psi_0"""
        self.curvature_per_m = 0.0
        """kappa, constant over the horizon"""
        self.previous = np.zeros(N_INPUTS)
        """(3,), the input of the last period"""
        self.reference = np.zeros((knots.count + 1, N_STATES))
        """(K + 1, 6), reference states at the knots and at the end of the horizon"""
        self.nominal_knots = np.zeros((knots.count, N_INPUTS))
        """(K, 3), the inputs along which the model is linearised"""
        self.nominal_inputs = np.zeros((knots.horizon, N_INPUTS))
        """(N, 3), the same at all stages"""


class Objective:
    """The objective, computed in preallocated memory: H (nv, nv) and the gradient f (nv,).

    The outputs of a stage are the states that have a weight, e_y, and the heading or the course.
    The course is the change of e_y in a period over the distance travelled; with it the lateral
    error and the direction of motion have no conflict, whatever the sideslip of the car and the
    offset of its sensors are.

    Raises:
        ArtifactError: H changes, and the cost of the inputs alone is not strictly convex.

    Paper: eq. (14).
    """

    def __init__(self, bundle: Bundle, cost: TrackingCost, knots: Knots, scale: Array) -> None:
        """`scale` (nv,): the range of each input at the knots."""
        with np.errstate(over="ignore"):  # no weight, as an infinite tolerance
            stage = 1.0 / np.square(np.array(cost.state, dtype=float))
        ey, epsi = StateColumn.ey_m, StateColumn.epsi_rad
        self._has_course = bool(cost.heading == "course" and stage[epsi] > 0.0)
        """the course is the last output, in place of epsi"""
        self._columns = [c for c in StateColumn if stage[c] > 0.0 or c is ey]
        if self._has_course:
            self._columns.remove(epsi)
        self._ey = self._columns.index(ey)
        vx = StateColumn.vx_mps
        self._vx = self._columns.index(vx) if vx in self._columns else None
        self._steered_mps = 0.0
        """what the nominal steering adds to the last v_x"""
        # A state counts for all periods of its interval.
        weights = knots.intervals[:, None] * stage[[*self._columns, *[epsi] * self._has_course]]
        weights[-1] *= cost.terminal_factor
        self._scale, self._weights = scale, weights.reshape(-1)
        """(K p,), the diagonal of Q at the end of each interval between knots"""
        self._sqrt_weights = np.sqrt(self._weights)
        self._H_inputs, self._from_previous = _cost_of_inputs(cost, knots, scale)
        self._linearisation = Linearisation(bundle, knots, self._columns)
        self.hessian_varies = self._has_course or not self._linearisation.is_linear
        if self.hessian_varies:
            require_convex(self._H_inputs)  # then H is convex for every state
        n, nv, (K, p) = bundle.n_observables, scale.size, weights.shape
        self._at_knots = [0, *knots.ends]
        self._outputs = np.zeros((K, p))
        """of the nominal prediction"""
        self._by_inputs = np.zeros((K, p, N_INPUTS, K))
        self._by_curvature, self._by_psi = np.zeros((K, p)), np.zeros((K, p, n))
        self._gamma = np.zeros((nv, K * p))
        """derivatives of the outputs by v"""
        self._gamma_q = np.zeros((nv, K * p))
        self._constant, self._deviation = np.zeros(K * p), np.zeros(K * p)
        self._reference = np.zeros((K, p))
        self._interval_s = PERIOD_S * knots.intervals
        self.length_m = np.ones(K)
        """(K,), over which the course of each interval is computed"""
        self.H = np.zeros((nv, nv))
        self.gradient = np.zeros(nv)

    @property
    def ey_deviation_m(self) -> Array:
        """(K,), e_y less its reference at the end of each interval, for inputs v = 0."""
        return self._deviation.reshape(self._reference.shape)[:, self._ey]

    @property
    def ey_response(self) -> Array:
        """(K, nv), what the inputs add to e_y at the end of each interval, in metres."""
        return self._gamma.reshape(len(self._gamma), *self._reference.shape)[:, :, self._ey].T

    def update_matrices(self, parameters: QpParameters, used: slice) -> None:
        """Update H, and the maps of the gradient, around the parameters and nominal inputs.

        `used`: the inputs that are not bound to zero; H has no cost of states for the other ones.
        """
        linearisation, curvature = self._linearisation, parameters.curvature_per_m
        linearisation.update(parameters.psi, curvature, parameters.nominal_inputs, used)
        states = linearisation.observables[self._at_knots, :N_STATES]
        np.maximum(states[1:, StateColumn.vx_mps], SLOWEST_MPS, out=self.length_m)
        self.length_m *= self._interval_s
        self._to_outputs(states[1:, self._columns], states[0, StateColumn.ey_m], self._outputs)
        self._to_outputs(linearisation.by_inputs, 0.0, self._by_inputs)
        self._to_outputs(linearisation.by_curvature, 0.0, self._by_curvature)
        self._to_outputs(linearisation.by_psi, 0.0, self._by_psi)
        if self._has_course:
            self._by_psi[0, -1, StateColumn.ey_m] -= 1.0 / self.length_m[0]
        gamma = self._gamma
        by_inputs = self._by_inputs.transpose(3, 2, 0, 1).reshape(gamma.shape)
        np.multiply(by_inputs, self._scale[:, None], out=gamma)
        np.multiply(gamma, self._sqrt_weights, out=self._gamma_q)
        np.dot(self._gamma_q, self._gamma_q.T, out=self.H)
        self.H += self._H_inputs
        v = parameters.nominal_knots.reshape(-1) / self._scale
        constant = self._constant
        np.dot(self._by_psi.reshape(len(constant), -1), parameters.psi, out=constant)
        np.subtract(self._outputs.reshape(-1), constant, out=constant)
        constant -= v @ gamma
        if self._vx is not None:
            steer = slice(InputColumn.steer_rad, None, N_INPUTS)
            last = self._vx - self._by_psi.shape[1]
            self._steered_mps = float(v[steer] @ gamma[steer, last])
        constant -= curvature * self._by_curvature.reshape(-1)
        np.multiply(gamma, self._weights, out=self._gamma_q)

    def released_speed_error_mps(self, parameters: QpParameters) -> float:
        """v_x less its reference at the end of the horizon with both pedals released.

        Steered as nominal; 0 if the speed has no weight. With the maps of the last
        `update_matrices`.
        """
        if self._vx is None:
            return 0.0
        speed_mps = float(self._by_psi[-1, self._vx] @ parameters.psi) + self._steered_mps
        speed_mps += float(self._constant[self._vx - self._by_psi.shape[1]])
        speed_mps += parameters.curvature_per_m * float(self._by_curvature[-1, self._vx])
        return speed_mps - float(parameters.reference[-1, StateColumn.vx_mps])

    def update_vectors(self, parameters: QpParameters) -> None:
        """Update the gradient, with the maps of the last `update_matrices`."""
        deviation, reference = self._deviation, parameters.reference
        np.dot(self._by_psi.reshape(len(deviation), -1), parameters.psi, out=deviation)
        deviation += self._constant
        deviation += parameters.curvature_per_m * self._by_curvature.reshape(-1)
        ey_m = reference[0, StateColumn.ey_m]
        self._to_outputs(reference[1:, self._columns], ey_m, self._reference)
        deviation -= self._reference.reshape(-1)
        np.dot(self._gamma_q, deviation, out=self.gradient)
        self.gradient[:N_INPUTS] += self._from_previous * parameters.previous

    def _to_outputs(self, states: Array, first_ey_m: float, outputs: Array) -> None:
        """Write outputs (K, p, …) of the tracked states (K, s, …) at the ends of the intervals.

        `first_ey_m`: at the first knot.
        """
        c = len(self._columns)
        outputs[:, :c] = states
        if self._has_course:
            ey_m, course = states[:, self._ey], outputs[:, c]
            np.subtract(ey_m[1:], ey_m[:-1], out=course[1:])
            np.subtract(ey_m[:1], first_ey_m, out=course[:1])
            course /= self.length_m.reshape(-1, *[1] * (course.ndim - 1))


def _cost_of_inputs(cost: TrackingCost, knots: Knots, scale: Array) -> tuple[Array, Array]:
    """H (nv, nv) and f (3,) of 1/2 v' H v + (f * u_prev)' v_0: inputs and their changes.

    Paper: eq. (14), with the cost of changes added.
    """
    to_stages = np.kron(knots.interpolation, np.eye(N_INPUTS)) * scale
    """(3 N, nv), v -> the inputs of all stages"""
    change = to_stages - np.vstack([np.zeros((N_INPUTS, scale.size)), to_stages[:-N_INPUTS]])
    r, s = (
        np.tile(1.0 / np.square(np.array(tolerance, dtype=float)), knots.horizon)
        for tolerance in (cost.control, cost.control_change)
    )
    # u_prev enters the change of the first stage only: -s (u_0 - u_prev).
    from_previous = -s[:N_INPUTS] * scale[:N_INPUTS]
    return (to_stages.T * r) @ to_stages + (change.T * s) @ change, from_previous
