"""The MPC problem of eq. (14) as a condensed QP, over the inputs of the horizon."""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.schema import N_INPUTS, N_STATES
from rt_controller.contract.signals import StateColumn
from rt_controller.control.objective import Objective, free_response, require_convex
from rt_controller.control.pedals import PedalChoice, limit_pedals
from rt_controller.control.program import QpParameters, QuadraticProgram
from rt_controller.control.terms import (
    Corridor,
    InputConstraints,
    TrackingCost,
    constrain_inputs,
    cost_terms,
)


class Features(NamedTuple):
    """Constraints beyond those of the paper, which bounds the inputs only."""

    has_slew_rows: bool = True
    """changes of the inputs are bounded too"""
    corridor: Corridor | None = None
    """soft bounds on e_y"""


WITH_SLEW = Features()


class CondensedQp:
    """Eq. (14) over z = [v; s]: v the inputs of N stages in units of their ranges, s the slacks.

    The states are eliminated, so the size does not depend on the number of latents. Allocated
    once; a period writes `parameters` and calls `update_vectors`. With a bilinear model the
    matrices depend on the parameters too, and are those of the last `update_matrices`.

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
    ) -> None:
        inputs = constrain_inputs(horizon)
        terms = cost_terms(cost, inputs, bundle.n_observables - N_STATES)
        self.objective = Objective(bundle, terms)
        self.parameters = QpParameters(bundle.n_observables, horizon, terms.stage.size)
        self.scale = inputs.scale
        """(nv,), the range of each input: u = scale * v"""
        self.program = _assemble(self.objective, inputs, features)
        self.matrices_vary = self.objective.hessian_varies
        self._horizon = horizon
        self._slew = inputs.slew[:N_INPUTS]
        self._has_slew_rows = features.has_slew_rows
        self._upper = self.program.upper[: self.scale.size].reshape(horizon, N_INPUTS)
        self._corridor = (
            None if features.corridor is None else CorridorRows(bundle, horizon, features.corridor)
        )
        self._check_at_typical_state(bundle)

    def update_matrices(self) -> None:
        """Update P and G of `program` for the present parameters."""
        objective, program = self.objective, self.program
        objective.update_matrices(self.parameters)
        if self._corridor is not None:
            nv = self.scale.size
            program.P[:nv, :nv] = objective.H
            program.G[-self._horizon :, :nv] = objective.ey_response

    def update_vectors(self, pedals: PedalChoice) -> None:
        """Update q and the bounds of `program` for the present parameters."""
        parameters, program = self.parameters, self.program
        self.objective.update_vectors(parameters)
        v_prev = parameters.previous / self.scale[:N_INPUTS]
        if self._has_slew_rows:
            np.subtract(v_prev, self._slew, out=program.row_lower[:N_INPUTS])
            np.add(v_prev, self._slew, out=program.row_upper[:N_INPUTS])
        limit_pedals(self._upper, pedals, v_prev, self._slew)
        if self._corridor is not None:
            stages = slice(-self._horizon, None)
            self._corridor.update_vectors(
                parameters,
                self.objective.ey_drift,
                program.row_lower[stages],
                program.row_upper[stages],
            )
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


class CorridorRows:
    """-half <= e_y,k - e_y,r,k + s_k <= half for the stages k of a horizon.

    The slacks s_k are unbounded: one for each stage serves both sides, and is zero where the row
    holds without it.
    """

    def __init__(self, bundle: Bundle, horizon: int, corridor: Corridor) -> None:
        n_outputs = StateColumn.ey_m + 1
        free = free_response(bundle, horizon, n_outputs)
        self._free_response_map = np.ascontiguousarray(free[StateColumn.ey_m :: n_outputs])
        self._free_response_m = np.zeros(horizon)
        self._half_width_m = corridor.half_width_m

    def update_vectors(
        self, parameters: QpParameters, drift_m: Array | None, lower: Array, upper: Array
    ) -> None:
        """Write the bounds (N,) of the rows: metres that the inputs may add to e_y.

        `drift_m` (N,) is what the drift adds to it, if the model has one.
        """
        np.dot(self._free_response_map, parameters.initial, out=self._free_response_m)
        if drift_m is not None:
            self._free_response_m += drift_m
        np.subtract(parameters.reference[:, StateColumn.ey_m], self._free_response_m, out=upper)
        np.subtract(upper, self._half_width_m, out=lower)
        upper += self._half_width_m


def _assemble(
    objective: Objective, inputs: InputConstraints, features: Features
) -> QuadraticProgram:
    """The program, with everything written that `CondensedQp` does not update."""
    nv, horizon = inputs.scale.size, inputs.scale.size // N_INPUTS
    slacks = 0 if features.corridor is None else horizon
    slews = nv if features.has_slew_rows else 0
    P, q = objective.H, objective.gradient
    if features.corridor is not None:
        P, q = np.diag(np.full(nv + slacks, features.corridor.weight)), np.zeros(nv + slacks)
    G = np.zeros((slews + slacks, nv + slacks))
    G[:slews, :nv] = inputs.D[:slews]
    G[slews:, nv:] = np.eye(slacks)
    pattern = G != 0.0
    pattern[slews:, :nv] = np.arange(nv) // N_INPUTS <= np.arange(slacks)[:, None]
    varies = objective.hessian_varies
    program = QuadraticProgram(P, q, G, pattern, varies, varies and slacks > 0)
    program.lower[:nv], program.upper[:nv] = inputs.lower, inputs.upper
    program.row_lower[:slews], program.row_upper[:slews] = -inputs.slew[:slews], inputs.slew[:slews]
    return program
