"""PIQP, an interior-point method: its time depends on the number of iterations and little else.

Schwan, Jiang, Kuhn and Jones, *PIQP: A Proximal Interior-Point Quadratic Programming Solver*, 2023.
"""

import time
from statistics import median

import numpy as np
import piqp
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from rt_controller.contract.bundle import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus

EPS_ABS = 1e-6
EPS_DUALITY_GAP_ABS = 2e-9
MAX_ITERATIONS = 16
"""PIQP has no time limit: the number of iterations bounds the time"""
LEAST_ITERATIONS = 12
"""cut shorter than this, the first input may be wrong by more than 1e-4 of its range"""
MEASURED_SOLVES = 21
COLD_FACTOR = 2.0
"""how much longer an iteration takes once in 25 ms than in a row: its data left the cache"""
USABLE_RESIDUAL = 1e-4
"""of a solve cut short there, in units of an input's range: as exact as a command frame"""

_STATUS = {
    piqp.PIQP_SOLVED: SolveStatus.SOLVED,
    piqp.PIQP_MAX_ITER_REACHED: SolveStatus.ITERATION_LIMIT,
    piqp.PIQP_PRIMAL_INFEASIBLE: SolveStatus.INFEASIBLE,
    piqp.PIQP_DUAL_INFEASIBLE: SolveStatus.INFEASIBLE,
}


class PiqpSolver:
    """`sparse_multistage` on dense condensed matrices: PIQP's fastest factorisation at this size.

    With a constant P and with a new one every tick. The tolerances keep the first input within
    1e-4 of its range.

    Raises:
        ConfigError: the program is not a convex QP.
    """

    def __init__(self, program: QuadraticProgram, max_iterations: int = MAX_ITERATIONS) -> None:
        self._program = program
        self._P = _columns_of_symmetric(program.P)
        self._G = _Columns(program.G, program.pattern)
        self._has_rows = len(program.G) > 0
        self._solver = piqp.SparseSolver()
        self._has_matrices = True
        self.solution = np.zeros(program.size)
        self.iterations = 0
        settings = self._solver.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        settings.eps_abs = EPS_ABS
        settings.eps_duality_gap_abs = EPS_DUALITY_GAP_ABS
        settings.max_iter = max_iterations
        # Scaling the problem anew costs more than new matrices change about it.
        settings.preconditioner_reuse_on_update = True
        rows = (self._G.matrix, program.row_lower, program.row_upper)
        self._solver.setup(
            self._P,
            program.q,
            None,
            None,
            *(rows if self._has_rows else (None, None, None)),
            program.lower,
            program.upper,
        )
        if self._solver.solve() not in _STATUS:
            raise ConfigError(
                "PIQP refuses the assembled problem: expected a convex QP, found numerical "
                "trouble at start. Check the --mpc weights and limits."
            )

    def bound(self, budget_ns: int) -> None:
        """As `Solver.bound`: from now on give up after as many iterations as fit into it here."""
        per_iteration_ns = COLD_FACTOR * self._measure_iteration_ns()
        most = min(MAX_ITERATIONS, int(budget_ns / per_iteration_ns))
        if most < LEAST_ITERATIONS:
            raise ConfigError(
                f"--realtime.solve-budget-ms {budget_ns / 1e6:g}: expected time for at least "
                f"{LEAST_ITERATIONS} iterations of PIQP, found {most}, since one takes "
                f"{per_iteration_ns / 1e3:.0f} us on this machine. Shorten --mpc.horizon, or give "
                f"the solver more time."
            )
        self._solver.settings.max_iter = most

    def _measure_iteration_ns(self) -> float:
        times_ns = []
        for _ in range(MEASURED_SOLVES):
            begun_ns = time.perf_counter_ns()
            self._solver.solve()
            spent_ns = time.perf_counter_ns() - begun_ns
            times_ns.append(spent_ns / max(1, self._solver.result.info.iter))
        return median(times_ns)

    def renew(self) -> bool:
        """As `Solver.renew`."""
        program = self._program
        # PIQP would keep what is not a number, and fail on every later problem too.
        self._has_matrices = program.has_finite_matrices()
        if self._has_matrices and program.renews:
            self._solver.update(
                P=self._P if program.renews_hessian else None,
                G=self._G.renew() if program.renews_rows else None,
            )
        return self._has_matrices

    def solve(self) -> SolveStatus:
        """As `Solver.solve`."""
        program = self._program
        self.iterations = 0
        if not (self._has_matrices and program.has_finite_vectors()):
            return SolveStatus.NUMERICS
        self._solver.update(
            c=program.q,
            h_l=program.row_lower if self._has_rows else None,
            h_u=program.row_upper if self._has_rows else None,
            x_u=program.upper,
        )
        status = _STATUS.get(self._solver.solve(), SolveStatus.NUMERICS)
        result = self._solver.result
        self.iterations = result.info.iter
        if status is SolveStatus.ITERATION_LIMIT and _is_usable(result.info):
            status = SolveStatus.SOLVED
        if status is SolveStatus.SOLVED:
            if not np.isfinite(result.x).all():
                return SolveStatus.NUMERICS
            self.solution[:] = result.x  # a live view of the solver's memory
        return status

    def active_bounds(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which upper and lower bounds (n + r,) hold the last solution back.

        Those whose multiplier is larger than their slack: on the way to the optimum the product of
        the two is the same for all, and one of them goes to zero.
        """
        r = self._solver.result
        above = np.concatenate([r.z_bu > r.s_bu, r.z_u > r.s_u])
        return above, np.concatenate([r.z_bl > r.s_bl, r.z_l > r.s_l])


class _Columns:
    """G as PIQP takes it: column by column, without what is always zero."""

    def __init__(self, G: Array, pattern: NDArray[np.bool_]) -> None:
        columns, rows = np.nonzero(pattern.T)
        self._entries = G.reshape(-1)
        self._places = rows * G.shape[1] + columns
        starts = np.searchsorted(columns, np.arange(G.shape[1] + 1)).astype(np.int32)
        values = self._entries[self._places]
        self.matrix = csc_matrix((values, rows.astype(np.int32), starts), shape=G.shape)

    def renew(self) -> csc_matrix:
        """The matrix as G is now."""
        np.take(self._entries, self._places, out=self.matrix.data)
        return self.matrix


def _columns_of_symmetric(P: Array) -> csc_matrix:
    """The symmetric P as PIQP takes it, in the same memory: its rows are its columns.

    Zeros are entries like any others: a later P may have something there.
    """
    size = P.shape[0]
    rows = np.tile(np.arange(size, dtype=np.int32), size)
    starts = np.arange(0, size * size + 1, size, dtype=np.int32)
    return csc_matrix((P.reshape(-1), rows, starts), shape=P.shape)


def _is_usable(info: piqp.Info) -> bool:
    return bool(
        info.primal_res < USABLE_RESIDUAL
        and info.dual_res < USABLE_RESIDUAL
        and info.duality_gap < USABLE_RESIDUAL
    )
