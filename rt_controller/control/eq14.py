"""Eq. (14) of the paper as a condensed QP over the inputs of the horizon, in the paper's letters.

    minimise    sum_k (x_k - x_r,k)' Q (x_k - x_r,k) + u_k' R u_k + (u_k - u_k-1)' S (u_k - u_k-1)
    subject to  psi_k+1 = A psi_k + B_uc u_k + B_uw kappa + c + sum_r N_r g_r(psi_k) f_r,
                u_min <= u_k <= u_max,  |u_k - u_k-1| <= the slew rate

The inputs are straight lines between K knots: U = T (scale v), and the QP is over z = [v; s] with
the slacks s of the corridor. The lifted states are eliminated, so its size does not depend on their
number. Once a period the model is linearised along the last plan (one iteration of a sequential
quadratic program), from the derivative of one step,

    J_k = [A + N W_k S | B + N t_k],  by psi_k and by [u_k; kappa]

with W = diag(f t'), and t in the column of the factor f of its gain. The path has derivatives of
its own, by kinematics.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import (
    N_INPUTS,
    N_STATES,
    PATH_STATES,
    ControlInput,
    InputColumn,
    StateColumn,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.knots import Knots, place_knots
from rt_controller.control.pedals import Pedal, PedalChoice, limit_pedals
from rt_controller.control.program import QuadraticProgram
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Step
from rt_controller.model.path_kinematics import PathDerivatives

Heading = Literal["course", "epsi"]
SLOWEST_MPS = 3.0
"""the course of a slower car is computed with this speed"""
RELEASED = 0.15
"""share of the range of a pedal below which it is released"""


class TrackingCost(NamedTuple):
    """Deviations that each cost one unit (Bryson's rule): a weight is 1 / tolerance^2.

    An infinite tolerance is a weight of zero.
    """

    state: VehicleState
    """tolerated deviation from the reference at one stage: Q of eq. (14)"""
    control: ControlInput
    """tolerated size of an input: R of eq. (14)"""
    control_change: ControlInput
    """tolerated change of an input from one period to the next"""
    terminal_factor: float = 1.0
    """Q_N = terminal_factor * Q"""
    heading: Heading = "course"
    """which angle follows the direction of the path, with the tolerance of epsi_rad"""


class Corridor(NamedTuple):
    """Soft bounds on the distance from the path."""

    half_width_m: float
    beyond_m: float
    """excess that costs as much as a tolerated deviation of a state"""


class Linearisation:
    """The model along nominal inputs: the lifted states, and the Jacobian of every stage."""

    def __init__(self, bundle: Bundle, horizon: int, tracked: Sequence[int]) -> None:
        """Over `horizon` stages; `tracked`: columns of the states whose derivatives are needed."""
        self._gains = gains = Step(bundle)
        n, q = gains.N.shape
        self._path: PathDerivatives | None = None
        if bundle.movement is not None:
            used = {StateColumn.ey_m, StateColumn.epsi_rad, *tracked}
            used &= {*list(StateColumn)[PATH_STATES]}
            self._path = PathDerivatives(bundle.movement, sorted(used), horizon)
        self.is_linear = q == 0 and self._path is None
        self._gains_of = [np.flatnonzero(gains.factors == f) for f in range(N_INPUTS + 1)]
        """those that [u; kappa] is the factor of"""
        self._N_W = np.zeros((horizon, n, q))
        self._inputs = np.ones((horizon, N_INPUTS + 2))
        """[u; kappa; 1] of each stage"""
        self.psi = np.zeros((horizon + 1, n))
        """(N + 1, n), predicted along the nominal inputs"""
        self.J = np.zeros((horizon, n, n + N_INPUTS + 1))
        """(N, n, n + 4), derivatives of psi_k+1 by psi_k and by [u_k; kappa]"""
        self.J[:] = np.hstack([gains.A, gains.B[:, : N_INPUTS + 1]])

    def update(self, psi_0: Array, u: Array, kappa: float) -> None:
        """Predict from psi_0 (n,) under inputs (N, 3), and linearise there."""
        gains, psi, inputs, J = self._gains, self.psi, self._inputs, self.J
        psi[0], inputs[:, :N_INPUTS], inputs[:, N_INPUTS] = psi_0, u, kappa
        t = gains.along(inputs, psi)
        n, q = gains.N.shape
        if q:
            slope = np.ones(t.shape)
            slope[:, gains.first_saturating :] -= np.square(t[:, gains.first_saturating :])
            W = inputs[:, gains.factors] * slope
            np.multiply(gains.N, W[:, None], out=self._N_W)
            by_psi = np.dot(self._N_W.reshape(-1, q), gains.S).reshape(len(J), n, n)
            np.add(by_psi, gains.A, out=J[..., :n])
            for column, own in enumerate(self._gains_of):
                if len(own):
                    by_input = np.dot(t[:, own], gains.N[:, own].T)
                    np.add(by_input, gains.B[:, column], out=J[..., n + column])
        if self._path is not None:
            path = self._path.columns
            J[:, path, :n], J[:, path, -1] = self._path.along(psi, kappa)


class CondensedQp:
    """The QP of one period; all of its arrays are allocated once.

    A period writes `psi_0`, `kappa`, `u_prev` and `x_r`, and calls `update_vectors` and
    `update_bounds`. H depends on the linearisation: `update_matrices` before it.

    Raises:
        ArtifactError: the bundle's model makes the problem non-convex or not finite.

    Paper: eq. (14), with the bilinear model that its conclusion names.
    """

    def __init__(
        self,
        bundle: Bundle,
        horizon: int,
        cost: TrackingCost,
        corridor: Corridor | None = None,
        knots: int | None = None,
    ) -> None:
        """`knots` over `horizon` periods, as of `place_knots`."""
        self.knots = place_knots(horizon, knots)
        K, n = self.knots.count, bundle.n_observables
        self.psi_0 = np.zeros(n)
        """(n,), where the horizon begins"""
        self.kappa = 0.0
        """curvature in 1/m, constant over the horizon"""
        self.u_prev = np.zeros(N_INPUTS)
        """(3,), the input of the last period"""
        self.x_r = np.zeros((K + 1, N_STATES))
        """(K + 1, 6), reference states at the knots and at the end of the horizon"""
        self.u_nominal = np.zeros((K, N_INPUTS))
        """(K, 3), the inputs at the knots along which the model is linearised"""
        self.T = self.knots.interpolation
        """(N, K), from the inputs at the knots to those of all stages"""
        self._choose_outputs(cost)
        self.linearisation = Linearisation(bundle, self.knots.horizon, self.columns)
        s = len(self.columns)
        self._Y = np.zeros((horizon + 1, (K + 1) * s, n + N_INPUTS + 1))
        """(N + 1, (K + 1) s, n + 4), derivatives of the states in `columns` at the knots and at the
        end, by psi and [u; kappa] of each stage; at the stage of a knot the rows of the identity"""
        for i, stage in enumerate((0, *self.knots.ends)):
            self._Y[stage, i * s : (i + 1) * s, :n] = np.eye(n)[self.columns]
        self._bound_inputs(bundle)
        self.R, self.from_previous = _cost_of_inputs(cost, self.knots, self.scale)
        self.matrices_vary = self.has_course or not self.linearisation.is_linear
        if self.matrices_vary:
            require_convex(self.R)  # then H is convex for every state
        self.program = self._assemble(corridor)
        self._check_at_typical_state(bundle)

    def _choose_outputs(self, cost: TrackingCost) -> None:
        """The outputs of a stage: the states that have a weight, e_y, and the heading or course.

        The course is the change of e_y in an interval over the distance travelled. With it the
        lateral error and the direction of motion have no conflict, whatever the sideslip of the car
        and the offset of its sensors are.
        """
        with np.errstate(over="ignore"):  # no weight, as an infinite tolerance
            weights = 1.0 / np.square(np.array(cost.state, dtype=float))
        ey, epsi, vx = StateColumn.ey_m, StateColumn.epsi_rad, StateColumn.vx_mps
        self.has_course = bool(cost.heading == "course" and weights[epsi] > 0.0)
        """the course is the last output, in place of epsi"""
        columns = [c for c in StateColumn if weights[c] > 0.0 or c is ey]
        if self.has_course:
            columns.remove(epsi)
        self.columns = columns
        self._ey = columns.index(ey)
        self._vx = columns.index(vx) if vx in columns else None
        # A state counts for all periods of its interval.
        Q = self.knots.intervals[:, None] * weights[[*columns, *[epsi] * self.has_course]]
        Q[-1] *= cost.terminal_factor
        self._shape = Q.shape
        """(K, p)"""
        self.Q = Q.reshape(-1)
        """(K p,), the diagonal of Q at the end of each interval between knots"""
        self._interval_s = PERIOD_S * self.knots.intervals
        self._length_m = np.ones(len(Q))
        """(K,), over which the course of each interval is computed"""

    def _bound_inputs(self, bundle: Bundle) -> None:
        """Bounds of v, and its largest changes between two knots. Paper: eq. (14)."""
        limits, K = (bundle.car or DEFAULT_CAR).limits, self.knots.count
        self.range: Array = np.subtract(INPUT_LIMITS.upper, INPUT_LIMITS.lower)
        """(3,), u = range * v"""
        self.scale = np.tile(self.range, K)
        """(nv,), the range of each number of v"""
        self.v_min, self.v_max = (np.array(u) / self.range for u in limits[:2])
        self.slew: Array = np.array(limits.rate_per_s) * PERIOD_S / self.range
        """(3,), largest change of v in a period"""
        self._usual_rate = limits.rate_per_s.steer_rad
        self._share_of_rate = 1.0
        self._slew = np.tile(self.slew, (K, 1))
        """(K, 3), largest change of v since the knot before; at the first since the last period"""
        self._slew[1:] *= self.knots.intervals[:-1, None]
        self._usual_slew = self._slew[:, InputColumn.steer_rad].copy()
        self._periods_to_knot = 1 + np.array(self.knots.stages)

    def _assemble(self, corridor: Corridor | None) -> QuadraticProgram:
        self._corridor = corridor
        nv, slacks = self.scale.size, 0 if corridor is None else self.knots.count
        self.H, self.f = np.zeros((nv, nv)), np.zeros(nv)
        P, q = self.H, self.f
        if corridor is not None:
            P, q = np.eye(nv + slacks) / corridor.beyond_m**2, np.zeros(nv + slacks)
        G = np.zeros((nv + slacks, nv + slacks))
        G[:nv, :nv] = np.eye(nv) - np.eye(nv, k=-N_INPUTS)
        G[nv:, nv:] = np.eye(slacks)
        pattern = G != 0.0
        pattern[nv:, :nv] = True
        varies = self.matrices_vary
        program = QuadraticProgram(P, q, G, pattern, varies, varies and slacks > 0)
        self._lower, self._upper, self._row_lower, self._row_upper = (
            bounds[:nv].reshape(-1, N_INPUTS)
            for bounds in (program.lower, program.upper, program.row_lower, program.row_upper)
        )
        self._lower[:], self._upper[:] = self.v_min, self.v_max
        self._row_lower[:], self._row_upper[:] = -self._slew, self._slew
        self._ey_lower, self._ey_upper = program.row_lower[nv:], program.row_upper[nv:]
        return program

    def update_matrices(self) -> None:
        """Update H (and G of a corridor), and the maps of f, along the nominal inputs.

        Around the nominal inputs the outputs are constant + Gamma v + Phi psi_0 + g kappa.
        """
        self.linearisation.update(self.psi_0, self.T @ self.u_nominal, self.kappa)
        self._propagate()
        x = self.linearisation.psi[[0, *self.knots.ends]]
        self._length_m[:] = np.maximum(x[1:, StateColumn.vx_mps], SLOWEST_MPS) * self._interval_s
        n, rows, states = len(self.psi_0), self.Q.size, (len(x), len(self.columns))
        by_input = self._Y[:-1, :, n:]
        by_u = by_input[..., :N_INPUTS].reshape(len(by_input), -1)
        by_v = np.dot(self.T.T, by_u).reshape(len(self.T.T), *states, N_INPUTS)
        by_v = by_v.transpose(1, 2, 0, 3)  # by knot and input
        self._Gamma = self._outputs(by_v).reshape(rows, -1) * self.scale
        self._Phi = self._outputs(self._Y[0, :, :n].reshape(*states, n)).reshape(rows, -1)
        by_kappa = by_input[..., N_INPUTS].sum(axis=0)
        self._g = self._outputs(by_kappa.reshape(states)).reshape(-1)
        v_nominal = self.u_nominal.reshape(-1) / self.scale
        self._constant = self._outputs(x[:, self.columns]).reshape(-1)
        self._constant -= self._Gamma @ v_nominal + self._Phi @ self.psi_0 + self._g * self.kappa
        self._Gamma_Q = self._Gamma.T * self.Q
        np.dot(self._Gamma_Q, self._Gamma, out=self.H)
        self.H += self.R
        if self._corridor is not None:
            nv = len(self.H)
            self.program.P[:nv, :nv] = self.H
            self.program.G[nv:, :nv] = self._of_stage(self._Gamma)[:, self._ey]

    def _propagate(self) -> None:
        """Derivatives of the states at the knots, by the adjoint equation y' <- y' J_k."""
        Y, J, n, s = self._Y, self.linearisation.J, len(self.psi_0), len(self.columns)
        first = len(self.knots.ends) + 1  # of the knots behind stage k
        for k in reversed(range(self.knots.horizon)):
            if k + 1 == self.knots.ends[first - 2]:
                first -= 1
            np.dot(Y[k + 1, first * s :, :n], J[k], out=Y[k, first * s :])

    def _outputs(self, x: Array) -> Array:
        """Outputs (K, p, ...) at the ends of the intervals, of states (K + 1, s, ...) at knots."""
        if not self.has_course:
            return x[1:]
        ey = x[:, self._ey]
        course = (ey[1:] - ey[:-1]) / self._length_m.reshape(-1, *[1] * (ey.ndim - 1))
        return np.concatenate((x[1:], course[:, None]), axis=1)

    def _of_stage(self, outputs: Array) -> Array:
        """(K, p, ...) of outputs (K p, ...)."""
        return outputs.reshape(*self._shape, *outputs.shape[1:])

    def update_vectors(self) -> None:
        """Update f, with the maps of the last `update_matrices`."""
        x_r = self._outputs(self.x_r[:, self.columns]).reshape(-1)
        self._d = self._Phi @ self.psi_0 + self._g * self.kappa + self._constant - x_r
        """(K p,), outputs less their references, for inputs v = 0"""
        np.dot(self._Gamma_Q, self._d, out=self.f)
        self.f[:N_INPUTS] += self.from_previous * self.u_prev
        if self._corridor is not None:
            # -half <= e_y - e_y,r + s <= half: one slack of an interval serves both sides.
            ey_m, half_m = self._of_stage(self._d)[:, self._ey], self._corridor.half_width_m
            self._ey_lower[:], self._ey_upper[:] = -ey_m - half_m, -ey_m + half_m
            self.program.q[: len(self.f)] = self.f

    def needed_mps2(self, pedal: Pedal) -> float:
        """Mean acceleration over the horizon that released pedals do not give, after the vectors.

        It leads the speed to its reference at the end of the horizon. 0 if the nominal plan
        presses `pedal` at its end: then this pedal gives what is needed, and the linearisation
        along the plan does not tell what an engine does whose throttle is closed.
        """
        is_pressed = self.u_nominal[-1, pedal] > RELEASED * self.range[pedal]
        if is_pressed or self._vx is None:
            return 0.0
        row = self._vx - self._shape[1]  # v_x at the end of the horizon
        steer = slice(InputColumn.steer_rad, None, N_INPUTS)
        steered = self._Gamma[row, steer] @ self.u_nominal[:, InputColumn.steer_rad]
        steered /= self.range[InputColumn.steer_rad]
        return -float(self._d[row] + steered) / (PERIOD_S * self.knots.horizon)

    def update_bounds(self, pedals: PedalChoice) -> None:
        """Update the bounds that depend on the input of the last period."""
        v_prev, slew = self.u_prev / self.range, self._slew[0]
        self._row_lower[0], self._row_upper[0] = v_prev - slew, v_prev + slew
        limit_pedals(self._upper, self._periods_to_knot, pedals, v_prev, slew, self.v_max)

    def limit_steering(self, most_rad: float, rate_radps: float, factor: float = 1.0) -> None:
        """Bound the wheel to ±`most_rad`, and its changes by a rate below the usual one.

        `factor`: that of `SteeringFactor`, by which the wheel of the model turns further.
        """
        steer = InputColumn.steer_rad
        self._upper[:, steer] = factor * most_rad / self.range[steer]
        self._lower[:, steer] = -self._upper[:, steer]
        share = factor * min(rate_radps / self._usual_rate, 1.0)
        if share == self._share_of_rate:
            return
        self._share_of_rate = share
        self._slew[:, steer] = share * self._usual_slew
        self._row_lower[1:], self._row_upper[1:] = -self._slew[1:], self._slew[1:]

    def _check_at_typical_state(self, bundle: Bundle) -> None:
        self.psi_0[:] = np.mean(bundle.selftest_psi, axis=0)
        with np.errstate(all="ignore"):
            self.update_matrices()
            self.update_vectors()
            self.update_bounds(PedalChoice())
        if not (np.isfinite(self.program.P).all() and self.program.has_finite_vectors()):
            raise ArtifactError(
                "The model's prediction over the horizon is not finite: expected a model that "
                "stays bounded, found one that overflows. Train again, or shorten `mpc.horizon`."
            )
        require_convex(self.program.P)


def require_convex(H: Array) -> None:
    """Refuse a Hessian H that is not positive definite."""
    smallest = float(np.linalg.eigvalsh(H)[0])
    if smallest <= 0.0:
        raise ArtifactError(
            f"The QP is not strictly convex: expected a positive smallest eigenvalue of its "
            f"Hessian, found {smallest:.3g}. Give every input a finite tolerance of change in "
            f"`mpc.tolerance`."
        )


def _cost_of_inputs(cost: TrackingCost, knots: Knots, scale: Array) -> tuple[Array, Array]:
    """H (nv, nv) and f (3,) of 1/2 v' H v + (f * u_prev)' v_0: inputs and their changes.

    Paper: eq. (14), with the cost of changes added.
    """
    to_stages = np.kron(knots.interpolation, np.eye(N_INPUTS)) * scale
    """(3 N, nv), v -> the inputs of all stages"""
    change = to_stages - np.vstack([np.zeros((N_INPUTS, scale.size)), to_stages[:-N_INPUTS]])
    R, S = (
        np.tile(1.0 / np.square(np.array(tolerance, dtype=float)), knots.horizon)
        for tolerance in (cost.control, cost.control_change)
    )
    # u_prev enters the change of the first stage only: -S (u_0 - u_prev).
    from_previous = -S[:N_INPUTS] * scale[:N_INPUTS]
    return (to_stages.T * R) @ to_stages + (change.T * S) @ change, from_previous
