"""Posed with the states: multiple shooting, a sparse problem that solvers with stages like.

z = [x_0, v_-1, dv_0, x_1, v_0, dv_1, …, x_N, v_(N-1)]: a stage carries the input in force, its
control is the change, so that limits of both are bounds on single variables.
"""

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

N_STAGE = N_MOTION + N_INPUTS
N_BLOCK = N_STAGE + N_INPUTS
"""a stage and its control"""


class Stagewise:
    """`NonlinearProgram` with p = [kappa; x_r of stages 1 … N] and g the gaps between stages."""

    def __init__(self, horizon: int, cost: TrackingCost, limits: InputLimits) -> None:
        self._horizon = horizon
        self._bounds = bounds_of(limits)
        weights = weigh(cost, horizon, self._bounds.span)
        period = moving(self._bounds.span)
        z = ca.MX.sym("z", horizon * N_BLOCK + N_STAGE)
        p = ca.MX.sym("p", 1 + horizon * N_MOTION)
        gaps, total = [], ca.MX(0)
        for k in range(horizon):
            stage = z[k * N_BLOCK : (k + 1) * N_BLOCK]
            following = z[(k + 1) * N_BLOCK : (k + 1) * N_BLOCK + N_STAGE]
            x, change = stage[:N_MOTION], stage[N_STAGE:]
            v = stage[N_MOTION:N_STAGE] + change
            gaps += [period(x, v, p[0]) - following[:N_MOTION], v - following[N_MOTION:]]
            deviation = following[:N_MOTION] - p[1 + k * N_MOTION : 1 + (k + 1) * N_MOTION]
            total += 0.5 * ca.dot(ca.DM(weights.motion[k]), deviation**2)
            total += 0.5 * ca.dot(ca.DM(weights.inputs), following[N_MOTION:] ** 2)
            total += 0.5 * ca.dot(ca.DM(weights.changes), change**2)
        self.functions = {"x": z, "p": p, "f": total, "g": ca.vertcat(*gaps)}
        self.hessian = as_hessian(self.functions, ca.hessian(total, z)[0])

        size, rows = z.numel(), horizon * N_STAGE
        b, free = self._bounds, np.full(N_MOTION, np.inf)
        self.z, self.parameters = np.zeros(size), np.zeros(p.numel())
        self.lower = np.tile(np.concatenate([-free, b.lower, -b.slew]), horizon + 1)[:size]
        self.upper = np.tile(np.concatenate([free, b.upper, b.slew]), horizon + 1)[:size]
        self.row_lower, self.row_upper = np.zeros(rows), np.zeros(rows)

    def aim(self, moment: Moment) -> None:
        """As `NonlinearProgram.aim`."""
        self.z[:-N_BLOCK] = self.z[N_BLOCK:]
        given = np.concatenate([moment.motion, moment.previous])
        self.z[:N_STAGE] = self.lower[:N_STAGE] = self.upper[:N_STAGE] = given
        _inputs(self.upper, self._horizon)[:] = moment.ceilings
        self.parameters[0] = moment.curvature_per_m
        self.parameters[1:] = moment.reference.reshape(-1)

    def read(self, inputs: Array) -> None:
        """As `NonlinearProgram.read`."""
        np.multiply(_inputs(self.z, self._horizon), self._bounds.span, out=inputs)


def _inputs(z: Array, horizon: int) -> Array:
    """(N, 3), a view of v_0 … v_(N-1)."""
    return z[N_STAGE:].reshape(horizon, N_BLOCK)[:, -N_INPUTS:]
