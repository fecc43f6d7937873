"""The MPC problem of eq. (14) as a condensed QP, over the inputs of the horizon."""

from math import inf

import numpy as np

from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import N_INPUTS, InputColumn
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.linearisation import ALL_INPUTS
from rt_controller.control.objective import Objective, QpParameters, require_convex
from rt_controller.control.pedals import Pedal, PedalChoice, limit_pedals
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.terms import Corridor, TrackingCost, bound_inputs, place_knots
from rt_controller.model.bundle import Bundle

RELEASED = 0.15
"""share of the range of a pedal below which it is released"""


class CondensedQp:
    """Eq. (14) over z = [v; s]: v the inputs at K knots in units of their ranges, s the slacks.

    The states are eliminated, so the size does not depend on the number of latents. Between the
    knots the inputs are straight lines. Their changes are bounded too, and with a corridor e_y
    softly. Allocated once; a period writes `parameters` and calls `update_vectors`. Where the
    matrices depend on the parameters too, they are those of the last `update_matrices`.

    Raises:
        ArtifactError: the bundle's model makes the problem non-convex or not finite.

    Paper: eq. (14).
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
        limits = (bundle.car or DEFAULT_CAR).limits
        inputs = bound_inputs(self.knots, limits)
        self.scale = inputs.scale.reshape(-1)
        """(nv,), the range of each input: u = scale * v"""
        self.interpolation = self.knots.interpolation
        """(N, K), from the knots to all stages"""
        self.parameters = QpParameters(bundle.n_observables, self.knots)
        self.objective = objective = Objective(bundle, cost, self.knots, self.scale)
        self.matrices_vary = objective.hessian_varies
        self._corridor = corridor
        self._slew, self._range = inputs.slew, self.scale[:N_INPUTS]
        self._usual_steering_slew = inputs.slew[:, InputColumn.steer_rad].copy()
        self._most_pedals = inputs.upper[0, :2].tolist()
        self._usual_radps, self._steering_rate_radps = limits.rate_per_s.steer_rad, inf
        self._periods_to_knot = 1 + np.array(self.knots.stages)

        nv, slacks = self.scale.size, 0 if corridor is None else self.knots.count
        P, q = objective.H, objective.gradient
        if corridor is not None:
            P, q = np.diag(np.full(nv + slacks, corridor.weight)), np.zeros(nv + slacks)
        G = np.zeros((nv + slacks, nv + slacks))
        G[:nv, :nv] = np.eye(nv) - np.eye(nv, k=-N_INPUTS)
        G[nv:, nv:] = np.eye(slacks)
        pattern = G != 0.0
        pattern[nv:, :nv] = True
        varies = objective.hessian_varies
        self.program = program = QuadraticProgram(P, q, G, pattern, varies, varies and slacks > 0)
        self._lower, self._upper, self._row_lower, self._row_upper = (
            bounds[:nv].reshape(-1, N_INPUTS)
            for bounds in (program.lower, program.upper, program.row_lower, program.row_upper)
        )
        self._lower[:], self._upper[:] = inputs.lower, inputs.upper
        self._row_lower[:], self._row_upper[:] = -inputs.slew, inputs.slew
        self._corridor_lower, self._corridor_upper = program.row_lower[nv:], program.row_upper[nv:]
        self._check_at_typical_state(bundle)

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """Bound the wheel to ±`most_rad`, and its changes by a rate below the usual one."""
        steer = InputColumn.steer_rad
        most = most_rad / self._range[steer]
        self._upper[:, steer] = most
        self._lower[:, steer] = -most
        if rate_radps == self._steering_rate_radps:
            return
        self._steering_rate_radps = rate_radps
        share = min(rate_radps / self._usual_radps, 1.0)
        self._slew[:, steer] = share * self._usual_steering_slew
        self._row_lower[1:], self._row_upper[1:] = -self._slew[1:], self._slew[1:]

    def update_matrices(self, used: slice = ALL_INPUTS) -> None:
        """Update P and G of `program` for the present parameters and the inputs that are used."""
        objective, program, nv = self.objective, self.program, self.scale.size
        objective.update_matrices(self.parameters, used)
        if self._corridor is not None:
            program.P[:nv, :nv] = objective.H
            program.G[nv:, :nv] = objective.ey_response

    def needed_mps2(self, pedal: Pedal) -> float:
        """Mean acceleration over the horizon that released pedals do not give, after matrices.

        It leads the speed to its reference at the end of the horizon. 0 if the nominal plan
        presses `pedal` at its end: then this pedal gives what is needed, and the linearisation
        along the plan does not tell what an engine does whose throttle is closed.
        """
        parameters = self.parameters
        if parameters.nominal_knots[-1, pedal] > RELEASED * self._range[pedal]:
            return 0.0
        horizon_s = PERIOD_S * self.knots.horizon
        return -self.objective.released_speed_error_mps(parameters) / horizon_s

    def update_vectors(self, pedals: PedalChoice) -> None:
        """Update q and the bounds of `program` for the present parameters."""
        self.objective.update_vectors(self.parameters)
        v_prev, slew = self.parameters.previous / self._range, self._slew[0]
        np.subtract(v_prev, slew, out=self._row_lower[0])
        np.add(v_prev, slew, out=self._row_upper[0])
        limit_pedals(self._upper, self._periods_to_knot, pedals, v_prev, slew, self._most_pedals)
        if self._corridor is not None:
            # -half <= e_y - e_y,r + s <= half: one slack of an interval serves both sides.
            lower, upper = self._corridor_lower, self._corridor_upper
            np.negative(self.objective.ey_deviation_m, out=upper)
            np.subtract(upper, self._corridor.half_width_m, out=lower)
            upper += self._corridor.half_width_m
            self.program.q[: self.scale.size] = self.objective.gradient

    def _check_at_typical_state(self, bundle: Bundle) -> None:
        self.parameters.psi[:] = np.mean(bundle.selftest_psi, axis=0)
        with np.errstate(all="ignore"):
            self.update_matrices()
            self.update_vectors(PedalChoice())
        if not (np.isfinite(self.program.P).all() and self.program.has_finite_vectors()):
            raise ArtifactError(
                "The model's prediction over the horizon is not finite: expected a model that "
                "stays bounded, found one that overflows. Train again, or shorten `mpc.horizon`."
            )
        require_convex(self.program.P)
