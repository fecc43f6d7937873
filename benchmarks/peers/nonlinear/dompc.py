"""do-mpc with the same car, cost and limits: what its users would write."""

from typing import Any

import casadi as ca
import numpy as np

from benchmarks.peers.nonlinear.methods import COMPILED, IPOPT
from benchmarks.peers.nonlinear.program import N_MOTION, Moment, bounds_of, moving, weigh
from rt_controller.contract.bundle import Array
from rt_controller.contract.limits import InputLimits
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.cost import TrackingCost


class DoMpc:
    """`Planning` by do-mpc: IPOPT, compiled, from the last solution."""

    def __init__(self, horizon: int, cost: TrackingCost, limits: InputLimits) -> None:
        import do_mpc  # slow, and warns about parts that are not needed

        bounds = bounds_of(limits)
        self._span, self._shape = bounds.span, (horizon, N_INPUTS)
        weights = weigh(cost, horizon, bounds.span)
        if not np.array_equal(weights.motion[0], weights.motion[-1]):
            raise ValueError("expected a terminal factor of 1, found another one.")
        model = do_mpc.model.Model("discrete", "MX")
        x = model.set_variable("_x", "motion", (N_MOTION, 1))
        before = model.set_variable("_x", "before", (N_INPUTS, 1))
        change = model.set_variable("_u", "change", (N_INPUTS, 1))
        model.set_variable("_tvp", "wanted", (N_MOTION, 1))
        model.set_variable("_tvp", "ceiling", (N_INPUTS, 1))
        kappa = model.set_variable("_tvp", "kappa", (1, 1))
        model.set_rhs("motion", moving(bounds.span)(x, before + change, kappa))
        model.set_rhs("before", before + change)
        model.setup()

        mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon = horizon
        mpc.settings.t_step = PERIOD_S
        mpc.settings.store_full_solution = False
        mpc.settings.nlpsol_opts = {
            **{f"ipopt.{key}": value for key, value in IPOPT["ipopt"].items()},  # type: ignore[attr-defined]
            "print_time": False,
            **COMPILED,
        }
        # Only now do the model's own symbols exist.
        error = model.x["motion"] - model.tvp["wanted"]
        change = model.u["change"]
        v = model.x["before"] + change
        deviation = ca.dot(ca.DM(weights.motion[0]), error**2)
        sizes = ca.dot(ca.DM(weights.inputs), v**2) + ca.dot(ca.DM(weights.changes), change**2)
        mpc.set_objective(mterm=0.5 * deviation, lterm=0.5 * deviation + 0.5 * sizes)
        mpc.set_rterm(change=np.zeros(N_INPUTS))
        mpc.bounds["lower", "_u", "change"] = -bounds.slew
        mpc.bounds["upper", "_u", "change"] = bounds.slew
        mpc.bounds["lower", "_x", "before"] = bounds.lower
        mpc.bounds["upper", "_x", "before"] = bounds.upper
        mpc.set_nl_cons("ceiling", v - model.tvp["ceiling"], ub=0.0)
        self._template: Any = mpc.get_tvp_template()
        mpc.set_tvp_fun(lambda _: self._template)
        mpc.setup()
        self._mpc, self._is_begun = mpc, False

    def solve(self, moment: Moment, inputs: Array) -> bool:
        """As `Planning.solve`."""
        horizon = self._shape[0]
        for k in range(horizon + 1):
            self._template["_tvp", k, "wanted"] = moment.reference[min(max(k - 1, 0), horizon - 1)]
            self._template["_tvp", k, "ceiling"] = moment.ceilings[min(k, horizon - 1)]
            self._template["_tvp", k, "kappa"] = moment.curvature_per_m
        start = np.concatenate([moment.motion, moment.previous])
        if not self._is_begun:
            self._mpc.x0 = start
            self._mpc.set_initial_guess()
            self._is_begun = True
        self._mpc.make_step(start)
        plan = self._mpc.opt_x_num["_x", 1:, 0, 0, "before"]
        inputs[:] = np.array([np.array(v).ravel() for v in plan])[:horizon] * self._span
        return bool(self._mpc.solver_stats["success"])
