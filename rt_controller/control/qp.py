"""The paper's MPC as a condensed QP: objective and constraints over the inputs of the horizon."""

from dataclasses import dataclass

import numpy as np

from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import InputLimits
from rt_controller.control.bilinear_objective import BilinearObjective
from rt_controller.control.constraints import InputConstraints, constrain_inputs
from rt_controller.control.cost import TrackingCost, input_cost, output_weights
from rt_controller.control.objective import (
    ConstantObjective,
    Objective,
    Situation,
    require_convex,
)


@dataclass(frozen=True, slots=True)
class CondensedQp:
    """minimise 1/2 v' H v + f' v subject to bounds on v and D v, nv = 3 N variables."""

    objective: Objective
    constraints: InputConstraints
    situation: Situation
    """the memory that an objective is aimed from"""


def assemble(bundle: Bundle, horizon: int, cost: TrackingCost, limits: InputLimits) -> CondensedQp:
    """Build the QP of eq. (14), with a cost on input changes and slew rates added.

    It is aimed at a typical lifted state, the mean of the model's self-test.

    Raises:
        ArtifactError: the bundle's model makes the problem non-convex or not finite.

    Paper: eq. (14).
    """
    n, n_x = bundle.n_observables, len(bundle.schema.states)
    constraints = constrain_inputs(horizon, limits)
    inputs = input_cost(cost, constraints)
    outputs = output_weights(cost, n - n_x)
    objective = (
        ConstantObjective(bundle, outputs, constraints.scale, inputs)
        if bundle.bilinear is None
        else BilinearObjective(bundle, bundle.bilinear, outputs, constraints.scale, inputs)
    )
    situation = Situation(n, horizon, outputs.stage.size)
    situation.psi[:] = np.mean(bundle.selftest_psi, axis=0)
    with np.errstate(all="ignore"):
        objective.aim(situation)
    _require_finite(objective)
    require_convex(objective.H)
    return CondensedQp(objective, constraints, situation)


def _require_finite(objective: Objective) -> None:
    if not (np.all(np.isfinite(objective.H)) and np.all(np.isfinite(objective.gradient))):
        raise ArtifactError(
            "The model's prediction over the horizon is not finite: expected a model that stays "
            "bounded, found one that overflows. Train again, or shorten --mpc.horizon."
        )
