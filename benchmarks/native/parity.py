"""The law in C and the law in Python in the same situations: differences, iterations and times."""

from collections.abc import Iterable, Sequence
from ctypes import c_double, c_float
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.targets.recorded_drives import Situation, open_exact_mpc, plan
from rt_controller.config import ControllerConfig
from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import N_STATES, VehicleState
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.control.planner import Planner
from rt_controller.control.program import SolveStatus
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import LiftSample
from rt_controller.native.network import Network, network_of
from rt_controller.native.planner import NativePlanner
from rt_controller.node import build_planner

_SPAN = np.subtract(INPUT_LIMITS.upper, INPUT_LIMITS.lower)
"""range of each input"""
_NS_PER_US = 1e3


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


def c_planner(bundle: Bundle, real: Any = c_double) -> NativePlanner:
    """The law in C with numbers of that type, without its check by PIQP."""
    return NativePlanner(bundle, ControllerConfig().mpc, real, is_checked=False)


class Plans(NamedTuple):
    """Plans of one planner in T situations."""

    is_solved: NDArray[np.bool_]
    """(T,)"""
    inputs: Array
    """(T, N, 3), of the last plan that was solved"""
    iterations: NDArray[np.int64]
    """(T,)"""
    plan_ns: NDArray[np.int64]
    """(T,)"""
    prepare_ns: NDArray[np.int64]
    """(T,)"""

    def parity(self, reference: "Plans") -> dict[str, float]:
        """Figures of the differences from other plans, in units of each input's range."""
        is_other = self.is_solved != reference.is_solved
        # The plan after one that only one of them has begins at another linearisation.
        is_comparable = self.is_solved & reference.is_solved
        is_comparable[1:] &= ~is_other[:-1]
        differences = np.abs(self.inputs - reference.inputs)[is_comparable] / _SPAN
        found = differences.max(axis=(1, 2))
        return {
            "worst_of_range": float(found.max()),
            "median_of_range": float(np.median(found)),
            "p99_9_of_range": float(np.quantile(found, 0.999)),
            "plans_of_one_only": int(is_other.sum()),
        }

    def counts(self) -> dict[str, float]:
        """Iterations of the QPs, and plans that are not solved."""
        return {
            "iterations_median": float(np.median(self.iterations)),
            "iterations_p99": float(np.quantile(self.iterations, 0.99)),
            "iterations_worst": int(self.iterations.max()),
            "plans": len(self.iterations),
            "unsolved": int(np.sum(~self.is_solved)),
        }

    def medians_us(self) -> dict[str, float]:
        """Times of a plan and of the preparation of the next one."""
        return {
            "plan_median_us": float(np.median(self.plan_ns)) / _NS_PER_US,
            "prepare_median_us": float(np.median(self.prepare_ns)) / _NS_PER_US,
        }


def compare(drives: Iterable[Sequence[Situation]], bundle: Bundle) -> dict[str, Plans]:
    """The plans of the law in Python, exact and as it drives, and in C, by name.

    Each drive begins with a restart. The planners take turns after each plan.
    """
    planners: dict[str, Planner] = {
        "exact": exact_planner(bundle),
        "python": build_planner(bundle, ControllerConfig()),
        "double": c_planner(bundle),
        "float": c_planner(bundle, c_float),
    }
    situations = [now for drive in drives for now in drive]
    rows = [[plan(each, now) for each in planners.values()] for now in situations]
    found: dict[str, Plans] = {}
    for name, plans in zip(planners, zip(*rows, strict=True), strict=True):
        status, *columns = zip(*plans, strict=True)
        is_solved = np.array([each is SolveStatus.SOLVED for each in status])
        found[name] = Plans(is_solved, *map(np.array, columns))
    return found
