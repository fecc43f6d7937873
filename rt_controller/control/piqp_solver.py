"""PIQP, a proximal interior-point method, on a condensed program.

Schwan, Jiang, Kuhn and Jones, *PIQP: A Proximal Interior-Point Quadratic Programming Solver*, 2023.
"""

import time
from statistics import median

import numpy as np
import piqp
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from rt_controller.contract.errors import ConfigError
from rt_controller.control.program import QuadraticProgram, SolveStatus

MAX_ITERATIONS = 24
"""more than any problem recorded in a drive needed"""
MIN_ITERATIONS = 12
"""with a lower limit the first input may be wrong by more than 1e-4 of its range"""
EPS_ABS = 1e-6
EPS_DUALITY_GAP_ABS = 2e-9
"""with them the first input is within 1e-4 of its range"""
MEASURED_SOLVES = 21
COLD_FACTOR = 2.0
"""time of an iteration once a period, relative to repeated solves: its data has left the cache"""
USABLE_RESIDUAL = 1e-4
"""primal and dual residual accepted at the iteration limit: for inputs a share of their range, and
as exact as a command frame"""
USABLE_GAP = 1e-8
"""duality gap accepted at the iteration limit: the error of the inputs goes with its square root,
and changes of an input have weights of ten and more"""

_STATUS = {
    piqp.PIQP_SOLVED: SolveStatus.SOLVED,
    piqp.PIQP_MAX_ITER_REACHED: SolveStatus.ITERATION_LIMIT,
    piqp.PIQP_PRIMAL_INFEASIBLE: SolveStatus.INFEASIBLE,
    piqp.PIQP_DUAL_INFEASIBLE: SolveStatus.INFEASIBLE,
}


class PiqpSolver:
    """`Solver` by PIQP from a cold start: the time depends on little but the iterations.

    Raises:
        ConfigError: PIQP fails on the program for another reason than infeasibility.
    """

    def __init__(
        self,
        program: QuadraticProgram,
        max_iterations: int = MAX_ITERATIONS,
        is_exact: bool = False,
    ) -> None:
        """`is_exact`: to 1e-11; for a reference, not for the loop."""
        self._program = program
        # P with all its entries, G without those that are always zero.
        self._P = csc_matrix(np.ones_like(program.P))
        self._G = csc_matrix(program.pattern, dtype=float)
        self._read_matrices()
        self._workspace = piqp.SparseSolver()
        settings = self._workspace.settings
        # The fastest factorisation here, of dense matrices too.
        settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        settings.eps_abs, settings.eps_duality_gap_abs = EPS_ABS, EPS_DUALITY_GAP_ABS
        if is_exact:
            settings.eps_abs, settings.eps_duality_gap_abs = 1e-11, 1e-14
            settings.eps_rel = settings.eps_duality_gap_rel = 0.0
        settings.max_iter = max_iterations
        # Scaling the problem again costs more than it gains for matrices that change little.
        settings.preconditioner_reuse_on_update = True
        self._has_valid_matrices = True
        self.solution = np.zeros(program.size)
        self.iterations = 0
        rows = (self._G, program.row_lower, program.row_upper) if len(program.G) else (None,) * 3
        self._has_rows = rows[0] is not None
        box = program.lower, program.upper
        self._workspace.setup(self._P, program.q, None, None, *rows, *box)
        if self._workspace.solve() not in _STATUS:
            raise ConfigError(
                "PIQP refuses the assembled problem: expected a convex QP, found numerical "
                "trouble at start. Check `mpc.tolerance` and the other weights."
            )

    def limit_solve_time(self, budget_ns: int) -> int:
        """As `Solver.limit_solve_time`: PIQP has no time limit, so the iterations are limited.

        The fastest of several solves tells what the processor can do, and whether the budget is
        refused; the median tells what fits beside the other programs. While those need
        the processor, a solve may exceed the budget.
        """
        times_ns = []
        for _ in range(MEASURED_SOLVES):
            begun_ns = time.perf_counter_ns()
            self._workspace.solve()
            spent_ns = time.perf_counter_ns() - begun_ns
            times_ns.append(COLD_FACTOR * (spent_ns / max(1, self._workspace.result.info.iter)))
        fastest_ns = min(times_ns)
        most = int(budget_ns / fastest_ns)
        if most < MIN_ITERATIONS:
            raise ConfigError(
                f"`realtime.solve_budget_ms` {budget_ns / 1e6:g}: expected time for at least "
                f"{MIN_ITERATIONS} iterations of PIQP, found {most}, since one takes "
                f"{fastest_ns / 1e3:.0f} us on this machine, which may be busy. Stop other "
                f"programs, shorten `mpc.horizon`, or give the solver more time."
            )
        settings = self._workspace.settings
        usual = max(MIN_ITERATIONS, int(budget_ns / median(times_ns)))
        settings.max_iter = min(settings.max_iter, usual)
        return int(settings.max_iter)

    def update_matrices(self) -> bool:
        program = self._program
        # PIQP would keep NaN in its workspace, and fail on every later problem too.
        self._has_valid_matrices = program.has_finite_matrices()
        if self._has_valid_matrices and program.hessian_varies:
            self._read_matrices()
            self._workspace.update(P=self._P, G=self._G if program.rows_vary else None)
        return self._has_valid_matrices

    def solve(self) -> SolveStatus:
        program = self._program
        self.iterations = 0
        if not (self._has_valid_matrices and program.has_finite_vectors()):
            return SolveStatus.NUMERICS
        self._workspace.update(
            c=program.q,
            h_l=program.row_lower if self._has_rows else None,
            h_u=program.row_upper if self._has_rows else None,
            x_l=program.lower,
            x_u=program.upper,
        )
        status = _STATUS.get(self._workspace.solve(), SolveStatus.NUMERICS)
        result, info = self._workspace.result, self._workspace.result.info
        self.iterations = info.iter
        if status is SolveStatus.ITERATION_LIMIT:  # solved, where the residuals are small enough
            residual = max(info.primal_res, info.dual_res)
            if residual < USABLE_RESIDUAL and info.duality_gap < USABLE_GAP:
                status = SolveStatus.SOLVED
        if status is SolveStatus.SOLVED:
            if not np.isfinite(result.x).all():
                return SolveStatus.NUMERICS
            self.solution[:] = result.x
        return status

    def active_bounds(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Flags (n + r,) of the upper and of the lower bounds that are active in the last solution.

        A bound is active if its multiplier exceeds its slack: their product is the same for all
        bounds on the central path, and one of the two goes to zero.
        """
        r = self._workspace.result
        upper = np.concatenate([r.z_bu > r.s_bu, r.z_u > r.s_u])
        return upper, np.concatenate([r.z_bl > r.s_bl, r.z_l > r.s_l])

    def _read_matrices(self) -> None:
        """Copy P and G, column by column; the columns of P are its rows."""
        program = self._program
        self._P.data[:] = program.P.reshape(-1)
        self._G.data[:] = program.G.T[program.pattern.T]
