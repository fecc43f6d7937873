"""PIQP behind one small door: set up once, then vectors in and a solution out."""

import time
from enum import Enum

import numpy as np
import piqp
from scipy.sparse import csc_matrix

from rt_controller.contract.bundle import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.control.constraints import InputConstraints
from rt_controller.control.objective import Objective

EPS_ABS = 1e-6
EPS_DUALITY_GAP_ABS = 2e-9
MAX_ITERATIONS = 16
"""PIQP has no time limit: the number of iterations bounds the time"""
USABLE_RESIDUAL = 1e-4
"""of a solve cut short there, in units of an input's range: as exact as a command frame"""


class SolveStatus(Enum):
    """How a solve ended; only SOLVED may be driven."""

    SOLVED = 0
    ITERATION_LIMIT = 1
    INFEASIBLE = 2
    NUMERICS = 3


_STATUS = {
    piqp.PIQP_SOLVED: SolveStatus.SOLVED,
    piqp.PIQP_MAX_ITER_REACHED: SolveStatus.ITERATION_LIMIT,
    piqp.PIQP_PRIMAL_INFEASIBLE: SolveStatus.INFEASIBLE,
    piqp.PIQP_DUAL_INFEASIBLE: SolveStatus.INFEASIBLE,
}


class PiqpWorkspace:
    """One preallocated PIQP problem: an objective that is aimed anew, bounds that move.

    `sparse_multistage` on the dense condensed matrices is the fastest of PIQP's factorisations at
    this size, with a constant H and with a new one every tick; the solver's tolerances keep the
    first input within 1e-4 of its range.
    """

    def __init__(
        self,
        objective: Objective,
        constraints: InputConstraints,
        max_iterations: int = MAX_ITERATIONS,
    ) -> None:
        self._objective = objective
        self._hessian = _columns_of(objective.H)
        self._solver = piqp.SparseSolver()
        settings = self._solver.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        settings.eps_abs = EPS_ABS
        settings.eps_duality_gap_abs = EPS_DUALITY_GAP_ABS
        settings.max_iter = max_iterations
        # Scaling the problem anew costs more than a new H changes about it.
        settings.preconditioner_reuse_on_update = True
        nv = constraints.scale.size
        self.solution = np.zeros(nv)
        """(nv,), of the last solve; overwritten by the next"""
        self.iterations = 0
        self.solve_ns = 0
        self._solver.setup(
            self._hessian,
            np.zeros(nv),
            None,
            None,
            csc_matrix(constraints.D),
            -constraints.slew,
            constraints.slew,
            constraints.lower,
            constraints.upper,
        )
        if self._solver.solve() not in _STATUS:
            raise ConfigError(
                "PIQP refuses the assembled problem: expected a convex QP, found numerical "
                "trouble at start. Check the --mpc weights and limits."
            )

    def solve(self, slew_lower: Array, slew_upper: Array, upper: Array) -> SolveStatus:
        """How minimising the objective as it is aimed, in these bounds, ended.

        `solution` and `iterations` hold the rest.
        """
        begun_ns = time.perf_counter_ns()
        self.iterations = 0
        gradient, renews = self._objective.gradient, self._objective.renews_hessian
        if not np.isfinite(gradient).all() or (
            renews and not np.isfinite(self._hessian.data).all()
        ):
            # PIQP would keep what is not a number, and fail on every later problem too.
            self.solve_ns = time.perf_counter_ns() - begun_ns
            return SolveStatus.NUMERICS
        hessian = self._hessian if renews else None
        self._solver.update(P=hessian, c=gradient, h_l=slew_lower, h_u=slew_upper, x_u=upper)
        status = _STATUS.get(self._solver.solve(), SolveStatus.NUMERICS)
        result = self._solver.result
        self.iterations = result.info.iter
        self.solution[:] = result.x  # a live view of the solver's memory
        self.solve_ns = time.perf_counter_ns() - begun_ns
        if status is SolveStatus.ITERATION_LIMIT and _is_usable(result.info):
            status = SolveStatus.SOLVED
        if status is SolveStatus.SOLVED and not np.isfinite(self.solution).all():
            return SolveStatus.NUMERICS
        return status


def _columns_of(H: Array) -> csc_matrix:
    """The symmetric H as PIQP takes it, in the same memory: its rows are its columns.

    Zeros are entries like any others: a later H may have something there.
    """
    size = H.shape[0]
    rows = np.tile(np.arange(size, dtype=np.int32), size)
    starts = np.arange(0, size * size + 1, size, dtype=np.int32)
    return csc_matrix((H.reshape(-1), rows, starts), shape=H.shape)


def _is_usable(info: piqp.Info) -> bool:
    return bool(
        info.primal_res < USABLE_RESIDUAL
        and info.dual_res < USABLE_RESIDUAL
        and info.duality_gap < USABLE_RESIDUAL
    )
