"""The MPC problem of eq. (14) as a condensed QP, over the inputs of the horizon."""

from math import inf
from typing import NamedTuple

import numpy as np

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import N_INPUTS, InputColumn
from rt_controller.control.knots import place_knots
from rt_controller.control.linearisation import ALL_INPUTS
from rt_controller.control.objective import Objective, require_convex
from rt_controller.control.pedals import PedalChoice, limit_pedals
from rt_controller.control.program import QpParameters, QuadraticProgram
from rt_controller.control.terms import (
    Corridor,
    InputConstraints,
    TrackingCost,
    constrain_inputs,
    cost_terms,
)
from rt_controller.model.bundle import Bundle


class Features(NamedTuple):
    """Constraints beyond those of the paper, which bounds the inputs only."""

    has_slew_rows: bool = True
    """changes of the inputs are bounded too"""
    corridor: Corridor | None = None
    """soft bounds on e_y"""


WITH_SLEW = Features()


class CondensedQp:
    """Eq. (14) over z = [v; s]: v the inputs at K knots in units of their ranges, s the slacks.

    The states are eliminated, so the size does not depend on the number of latents. Between the
    knots the inputs are straight lines. Allocated once; a period writes `parameters` and calls
    `update_vectors`. Where the matrices depend on the parameters too, they are those of the last
    `update_matrices`.

    Raises:
        ArtifactError: the bundle's model makes the problem non-convex or not finite.

    Paper: eq. (14).
    """

    def __init__(
        self,
        bundle: Bundle,
        horizon: int,
        cost: TrackingCost,
        features: Features = WITH_SLEW,
        knots: int | None = None,
    ) -> None:
        """`knots` over `horizon` periods, as of `place_knots`."""
        self.knots = place_knots(horizon, knots)
        inputs = constrain_inputs(self.knots)
        terms = cost_terms(cost, inputs, self.knots)
        self.objective = Objective(bundle, terms)
        self.parameters = QpParameters(bundle.n_observables, self.knots)
        self.scale = inputs.scale
        """(nv,), the range of each input: u = scale * v"""
        self.interpolation = self.knots.interpolation
        """(N, K), from the knots to all stages"""
        self.program = _assemble(self.objective, inputs, features)
        self.matrices_vary = self.objective.hessian_varies
        self._periods_to_knot = 1 + np.array(self.knots.stages)
        self._all_slews = inputs.slew
        self._slew = inputs.slew[:N_INPUTS]
        self._usual_steering_slew = inputs.slew[InputColumn.steer_rad :: N_INPUTS].copy()
        self._steering_rate_radps = inf
        self._has_slew_rows = features.has_slew_rows
        self._lower = self.program.lower[: self.scale.size].reshape(-1, N_INPUTS)
        self._upper = self.program.upper[: self.scale.size].reshape(-1, N_INPUTS)
        self._corridor = features.corridor
        self._check_at_typical_state(bundle)

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """Bound the wheel to ±`most_rad`, and its changes by a rate below the usual one."""
        most = most_rad / self.scale[InputColumn.steer_rad]
        self._upper[:, InputColumn.steer_rad] = most
        self._lower[:, InputColumn.steer_rad] = -most
        if rate_radps == self._steering_rate_radps:
            return
        self._steering_rate_radps = rate_radps
        share = min(rate_radps / INPUT_LIMITS.rate_per_s.steer_rad, 1.0)
        of_wheel = slice(InputColumn.steer_rad, None, N_INPUTS)
        self._all_slews[of_wheel] = share * self._usual_steering_slew
        if self._has_slew_rows:
            rows = slice(N_INPUTS, self._all_slews.size)
            np.negative(self._all_slews[rows], out=self.program.row_lower[rows])
            self.program.row_upper[rows] = self._all_slews[rows]

    def update_matrices(self, used: slice = ALL_INPUTS) -> None:
        """Update P and G of `program` for the present parameters and the inputs that are used."""
        objective, program = self.objective, self.program
        objective.update_matrices(self.parameters, used)
        if self._corridor is not None:
            nv = self.scale.size
            program.P[:nv, :nv] = objective.H
            program.G[-self.knots.count :, :nv] = objective.ey_response

    def update_vectors(self, pedals: PedalChoice) -> None:
        """Update q and the bounds of `program` for the present parameters."""
        parameters, program = self.parameters, self.program
        self.objective.update_vectors(parameters)
        v_prev = parameters.previous / self.scale[:N_INPUTS]
        if self._has_slew_rows:
            np.subtract(v_prev, self._slew, out=program.row_lower[:N_INPUTS])
            np.add(v_prev, self._slew, out=program.row_upper[:N_INPUTS])
        limit_pedals(self._upper, self._periods_to_knot, pedals, v_prev, self._slew)
        if self._corridor is not None:
            # -half <= e_y - e_y,r + s <= half: one slack of an interval serves both sides.
            of_corridor = slice(-self.knots.count, None)
            lower, upper = program.row_lower[of_corridor], program.row_upper[of_corridor]
            np.negative(self.objective.ey_deviation_m, out=upper)
            np.subtract(upper, self._corridor.half_width_m, out=lower)
            upper += self._corridor.half_width_m
            program.q[: self.scale.size] = self.objective.gradient

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


def _assemble(
    objective: Objective, inputs: InputConstraints, features: Features
) -> QuadraticProgram:
    """The program, with everything written that `CondensedQp` does not update."""
    nv = inputs.scale.size
    slacks = 0 if features.corridor is None else nv // N_INPUTS
    slews = nv if features.has_slew_rows else 0
    P, q = objective.H, objective.gradient
    if features.corridor is not None:
        P, q = np.diag(np.full(nv + slacks, features.corridor.weight)), np.zeros(nv + slacks)
    G = np.zeros((slews + slacks, nv + slacks))
    G[:slews, :nv] = inputs.D[:slews]
    G[slews:, nv:] = np.eye(slacks)
    pattern = G != 0.0
    pattern[slews:, :nv] |= slacks > 0
    varies = objective.hessian_varies
    program = QuadraticProgram(P, q, G, pattern, varies, varies and slacks > 0)
    program.lower[:nv], program.upper[:nv] = inputs.lower, inputs.upper
    program.row_lower[:slews], program.row_upper[:slews] = -inputs.slew[:slews], inputs.slew[:slews]
    return program
