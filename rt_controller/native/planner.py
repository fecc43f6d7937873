"""The control law in C in the loop of the controller, with PIQP as a check of its QP."""

import time
from collections.abc import Sequence
from ctypes import c_double, c_float
from functools import partial

import numpy as np

from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.compiler import built_library
from rt_controller.contract.files import user_cache_folder
from rt_controller.contract.signals import (
    AT_REST,
    N_INPUTS,
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.control.mpc import STRAIGHT_PATH, predict_states
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import QuadraticProgram, SolveStatus
from rt_controller.model.bundle import Bundle
from rt_controller.model.roll_outs import DrivenStep
from rt_controller.model.validation import require_drivable
from rt_controller.native.compiler import BUILT, FLOAT, compile_law, law_library_name
from rt_controller.native.constants import constants_of
from rt_controller.native.library import NativeLaw, Real

LARGEST_DIFFERENCE = 1e-3
"""of the first input from that of PIQP, in units of its range: ten times the error of PIQP"""


def open_law(bundle: Bundle, settings: MpcSettings, real: Real = c_double) -> NativeLaw:
    """The law of a model and settings, compiled for this machine, with numbers of that type.

    Raises:
        ArtifactError, ConfigError: as `constants_of`.
        MissingExtraError: it is not compiled, and this machine cannot compile it.
    """
    require_drivable(bundle)
    cache = user_cache_folder()
    folders = [BUILT, *([cache / "law"] if cache else [])]
    options = FLOAT if real is c_float else ()
    library = built_library(
        "control law in C",
        law_library_name(options),
        folders,
        partial(compile_law, options=options),
    )
    return NativeLaw(constants_of(bundle, settings), library, real)


class NativeObserver:
    """The observer of the law, with the methods of `StateObserver` that the loop needs."""

    def __init__(self, law: NativeLaw) -> None:
        self._law, self._place = law, law.constants.dynamics.place

    @property
    def psi(self) -> Array:
        """(n,), the state that was lifted last."""
        return self._law.psi[self._place]

    def observe(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """As `StateObserver.observe`."""
        return self._law.observe(state, held)

    def observe_estimate(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """As `StateObserver.observe_estimate`."""
        self._law.discard_estimates()
        return self._law.observe(state, held)

    def assume_steady(
        self, state: VehicleState, curvature_per_m: float, applied: ControlInput
    ) -> None:
        """As `StateObserver.assume_steady`."""
        self._law.assume_steady(state, curvature_per_m, applied)


class NativePlanner:
    """The law in C with the methods of `Mpc`.

    After each plan PIQP solves the same QP. A first input that differs is a failure of the solver:
    from then on no plan is made.
    """

    def __init__(self, bundle: Bundle, law: NativeLaw) -> None:
        """`law` of this bundle, as of `open_law`."""
        self._bundle, self._law = bundle, law
        self.name = f"{bundle.name} {bundle.sha256[:8]}, in C"
        self.observer = NativeObserver(self._law)
        self.inputs = self._law.inputs
        self.solve_ns = 0
        """time of the last plan"""
        self.max_iterations: int | None = self._law.constants.problem.max_iterations
        nv = len(self._law.qp["v"])
        G = np.eye(nv) - np.eye(nv, k=-N_INPUTS)
        self._program = QuadraticProgram(np.eye(nv), np.zeros(nv), G, G != 0.0, True)
        self._copy_vectors()
        self._piqp = PiqpSolver(self._program)
        self._status = SolveStatus.NUMERICS
        self._is_refuted = False
        self._x_0, self._curvature_per_m, self._path = AT_REST, 0.0, STRAIGHT_PATH
        self._preview: CurvaturePreview | None = None
        self._under_way: Sequence[ControlInput] = ()

    def plan(
        self,
        x_0: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None = None,
        under_way: Sequence[ControlInput] = (),
    ) -> SolveStatus:
        """As `Mpc.plan`; NUMERICS after a plan that PIQP refuted."""
        begun_ns = time.perf_counter_ns()
        self._x_0, self._curvature_per_m, self._path = x_0, curvature_per_m, path
        self._preview, self._under_way = preview, under_way
        self._status = self._law.plan(x_0, curvature_per_m, path, previous, preview, under_way)
        self.solve_ns = time.perf_counter_ns() - begun_ns
        if self._is_refuted:
            self._status = SolveStatus.NUMERICS
        return self._status

    def prepare(self) -> None:
        """Check the last plan, and prepare the next one."""
        if self._status is SolveStatus.SOLVED:
            self._is_refuted = self._differs_from_piqp()
        self._status = SolveStatus.NUMERICS
        self._law.prepare()

    def _differs_from_piqp(self) -> bool:
        qp, program = self._law.qp, self._program
        L = np.tril(qp["H"]).astype(np.float64)
        np.dot(L, L.T, out=program.P)
        self._copy_vectors()
        if not (self._piqp.update_matrices() and self._piqp.solve() is SolveStatus.SOLVED):
            return False  # the reference has no solution
        difference = np.abs(self._piqp.solution[:N_INPUTS] - qp["v"][:N_INPUTS])
        return not float(difference.max()) <= LARGEST_DIFFERENCE

    def _copy_vectors(self) -> None:
        qp, program = self._law.qp, self._program
        for found, name in (
            (program.q, "f"),
            (program.lower, "lower"),
            (program.upper, "upper"),
            (program.row_lower, "row_lower"),
            (program.row_upper, "row_upper"),
        ):
            found[:] = qp[name]

    def warm_up(self) -> None:
        """Do nothing: a plan needs little of the caches."""

    def forget(self) -> None:
        """As `Mpc.forget`."""
        self._status = SolveStatus.NUMERICS
        self._law.forget()

    def reset(self) -> None:
        """As `Mpc.reset`."""
        self._is_refuted = False
        self.forget()
        self._law.discard_estimates()

    def resume(self, previous: ControlInput) -> None:
        """As `Mpc.resume`."""
        self._law.resume(previous)

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """As `Mpc.limit_steering`."""
        self._law.limit_steering(most_rad, rate_radps)

    def limit_solve_time(self, budget_ns: int) -> None:
        """Do nothing: the number of iterations is limited."""

    @property
    def iterations(self) -> int:
        """Of the last QP."""
        return self._law.iterations

    @property
    def periods_under_way(self) -> int:
        """As `Mpc.periods_under_way`."""
        return len(self._under_way)

    def predicted_states(self) -> Array | None:
        """As `Mpc.predicted_states`."""
        if self._status is not SolveStatus.SOLVED:
            return None
        psi, step = self.observer.psi, DrivenStep(self._bundle)
        for each in self._under_way:
            psi = step(psi, each, self._curvature_per_m)
        return predict_states(
            self._bundle,
            psi,
            self.inputs,
            self._x_0,
            self._curvature_per_m,
            self._path,
            self._preview,
            len(self._under_way),
        )
