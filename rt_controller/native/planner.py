"""The control law in C in the loop of the controller, with PIQP as a check of its QP."""

import ctypes
import time
from collections.abc import Mapping, Sequence
from ctypes import byref, c_double, c_float
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.ctypeslib import as_array
from numpy.typing import NDArray

from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.compiler import built_library
from rt_controller.contract.files import user_cache_folder
from rt_controller.contract.signals import (
    AT_REST,
    N_INPUTS,
    N_STATES,
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
from rt_controller.native import structs
from rt_controller.native.compiler import BUILT, FLOAT, compile_law, law_library_name
from rt_controller.native.constants import constants_of

LARGEST_DIFFERENCE = 1e-3
"""of the first input from that of PIQP, in units of its range: ten times the error of PIQP"""
_BOUNDS = ("lower", "upper", "row_lower", "row_upper")
"""of `mdk_qp` and of `QuadraticProgram`"""


class NativePlanner:
    """One `mdk_controller` with the methods of `Mpc`, and of its observer.

    After each plan PIQP solves the same QP. A first input that differs is a failure of the solver:
    from then on no plan is made.
    """

    def __init__(
        self,
        bundle: Bundle,
        settings: MpcSettings,
        real: structs.Real = c_double,
        is_checked: bool = True,
    ) -> None:
        """Numbers are of the type `real`. Without `is_checked` PIQP solves nothing.

        Raises:
            ArtifactError, ConfigError: as `require_drivable` and `constants_of`.
            MissingExtraError: it is not compiled, and this machine cannot compile it.
        """
        require_drivable(bundle)
        self.name = f"{bundle.name} {bundle.sha256[:8]}, in C"
        self.constants = constants_of(bundle, settings)
        self.solve_ns = 0
        """time of the last plan"""
        problem = self.constants.problem
        self.max_iterations: int | None = problem.max_iterations
        self._bundle, self._real = bundle, real
        self._library = ctypes.CDLL(str(_compiled_law(real)))
        for name, kind in (
            ("mdk_size", ctypes.c_size_t),
            ("mdk_steering_factor", real),
            ("mdk_inputs", ctypes.POINTER(real)),
            ("mdk_lifted", ctypes.POINTER(real)),
            ("mdk_last_qp", ctypes.POINTER(structs.qp(real))),
        ):
            getattr(self._library, name).restype = kind
        self._kept: list[Any] = []
        self._model = structs.to_c(self.constants, real, self._kept)
        self._state, self._input = (real * N_STATES)(), (real * N_INPUTS)()
        self._filtered = (real * N_STATES)()
        self._situation: Any = structs.situation(real)()
        self.memory_numbers: int = self._library.mdk_memory(byref(self._model))
        """as `mdk_memory`"""
        self._memory = (real * self.memory_numbers)()
        self._self = ctypes.create_string_buffer(self._library.mdk_size())
        self._call("mdk_init", byref(self._model), self._memory)
        # Views of the memory of the law:
        self.inputs: Array = as_array(self._call("mdk_inputs"), (problem.horizon, N_INPUTS))
        """(N, 3), the last plan that was solved"""
        self._psi: Array = as_array(self._call("mdk_lifted"), (self.constants.dynamics.n,))
        self._place: NDArray[np.int32] = self.constants.dynamics.place
        qp, nv = self._call("mdk_last_qp").contents, N_INPUTS * problem.knots
        self.qp: dict[str, Array] = {
            "H": as_array(qp.H, (nv, nv)),
            **{name: as_array(getattr(qp, name), (nv,)) for name in ("f", "v", *_BOUNDS)},
        }
        """arrays of `mdk_qp`; of H its Cholesky factor"""
        self._check = _PiqpCheck(self.qp) if is_checked else None
        self._status, self._is_refuted = SolveStatus.NUMERICS, False
        self._x_0, self._curvature_per_m, self._path = AT_REST, 0.0, STRAIGHT_PATH
        self._preview: CurvaturePreview | None = None
        self._under_way: Sequence[ControlInput] = ()

    def _call(self, name: str, *arguments: Any) -> Any:
        return getattr(self._library, name)(self._self, *arguments)

    @property
    def observer(self) -> "NativePlanner":
        """Itself: the law in C filters and lifts."""
        return self

    @property
    def psi(self) -> Array:
        """(n,), the state that was lifted last."""
        return self._psi[self._place]

    def observe(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """As `StateObserver.observe`."""
        self._state[:], self._input[:] = state, held
        self._call("mdk_observe", self._state, self._input, self._filtered)
        return VehicleState(*self._filtered)

    def observe_estimate(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """As `StateObserver.observe_estimate`."""
        self._call("mdk_discard_estimates")
        return self.observe(state, held)

    def assume_steady(
        self, state: VehicleState, curvature_per_m: float, applied: ControlInput
    ) -> None:
        """As `StateObserver.assume_steady`."""
        self._state[:], self._input[:] = state, applied
        self._call("mdk_assume_steady", self._state, self._real(curvature_per_m), self._input)

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
        now = self._situation
        self._state[:], now.curvature_per_m = x_0, curvature_per_m
        now.path[:], now.previous[:] = path, previous
        now.has_preview = preview is not None
        if preview is not None:
            now.preview[:] = preview
        now.n_under_way = len(under_way)
        for i, each in enumerate(under_way):
            now.under_way[i][:] = each
        self._status = SolveStatus(self._call("mdk_plan", self._state, byref(now)))
        self.solve_ns = time.perf_counter_ns() - begun_ns
        if self._is_refuted:
            self._status = SolveStatus.NUMERICS
        return self._status

    def prepare(self) -> None:
        """Check the last plan, and prepare the next one."""
        if self._check is not None and self._status is SolveStatus.SOLVED:
            self._is_refuted = self._check.refutes()
        self._status = SolveStatus.NUMERICS
        self._call("mdk_prepare")

    def warm_up(self) -> None:
        """Do nothing: a plan needs little of the caches."""

    def forget(self) -> None:
        """As `Mpc.forget`."""
        self._status = SolveStatus.NUMERICS
        self._call("mdk_forget")

    def reset(self) -> None:
        """As `Mpc.reset`."""
        self._is_refuted = False
        self.forget()
        self._call("mdk_discard_estimates")

    def resume(self, previous: ControlInput) -> None:
        """As `Mpc.resume`."""
        self._input[:] = previous
        self._call("mdk_resume", self._input)

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """As `Mpc.limit_steering`."""
        self._call("mdk_limit_steering", self._real(most_rad), self._real(rate_radps))

    def limit_solve_time(self, budget_ns: int) -> None:
        """Do nothing: the number of iterations is limited."""

    @property
    def iterations(self) -> int:
        """Of the last QP."""
        return int(self._call("mdk_iterations"))

    @property
    def periods_under_way(self) -> int:
        """As `Mpc.periods_under_way`."""
        return len(self._under_way)

    def predicted_states(self) -> Array | None:
        """As `Mpc.predicted_states`."""
        if self._status is not SolveStatus.SOLVED:
            return None
        psi, step = self.psi, DrivenStep(self._bundle)
        factor = float(self._call("mdk_steering_factor"))
        for each in self._under_way:
            of_model = each._replace(steer_rad=factor * each.steer_rad)
            psi = step(psi, of_model, self._curvature_per_m)
        return predict_states(
            self._bundle,
            psi,
            self.inputs * (1.0, 1.0, factor),
            self._x_0,
            self._curvature_per_m,
            self._path,
            self._preview,
            len(self._under_way),
        )


class _PiqpCheck:
    """PIQP on the QP that the law solved last."""

    def __init__(self, qp: Mapping[str, Array]) -> None:
        self._qp, nv = qp, len(qp["v"])
        G = np.eye(nv) - np.eye(nv, k=-N_INPUTS)
        self._program = QuadraticProgram(np.eye(nv), np.zeros(nv), G, G != 0.0, True)
        self._copy_vectors()
        self._piqp = PiqpSolver(self._program)

    def refutes(self) -> bool:
        """True if PIQP finds another first input."""
        L = np.tril(self._qp["H"]).astype(np.float64)
        np.dot(L, L.T, out=self._program.P)
        self._copy_vectors()
        if not (self._piqp.update_matrices() and self._piqp.solve() is SolveStatus.SOLVED):
            return False  # the reference has no solution
        difference = np.abs(self._piqp.solution[:N_INPUTS] - self._qp["v"][:N_INPUTS])
        return not float(difference.max()) <= LARGEST_DIFFERENCE

    def _copy_vectors(self) -> None:
        self._program.q[:] = self._qp["f"]
        for name in _BOUNDS:
            getattr(self._program, name)[:] = self._qp[name]


def _compiled_law(real: structs.Real) -> Path:
    cache = user_cache_folder()
    folders = [BUILT, *([cache / "law"] if cache else [])]
    options = FLOAT if real is c_float else ()
    name, compile_into = law_library_name(options), partial(compile_law, options=options)
    return built_library("control law in C", name, folders, compile_into)
