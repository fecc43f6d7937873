"""Posed without the states: single shooting, a small dense problem for active-set solvers."""

import casadi as ca
import numpy as np

from benchmarks.peers.nonlinear.program import (
    N_MOTION,
    Moment,
    as_hessian,
    bounds_of,
    moving,
    weigh,
)
from rt_controller.contract.bundle import Array
from rt_controller.contract.limits import InputLimits
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.cost import TrackingCost


class Condensed:
    """`NonlinearProgram` over z = [v_0, …, v_(N-1)] with g the changes of the inputs.

    p = [kappa; x_0; v_-1; x_r of stages 1 … N].
    """

    def __init__(self, horizon: int, cost: TrackingCost, limits: InputLimits) -> None:
        self._shape = (horizon, N_INPUTS)
        self._bounds = bounds_of(limits)
        weights = weigh(cost, horizon, self._bounds.span)
        period = moving(self._bounds.span)
        z = ca.MX.sym("z", horizon * N_INPUTS)
        kappa, start = ca.MX.sym("kappa"), ca.MX.sym("x", N_MOTION)
        before, wanted = ca.MX.sym("before", N_INPUTS), ca.MX.sym("wanted", horizon * N_MOTION)
        x, motion = start, []
        for k in range(horizon):
            x = period(x, z[k * N_INPUTS : (k + 1) * N_INPUTS], kappa)
            motion.append(x)
        changes = z - ca.vertcat(before, z[:-N_INPUTS])
        root = ca.DM(np.sqrt(weights.motion).reshape(-1))
        matters = np.flatnonzero(weights.motion.reshape(-1)).tolist()
        deviation = (root * (ca.vertcat(*motion) - wanted))[matters]
        on_inputs = ca.DM(np.tile(weights.inputs, horizon))
        on_changes = ca.DM(np.tile(weights.changes, horizon))
        direct = 0.5 * ca.dot(on_inputs, z**2) + 0.5 * ca.dot(on_changes, changes**2)
        J = ca.jacobian(deviation, z)
        p = ca.vertcat(kappa, start, before, wanted)
        named = ca.MX.sym("p", p.numel())
        total, rows, hessian = ca.substitute(
            [0.5 * ca.sumsqr(deviation) + direct, changes, J.T @ J + ca.hessian(direct, z)[0]],
            [kappa, start, before, wanted],
            ca.vertsplit(named, np.cumsum([0, 1, N_MOTION, N_INPUTS, wanted.numel()]).tolist()),
        )
        self.functions = {"x": z, "p": named, "f": total, "g": rows}
        self.hessian = as_hessian(self.functions, hessian)

        b = self._bounds
        self.z, self.parameters = np.zeros(z.numel()), np.zeros(p.numel())
        self.lower, self.upper = np.tile(b.lower, horizon), np.tile(b.upper, horizon)
        self.row_upper = np.tile(b.slew, horizon)
        self.row_lower = -self.row_upper

    def aim(self, moment: Moment) -> None:
        """As `NonlinearProgram.aim`."""
        self.z[:-N_INPUTS] = self.z[N_INPUTS:]
        self.upper[:] = moment.ceilings.reshape(-1)
        self.parameters[0] = moment.curvature_per_m
        self.parameters[1 : 1 + N_MOTION] = moment.motion
        self.parameters[1 + N_MOTION : 1 + N_MOTION + N_INPUTS] = moment.previous
        self.parameters[1 + N_MOTION + N_INPUTS :] = moment.reference.reshape(-1)

    def read(self, inputs: Array) -> None:
        """As `NonlinearProgram.read`."""
        np.multiply(self.z.reshape(self._shape), self._bounds.span, out=inputs)
