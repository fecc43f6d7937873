"""The time of a solve for one horizon and one size of the model, each way of posing it."""

import time
from collections.abc import Callable
from typing import NamedTuple

from benchmarks.growth.sizes import weave
from benchmarks.peers.ratio import p50, p99
from rt_controller.config import ControllerConfig
from rt_controller.contract.bundle import Bundle
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.daqp_solver import DaqpSolver
from rt_controller.control.formulation import prefers_stages
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.qp import WITH_SLEW, CondensedQp
from rt_controller.control.solver import Solver, SolveStatus
from rt_controller.control.solvers import open_solver
from rt_controller.control.staged_qp import StagedQp
from rt_controller.control.staged_solver import StagedSolver

MOST_ENTRIES = 400_000
"""of the matrix with states: beyond, a solve takes longer than a tick by far"""
CONDENSED, WARM = "condensed, PIQP", "condensed, PIQP, warm"
DAQP, STAGED = "condensed, DAQP", "staged, PIQP"


class Cell(NamedTuple):
    """One horizon, one number of latents."""

    horizon: int
    latents: int
    p50_us: dict[str, float]
    p99_us: dict[str, float]
    unsolved: dict[str, int]
    is_staged_by_rule: bool


def measure(bundle: Bundle, latents: int, horizon: int, ticks: int) -> Cell:
    """All that are sensible, on the same ticks."""
    cost = ControllerConfig().mpc.cost()
    condensed = CondensedQp(bundle, horizon, cost, INPUT_LIMITS, WITH_SLEW)
    runs: dict[str, tuple[CondensedQp | StagedQp, Callable[[], Solver]]] = {
        CONDENSED: (condensed, lambda: PiqpSolver(condensed.program)),
        WARM: (condensed, lambda: open_solver(condensed.program)),
        DAQP: (condensed, lambda: DaqpSolver(condensed.program)),
    }
    if horizon * bundle.n_observables**2 <= MOST_ENTRIES:
        staged = StagedQp(bundle, horizon, cost, INPUT_LIMITS, WITH_SLEW)
        runs[STAGED] = (staged, lambda: StagedSolver(staged))
    times: dict[str, list[float]] = {}
    unsolved = {}
    for name, (qp, open_one) in runs.items():
        times[name], unsolved[name] = _time(qp, open_one(), ticks)
    return Cell(
        horizon,
        latents,
        {name: p50(found) for name, found in times.items()},
        {name: p99(found) for name, found in times.items()},
        unsolved,
        prefers_stages(bundle, horizon),
    )


def _time(qp: CondensedQp | StagedQp, solver: Solver, ticks: int) -> tuple[list[float], int]:
    pedals, unsolved = PedalChoice(), 0
    times_us: list[float] = []
    for tick in range(ticks):
        weave(qp.situation, tick)
        qp.aim(pedals)
        begun_ns = time.perf_counter_ns()
        status = solver.solve()
        times_us.append((time.perf_counter_ns() - begun_ns) / 1e3)
        unsolved += status is not SolveStatus.SOLVED
    return times_us, unsolved
