"""The paper's MPC as a condensed QP: objective and constraints over the inputs of the horizon."""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import InputLimits
from rt_controller.control.bilinear_objective import BilinearObjective
from rt_controller.control.constraints import N_INPUTS, InputConstraints, constrain_inputs
from rt_controller.control.corridor import Corridor, CorridorRows
from rt_controller.control.cost import OutputWeights, TrackingCost, input_cost, output_weights
from rt_controller.control.objective import (
    ConstantObjective,
    Objective,
    Situation,
    require_convex,
)
from rt_controller.control.pedals import PedalChoice, lower_ceilings
from rt_controller.control.program import QuadraticProgram


class Features(NamedTuple):
    """What the QP has beyond the paper's, which only bounds the inputs."""

    has_slew_rows: bool = True
    """changes of the inputs are bounded too"""
    corridor: Corridor | None = None
    """soft bounds on e_y"""


PAPER = Features(has_slew_rows=False)
"""eq. (14) as printed"""
WITH_SLEW = Features()


class CondensedQp:
    """Eq. (14) over z = [v; s]: v the inputs of N stages in units of their ranges, s the slacks.

    The states are not among the variables, so the size does not depend on the number of latents.
    Built once; a tick writes `situation` and calls `aim`. Where the matrices depend on it, they are
    those that `prepare` found: of this tick, or of what was expected of it the tick before.

    Raises:
        ArtifactError: the bundle's model makes the problem non-convex or not finite.

    Paper: eq. (14).
    """

    def __init__(
        self,
        bundle: Bundle,
        horizon: int,
        cost: TrackingCost,
        limits: InputLimits,
        features: Features = WITH_SLEW,
    ) -> None:
        inputs = constrain_inputs(horizon, limits)
        outputs = output_weights(cost, bundle.n_observables - len(bundle.schema.states))
        self.objective = _objective(bundle, outputs, inputs, cost, features)
        self.situation = Situation(bundle.n_observables, horizon, outputs.stage.size)
        """the memory that the QP is aimed from"""
        self.scale = inputs.scale
        """(nv,), the range of each input: u = scale * v"""
        self.program = _lay_out(self.objective, inputs, features)
        self.renews = self.program.renews
        self._first_slew = inputs.slew[:N_INPUTS]
        self._has_slew_rows = features.has_slew_rows
        self._ceilings = self.program.upper[: inputs.scale.size].reshape(horizon, N_INPUTS)
        self._corridor = (
            None if features.corridor is None else CorridorRows(bundle, horizon, features.corridor)
        )
        self._aim_at_a_typical_state(bundle)

    def prepare(self) -> None:
        """Build the matrices of `program` around the situation as it stands."""
        objective, program = self.objective, self.program
        objective.prepare(self.situation)
        if self._corridor is not None and objective.renews_hessian:
            nv, stages = self.scale.size, len(self._ceilings)
            program.P[:nv, :nv] = objective.H
            program.G[-stages:, :nv] = objective.lateral

    def aim(self, pedals: PedalChoice) -> None:
        """Make the vectors of `program` those of the situation as it stands."""
        now, program = self.situation, self.program
        self.objective.aim(now)
        start = now.previous / self.scale[:N_INPUTS]
        if self._has_slew_rows:
            np.subtract(start, self._first_slew, out=program.row_lower[:N_INPUTS])
            np.add(start, self._first_slew, out=program.row_upper[:N_INPUTS])
        lower_ceilings(self._ceilings, pedals, start, self._first_slew)
        if self._corridor is not None:
            stages = slice(-len(self._ceilings), None)
            self._corridor.aim(now, program.row_lower[stages], program.row_upper[stages])
            program.q[: self.scale.size] = self.objective.gradient

    def _aim_at_a_typical_state(self, bundle: Bundle) -> None:
        self.situation.psi[:] = np.mean(bundle.selftest_psi, axis=0)
        with np.errstate(all="ignore"):
            self.prepare()
            self.aim(PedalChoice())
        if not (np.isfinite(self.program.P).all() and self.program.has_finite_vectors()):
            raise ArtifactError(
                "The model's prediction over the horizon is not finite: expected a model that "
                "stays bounded, found one that overflows. Train again, or shorten --mpc.horizon."
            )
        require_convex(self.program.P)


def _objective(
    bundle: Bundle,
    outputs: OutputWeights,
    inputs: InputConstraints,
    cost: TrackingCost,
    features: Features,
) -> Objective:
    on_inputs = input_cost(cost, inputs)
    if bundle.bilinear is None:
        return ConstantObjective(bundle, outputs, inputs.scale, on_inputs)
    watches_lateral = features.corridor is not None
    return BilinearObjective(
        bundle, bundle.bilinear, outputs, inputs.scale, on_inputs, watches_lateral
    )


def _lay_out(
    objective: Objective, inputs: InputConstraints, features: Features
) -> QuadraticProgram:
    """The program with everything in place that no tick changes."""
    nv, horizon = inputs.scale.size, inputs.scale.size // N_INPUTS
    slacks = 0 if features.corridor is None else horizon
    slews = nv if features.has_slew_rows else 0
    P, q = objective.H, objective.gradient
    if features.corridor is not None:
        P, q = np.diag(np.full(nv + slacks, features.corridor.weight)), np.zeros(nv + slacks)
        P[:nv, :nv] = objective.H
    G = np.zeros((slews + slacks, nv + slacks))
    pattern = np.zeros(G.shape, dtype=bool)
    G[:slews, :nv] = inputs.D[:slews]
    pattern[:slews, :nv] = inputs.D[:slews] != 0.0
    G[slews:, :nv] = objective.lateral[:slacks]
    pattern[slews:, :nv] = np.arange(nv) // N_INPUTS <= np.arange(slacks)[:, None]
    G[slews:, nv:] = np.eye(slacks)
    pattern[slews:, nv:] = np.eye(slacks, dtype=bool)
    renews = objective.renews_hessian
    program = QuadraticProgram(P, q, G, pattern, renews, renews and slacks > 0)
    program.lower[:nv], program.upper[:nv] = inputs.lower, inputs.upper
    program.row_lower[:slews], program.row_upper[:slews] = -inputs.slew[:slews], inputs.slew[:slews]
    return program
