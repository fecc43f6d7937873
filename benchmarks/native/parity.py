"""The same calls on the law in C and on the law in Python: differences, iterations and times."""

from collections.abc import Iterable, Sequence
from ctypes import c_double, c_float
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.native.recorded import Call, difference, repeat
from offline.targets.recorded_drives import open_exact_mpc
from rt_controller.config import ControllerConfig
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_STATES, VehicleState
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.control.planner import Planner
from rt_controller.control.program import SolveStatus
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import LiftSample
from rt_controller.native.network import Network, network_of
from rt_controller.native.planner import NativePlanner, open_law
from rt_controller.node import build_planner


class _DoubleEncoder:
    """The encoder of an MPC, its network evaluated in float64; it reads float32, as the other."""

    def __init__(self, encoder: Encoder, network: Network) -> None:
        self._network, self.history = network, encoder.history
        self.psi = encoder.psi

    def lift(self, state: VehicleState, curvature_per_m: float) -> Array:
        """As `Encoder.lift`."""
        rows = np.zeros((0, 0)) if self.history is None else self.history
        read = (np.array(each, dtype=np.float32) for each in (state, (curvature_per_m,), rows))
        sample = LiftSample(*(each.astype(np.float64)[None] for each in read))
        self.psi[:] = self._network.lift(sample)[0]
        self.psi[:N_STATES] = state
        return self.psi


def exact_planner(bundle: Bundle) -> Mpc:
    """The law in Python without errors of float32, and of a solver that stops early."""
    mpc = open_exact_mpc(bundle, ControllerConfig().mpc)
    encoder: Any = _DoubleEncoder(mpc.observer.encoder, network_of(bundle))
    mpc.observer.encoder = encoder
    return mpc


class CPlanner(NativePlanner):
    """The law in C without its check by PIQP."""

    def prepare(self) -> None:
        """As `NativeLaw.prepare`."""
        self._law.prepare()


def c_planner(bundle: Bundle, real: Any = c_double) -> CPlanner:
    """The law in C with numbers of that type."""
    return CPlanner(bundle, open_law(bundle, ControllerConfig().mpc, real))


class Comparison(NamedTuple):
    """Plans of the same calls."""

    planners: tuple[str, ...]
    differences: Array
    """(T, P, P) between planners, in units of an input's range; NaN: one has no plan"""
    solved: NDArray[np.bool_]
    """(T, P)"""
    iterations: Array
    """(T, P)"""
    plan_ns: Array
    """(T, P)"""
    prepare_ns: Array
    """(T, P)"""

    def parity(self, one: str, other: str) -> dict[str, float]:
        """Figures of the differences between two planners."""
        a, b = self.planners.index(one), self.planners.index(other)
        is_other = self.solved[:, a] != self.solved[:, b]
        # The plan after one that only one of them has begins at another linearisation.
        is_comparable = np.isfinite(self.differences[:, a, b])
        is_comparable[1:] &= ~is_other[:-1]
        found = self.differences[is_comparable, a, b]
        return {
            "worst_of_range": float(found.max()),
            "median_of_range": float(np.median(found)),
            "p99_9_of_range": float(np.quantile(found, 0.999)),
            "plans_of_one_only": int(is_other.sum()),
        }

    def counts(self, planner: str) -> dict[str, float]:
        """Iterations of the QPs of one, and plans that it has not solved."""
        column = self.planners.index(planner)
        found = self.iterations[:, column]
        return {
            "iterations_median": float(np.median(found)),
            "iterations_p99": float(np.quantile(found, 0.99)),
            "iterations_worst": int(found.max()),
            "plans": len(found),
            "unsolved": int(np.sum(~self.solved[:, column])),
        }

    def medians_us(self, planner: str) -> dict[str, float]:
        """Times of a plan and of the preparation of the next one."""
        column = self.planners.index(planner)
        plan_ns, prepare_ns = self.plan_ns[:, column], self.prepare_ns[:, column]
        return {
            "plan_median_us": 1e-3 * float(np.median(plan_ns)),
            "prepare_median_us": 1e-3 * float(np.median(prepare_ns[prepare_ns > 0])),
        }


def open_planners(bundle: Bundle) -> dict[str, Planner]:
    """The law in Python, exact and as it drives, and in C, by name."""
    return {
        "exact": exact_planner(bundle),
        "python": build_planner(bundle, ControllerConfig()),
        "double": c_planner(bundle),
        "float": c_planner(bundle, c_float),
    }


def compare(drives: Iterable[Sequence[Call]], bundle: Bundle) -> Comparison:
    """The plans of all drives, each begun with new planners, which take turns after each plan."""
    differences, rows, names = [], [], tuple[str, ...]()
    for calls in drives:
        planners = open_planners(bundle)
        names = tuple(planners)
        for plans in zip(*(repeat(calls, each) for each in planners.values()), strict=True):
            differences.append([[difference(a, b) for b in plans] for a in plans])
            rows.append([(p.status is SolveStatus.SOLVED, *p[2:]) for p in plans])
    solved, iterations, plan_ns, prepare_ns = np.moveaxis(np.array(rows), -1, 0)
    return Comparison(
        names, np.array(differences), solved.astype(bool), iterations, plan_ns, prepare_ns
    )
