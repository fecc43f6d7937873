"""PIQP's memory and settings, and what its words mean here.

Schwan, Jiang, Kuhn and Jones, *PIQP: A Proximal Interior-Point Quadratic Programming Solver*, 2023.
"""

import time
from statistics import median

import piqp

from rt_controller.contract.bundle import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.control.solver import SolveStatus

EPS_ABS = 1e-6
EPS_DUALITY_GAP_ABS = 2e-9
MEASURED_SOLVES = 21
COLD_FACTOR = 2.0
"""how much longer an iteration takes once in 25 ms than in a row: its data left the cache"""
USABLE_RESIDUAL = 1e-4
"""of the constraints and of stationarity, in a solve that was cut short: of inputs it is a share of
their range, and as exact as a command frame"""
USABLE_GAP = 1e-8
"""of the cost: the inputs' error goes with its root, and changes of an input weigh ten and more"""

_STATUS = {
    piqp.PIQP_SOLVED: SolveStatus.SOLVED,
    piqp.PIQP_MAX_ITER_REACHED: SolveStatus.ITERATION_LIMIT,
    piqp.PIQP_PRIMAL_INFEASIBLE: SolveStatus.INFEASIBLE,
    piqp.PIQP_DUAL_INFEASIBLE: SolveStatus.INFEASIBLE,
}


class PiqpWorkspace:
    """PIQP with `sparse_multistage`: its fastest factorisation here, of dense matrices too.

    The tolerances keep the first input within 1e-4 of its range.
    """

    def __init__(self, max_iterations: int, least_iterations: int) -> None:
        """PIQP has no time limit: the number of iterations bounds the time.

        With fewer than `least_iterations` a usual solve would be cut short too early.
        """
        self._least_iterations = least_iterations
        self.solver = piqp.SparseSolver()
        self.iterations = 0
        """of the last run"""
        settings = self.solver.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        settings.eps_abs = EPS_ABS
        settings.eps_duality_gap_abs = EPS_DUALITY_GAP_ABS
        settings.max_iter = max_iterations
        # Scaling the problem anew costs more than new matrices change about it.
        settings.preconditioner_reuse_on_update = True

    def try_once(self) -> None:
        """Solve what was set up.

        Raises:
            ConfigError: PIQP sees no convex QP.
        """
        if self.solver.solve() not in _STATUS:
            raise ConfigError(
                "PIQP refuses the assembled problem: expected a convex QP, found numerical "
                "trouble at start. Check the --mpc weights and limits."
            )

    def bound(self, budget_ns: int) -> None:
        """From now on give up after as many iterations as fit into the budget on this machine.

        Raises:
            ConfigError: those are too few.
        """
        per_iteration_ns = COLD_FACTOR * self._measure_iteration_ns()
        most = min(self.solver.settings.max_iter, int(budget_ns / per_iteration_ns))
        if most < self._least_iterations:
            raise ConfigError(
                f"--realtime.solve-budget-ms {budget_ns / 1e6:g}: expected time for at least "
                f"{self._least_iterations} iterations of PIQP, found {most}, since one takes "
                f"{per_iteration_ns / 1e3:.0f} us on this machine. Shorten --mpc.horizon, or give "
                f"the solver more time."
            )
        self.solver.settings.max_iter = most

    def run(self) -> SolveStatus:
        """Solve; one cut short, but as good as solved, is SOLVED."""
        status = _STATUS.get(self.solver.solve(), SolveStatus.NUMERICS)
        info = self.solver.result.info
        self.iterations = info.iter
        if status is SolveStatus.ITERATION_LIMIT and _is_usable(info):
            return SolveStatus.SOLVED
        return status

    @property
    def x(self) -> Array:
        """The last solution, a live view of the solver's memory."""
        view: Array = self.solver.result.x
        return view

    def _measure_iteration_ns(self) -> float:
        times_ns: list[float] = []
        for _ in range(MEASURED_SOLVES):
            begun_ns = time.perf_counter_ns()
            self.solver.solve()
            spent_ns = time.perf_counter_ns() - begun_ns
            times_ns.append(spent_ns / max(1, self.solver.result.info.iter))
        return median(times_ns)


def _is_usable(info: piqp.Info) -> bool:
    return bool(
        info.primal_res < USABLE_RESIDUAL
        and info.dual_res < USABLE_RESIDUAL
        and info.duality_gap < USABLE_GAP
    )
