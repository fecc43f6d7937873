"""Solvers of the nonlinear program: CasADi's methods, compiled, and do-mpc."""

from collections.abc import Callable
from math import nan
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from benchmarks.peers.nonlinear.formulations import (
    N_MOTION,
    Condensed,
    NmpcParameters,
    NonlinearProgram,
    Stagewise,
    period_function,
    weights_of,
)
from rt_controller.contract.arrays import Array
from rt_controller.contract.schema import N_INPUTS
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.knots import place_knots
from rt_controller.control.terms import TrackingCost, constrain_inputs

COMPILED = {
    "jit": True,
    "compiler": "shell",
    "jit_options": {"flags": ["-O3", "-march=native"], "compiler": "gcc"},
}
UNTIL_CONVERGED, ONE = 20, 1
"""QPs a period; one is the real-time iteration"""

QRQP = {"print_iter": False, "print_header": False, "print_info": False}
HPIPM = {"hpipm": {"mode": "speed"}}
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-5,
    "warm_start_init_point": "yes",
    "mu_init": 1e-3,
}


class Method(NamedTuple):
    """A formulation and a solver with its options."""

    name: str
    formulation: Callable[[int, TrackingCost], NonlinearProgram]
    plugin: str
    options: dict[str, Any]
    is_gauss_newton: bool = True

    def compile(self, program: NonlinearProgram) -> ca.Function:
        options = {"print_time": False, "error_on_fail": False, **self.options, **COMPILED}
        if self.is_gauss_newton:
            options["hess_lag"] = program.hessian
        return ca.nlpsol("nmpc", self.plugin, program.functions, options)


def _sqp(qpsol: str, qpsol_options: dict[str, Any], iterations: int) -> dict[str, Any]:
    return {
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "qpsol": qpsol,
        "qpsol_options": {"error_on_fail": False, "print_time": False, **qpsol_options},
        "max_iter": iterations,
        "max_iter_ls": 0,
        "tol_pr": 1e-5,
        "tol_du": 1e-4,
    }


METHODS = (
    Method("CasADi SQP, stages, qrqp", Stagewise, "sqpmethod", _sqp("qrqp", QRQP, UNTIL_CONVERGED)),
    Method("CasADi RTI, stages, qrqp", Stagewise, "sqpmethod", _sqp("qrqp", QRQP, ONE)),
    Method("CasADi RTI, stages, HPIPM", Stagewise, "sqpmethod", _sqp("hpipm", HPIPM, ONE)),
    Method(
        "CasADi SQP, condensed, DAQP", Condensed, "sqpmethod", _sqp("daqp", {}, UNTIL_CONVERGED)
    ),
    Method("CasADi RTI, condensed, DAQP", Condensed, "sqpmethod", _sqp("daqp", {}, ONE)),
    Method("CasADi IPOPT, stages", Stagewise, "ipopt", {"ipopt": IPOPT}, False),
)


ACCEPTED_GAP = 1e-2
"""between the stages of a plan, in the units of the states"""


class CasadiSolver:
    """One of the methods, which starts from the last plan and its multipliers."""

    def __init__(self, method: Method, horizon: int, cost: TrackingCost) -> None:
        self._program = program = method.formulation(horizon, cost)
        function = method.compile(program)
        size, rows = program.z.size, program.row_lower.size
        self._bound_multipliers, self._row_multipliers = np.zeros(size), np.zeros(rows)
        self._results = {
            "x": np.full(size, nan),
            "g": np.full(rows, nan),
            "lam_x": np.zeros(size),
            "lam_g": np.zeros(rows),
        }
        arguments = {
            "x0": program.z,
            "p": program.parameters,
            "lbx": program.lower,
            "ubx": program.upper,
            "lbg": program.row_lower,
            "ubg": program.row_upper,
            "lam_x0": self._bound_multipliers,
            "lam_g0": self._row_multipliers,
        }
        self._buffer: Any  # owns what `_run` reads and writes
        self._buffer, self._run = function.buffer()
        for index, name in enumerate(function.name_in()):
            self._buffer.set_arg(index, arguments[name].data)
        for index, name in enumerate(function.name_out()):
            if name in self._results:
                self._buffer.set_res(index, self._results[name].data)

    def solve(self, parameters: NmpcParameters, inputs: Array) -> bool:
        """Write the plan (N, 3) into `inputs`, in physical units; True if it can be used."""
        program, results = self._program, self._results
        program.update_vectors(parameters)
        self._run()
        program.z[:] = results["x"]
        self._bound_multipliers[:] = results["lam_x"]
        self._row_multipliers[:] = results["lam_g"]
        program.read_inputs(inputs)
        g = results["g"]
        gap = np.maximum(g - program.row_upper, program.row_lower - g).max()
        return bool(np.isfinite(inputs).all() and gap < ACCEPTED_GAP)


