"""Eq. (14) with a nonlinear car in place of the lifted model: what its posings share."""

from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from benchmarks.peers.nonlinear.single_track import STATES, one_period
from rt_controller.contract.bundle import Array
from rt_controller.contract.limits import InputLimits
from rt_controller.contract.signals import VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.cost import TrackingCost

N_MOTION = len(STATES)
TRACKED = [VehicleState._fields.index(name) for name in STATES]
"""columns of a reference; Delta s is left out, since on this model it follows from v_x"""


class Moment(NamedTuple):
    """What a tick knows. Inputs are in units of their ranges."""

    motion: Array
    """(5,) `STATES`"""
    previous: Array
    """(3,) the input in force until now"""
    ceilings: Array
    """(N, 3) of the inputs: the foot is on one pedal only"""
    reference: Array
    """(N, 5) `STATES` of stages 1 … N"""
    curvature_per_m: float


class NonlinearProgram(Protocol):
    """minimise f over z with bounds on z and g, all in memory that does not move."""

    functions: dict[str, ca.MX]
    """x, p, f and g, as CasADi's solvers take them"""
    hessian: ca.Function
    """Gauss-Newton's, exact but for the car's curvature, where an SQP looks for its own"""
    z: Array
    parameters: Array
    lower: Array
    upper: Array
    row_lower: Array
    row_upper: Array

    def aim(self, moment: Moment) -> None:
        """Make bounds and parameters those of this tick, and z the last solution one period on."""
        ...

    def read(self, inputs: Array) -> None:
        """Write the plan in z into `inputs` (N, 3)."""
        ...


class Weights(NamedTuple):
    """Of the squares that the cost adds up, each halved."""

    motion: Array
    """(N, 5)"""
    inputs: Array
    """(3,)"""
    changes: Array
    """(3,)"""


def weigh(cost: TrackingCost, horizon: int, span: Array) -> Weights:
    """The controller's own cost. `span` (3,) are the ranges of the inputs."""
    stage = 1.0 / np.square(np.array(cost.state)[TRACKED])
    motion = np.tile(stage, (horizon, 1))
    motion[-1] *= cost.terminal_factor
    return Weights(
        motion,
        np.square(span / np.array(cost.control)),
        np.square(span / np.array(cost.control_change)),
    )


class Bounds(NamedTuple):
    """Of an input and its change in one period, in units of ranges."""

    lower: Array
    upper: Array
    slew: Array
    span: Array
    """(3,) the ranges"""


def bounds_of(limits: InputLimits) -> Bounds:
    """The controller's own limits."""
    low, high = np.array(limits.lower), np.array(limits.upper)
    span = high - low
    return Bounds(low / span, high / span, np.array(limits.rate_per_s) * PERIOD_S / span, span)


def moving(span: Array) -> ca.Function:
    """(x, v, kappa) -> x one period on: compiled once and called for every stage."""
    x, v, kappa = ca.SX.sym("x", N_MOTION), ca.SX.sym("v", N_INPUTS), ca.SX.sym("kappa")
    return ca.Function("period", [x, v, kappa], [one_period(x, v * ca.DM(span), kappa, PERIOD_S)])


def as_hessian(functions: dict[str, ca.MX], of_cost: ca.MX) -> ca.Function:
    """`of_cost` under the names that CasADi gives the Hessian of a Lagrangian."""
    on_cost, on_rows = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", functions["g"].shape[0])
    return ca.Function(
        "gauss_newton",
        [functions["x"], functions["p"], on_cost, on_rows],
        [on_cost * of_cost],
        ["x", "p", "lam_f", "lam_g"],
        ["hess_gamma_x_x"],
    )
