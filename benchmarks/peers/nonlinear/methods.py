"""CasADi's ways to solve the nonlinear program, compiled, each as fast as its options make it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca

from benchmarks.peers.nonlinear.condensed import Condensed
from benchmarks.peers.nonlinear.program import NonlinearProgram
from benchmarks.peers.nonlinear.stagewise import Stagewise
from rt_controller.contract.limits import InputLimits
from rt_controller.control.cost import TrackingCost

COMPILED = {
    "jit": True,
    "compiler": "shell",
    "jit_options": {"flags": ["-O3", "-march=native"], "compiler": "gcc"},
}
UNTIL_SMALL, ONE = 20, 1
"""QPs a tick; one is the real-time iteration"""

QRQP = {"print_iter": False, "print_header": False, "print_info": False}
HPIPM = {"hpipm": {"mode": "speed"}}
IPOPT = {
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "tol": 1e-5,
        "warm_start_init_point": "yes",
        "mu_init": 1e-3,
    },
    "print_time": False,
    "error_on_fail": False,
}


class Method(NamedTuple):
    """One way."""

    name: str
    pose: Callable[[int, TrackingCost, InputLimits], NonlinearProgram]
    plugin: str
    options: dict[str, Any]
    is_gauss_newton: bool = True

    def open(self, program: NonlinearProgram) -> ca.Function:
        """The solver, compiled."""
        options = {**self.options, **COMPILED}
        if self.is_gauss_newton:
            options["hess_lag"] = program.hessian
        return ca.nlpsol("nmpc", self.plugin, program.functions, options)


def _sqp(qpsol: str, qpsol_options: dict[str, Any], iterations: int) -> dict[str, Any]:
    return {
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "print_time": False,
        "error_on_fail": False,
        "qpsol": qpsol,
        "qpsol_options": {"error_on_fail": False, "print_time": False, **qpsol_options},
        "max_iter": iterations,
        "max_iter_ls": 0,
        "tol_pr": 1e-5,
        "tol_du": 1e-4,
    }


METHODS = (
    Method("CasADi SQP, stages, qrqp", Stagewise, "sqpmethod", _sqp("qrqp", QRQP, UNTIL_SMALL)),
    Method("CasADi RTI, stages, qrqp", Stagewise, "sqpmethod", _sqp("qrqp", QRQP, ONE)),
    Method("CasADi RTI, stages, HPIPM", Stagewise, "sqpmethod", _sqp("hpipm", HPIPM, ONE)),
    Method("CasADi SQP, condensed, DAQP", Condensed, "sqpmethod", _sqp("daqp", {}, UNTIL_SMALL)),
    Method("CasADi RTI, condensed, DAQP", Condensed, "sqpmethod", _sqp("daqp", {}, ONE)),
    Method("CasADi IPOPT, stages", Stagewise, "ipopt", IPOPT, False),
)