class DompcSolver:
    """`CasadiSolver` by do-mpc: compiled IPOPT, started from the last solution."""

    def __init__(self, horizon: int, cost: TrackingCost) -> None:
        import do_mpc  # slow, and warns about optional parts

        bounds = constrain_inputs(place_knots(1, 1))
        self._scale, self._horizon = bounds.scale, horizon
        weights = weights_of(cost, horizon, bounds.scale)
        if not np.array_equal(weights.motion[0], weights.motion[-1]):
            raise ValueError("expected a terminal factor of 1, found another one.")
        model = do_mpc.model.Model("discrete", "MX")
        x = model.set_variable("_x", "motion", (N_MOTION, 1))
        previous = model.set_variable("_x", "previous", (N_INPUTS, 1))
        change = model.set_variable("_u", "change", (N_INPUTS, 1))
        model.set_variable("_tvp", "reference", (N_MOTION, 1))
        model.set_variable("_tvp", "upper", (N_INPUTS, 1))
        kappa = model.set_variable("_tvp", "kappa", (1, 1))
        model.set_rhs("motion", period_function(bounds.scale)(x, previous + change, kappa))
        model.set_rhs("previous", previous + change)
        model.setup()

        mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon = horizon
        mpc.settings.t_step = PERIOD_S
        mpc.settings.store_full_solution = False
        mpc.settings.nlpsol_opts = {
            **{f"ipopt.{key}": value for key, value in IPOPT.items()},
            "print_time": False,
            **COMPILED,
        }
        # The model's own symbols exist only after its setup.
        error = model.x["motion"] - model.tvp["reference"]
        change = model.u["change"]
        v = model.x["previous"] + change
        deviation = ca.dot(ca.DM(weights.motion[0]), error**2)
        sizes = ca.dot(ca.DM(weights.inputs), v**2) + ca.dot(ca.DM(weights.changes), change**2)
        mpc.set_objective(mterm=0.5 * deviation, lterm=0.5 * deviation + 0.5 * sizes)
        mpc.set_rterm(change=np.zeros(N_INPUTS))
        mpc.bounds["lower", "_u", "change"] = -bounds.slew
        mpc.bounds["upper", "_u", "change"] = bounds.slew
        mpc.bounds["lower", "_x", "previous"] = bounds.lower
        mpc.bounds["upper", "_x", "previous"] = bounds.upper
        mpc.set_nl_cons("upper", v - model.tvp["upper"], ub=0.0)
        self._template: Any = mpc.get_tvp_template()
        mpc.set_tvp_fun(lambda _: self._template)
        mpc.setup()
        self._mpc, self._has_guess = mpc, False

    def solve(self, parameters: NmpcParameters, inputs: Array) -> bool:
        last = self._horizon - 1
        for k in range(self._horizon + 1):
            self._template["_tvp", k, "reference"] = parameters.reference[min(max(k - 1, 0), last)]
            self._template["_tvp", k, "upper"] = parameters.upper[min(k, last)]
            self._template["_tvp", k, "kappa"] = parameters.curvature_per_m
        start = np.concatenate([parameters.motion, parameters.previous])
        if not self._has_guess:
            self._mpc.x0 = start
            self._mpc.set_initial_guess()
            self._has_guess = True
        self._mpc.make_step(start)
        plan = self._mpc.opt_x_num["_x", 1:, 0, 0, "previous"]
        inputs[:] = np.array([np.array(v).ravel() for v in plan])[: self._horizon] * self._scale
        return bool(self._mpc.solver_stats["success"])
