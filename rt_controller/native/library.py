"""The control law in C, compiled for this machine, and its constants in memory."""

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.ctypeslib import as_array

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import (
    N_INPUTS,
    N_STATES,
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.control.program import SolveStatus
from rt_controller.native.constants import LawConstants

MOST_UNDER_WAY = 16
"""as MDK_MOST_UNDER_WAY"""
Real = type[ctypes.c_double] | type[ctypes.c_float]


class NativeLaw:
    """One `mdk_controller` and the functions of `c/mdk.h`; arrays are views of its memory."""

    def __init__(
        self, constants: LawConstants, library: Path, real: Real = ctypes.c_double
    ) -> None:
        """`library` is compiled for numbers of the type `real`."""
        self._library = ctypes.CDLL(str(library))
        self._kept: list[Any] = []
        self._situation: Any = _situation(real)
        self._model = to_c(constants, real, self._kept)
        for name, kind in (
            ("mdk_size", ctypes.c_size_t),
            ("mdk_inputs", ctypes.POINTER(real)),
            ("mdk_lifted", ctypes.POINTER(real)),
            ("mdk_last_qp", ctypes.POINTER(_qp(real))),
        ):
            getattr(self._library, name).restype = kind
        self.memory_numbers: int = self._library.mdk_memory(ctypes.byref(self._model))
        """as `mdk_memory`"""
        self._memory = (real * self.memory_numbers)()
        self._self = ctypes.create_string_buffer(self._library.mdk_size())
        self._call("mdk_init", ctypes.byref(self._model), self._memory)
        self._vectors = [(real * N_STATES)(), (real * N_INPUTS)(), (real * N_STATES)()]
        self.real = real
        self.constants, problem = constants, constants.problem
        self.memory_bytes = ctypes.sizeof(self._memory) + len(self._self)
        self.inputs: Array = as_array(self._call("mdk_inputs"), (problem.horizon, N_INPUTS))
        """(N, 3), the last plan that was solved"""
        self.psi: Array = as_array(self._call("mdk_lifted"), (constants.dynamics.n,))
        """(n,), the state that was lifted last, in the order of the C code"""
        qp = self._call("mdk_last_qp").contents
        nv = N_INPUTS * problem.knots
        vectors = "f v lower upper row_lower row_upper"
        self.qp: dict[str, Array] = {
            "H": as_array(qp.H, (nv, nv)),
            **{name: as_array(getattr(qp, name), (nv,)) for name in vectors.split()},
        }
        """arrays of `mdk_qp`; of H its Cholesky factor"""

    def _call(self, name: str, *arguments: Any) -> Any:
        return getattr(self._library, name)(self._self, *arguments)

    def observe(self, measured: VehicleState, applied: ControlInput) -> VehicleState:
        """As `mdk_observe`: the filtered state."""
        state, held, x_0 = self._vectors
        state[:], held[:] = measured, applied
        self._call("mdk_observe", state, held, x_0)
        return VehicleState(*x_0)

    def plan(
        self,
        x_0: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None,
        under_way: Sequence[ControlInput],
    ) -> SolveStatus:
        """As `mdk_plan`."""
        now, state = self._situation, self._vectors[0]
        state[:], now.curvature_per_m, now.path[:], now.previous[:] = (
            x_0,
            curvature_per_m,
            path,
            previous,
        )
        now.has_preview = preview is not None
        if preview is not None:
            now.preview[:] = preview
        now.n_under_way = len(under_way)
        for i, each in enumerate(under_way):
            now.under_way[i][:] = each
        return SolveStatus(self._call("mdk_plan", state, ctypes.byref(now)))

    def prepare(self) -> None:
        """As `mdk_prepare`."""
        self._call("mdk_prepare")

    def forget(self) -> None:
        """As `mdk_forget`."""
        self._call("mdk_forget")

    def discard_estimates(self) -> None:
        """As `mdk_discard_estimates`."""
        self._call("mdk_discard_estimates")

    def resume(self, previous: ControlInput) -> None:
        """As `mdk_resume`."""
        self._call("mdk_resume", self._of_input(previous))

    def assume_steady(
        self, state: VehicleState, curvature_per_m: float, applied: ControlInput
    ) -> None:
        """As `mdk_assume_steady`."""
        self._vectors[0][:] = state
        curvature = self.real(curvature_per_m)
        self._call("mdk_assume_steady", self._vectors[0], curvature, self._of_input(applied))

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """As `mdk_limit_steering`."""
        self._call("mdk_limit_steering", self.real(most_rad), self.real(rate_radps))

    @property
    def iterations(self) -> int:
        """Of the last QP."""
        return int(self._call("mdk_iterations"))

    def _of_input(self, control: ControlInput) -> Any:
        self._vectors[1][:] = control
        return self._vectors[1]


def to_c(value: Any, real: Real, kept: list[Any]) -> Any:
    """A value as C has it: a number, an array, a struct, or a pointer.

    A tuple of numbers is an array within its struct, a numpy array and a tuple of named tuples are
    behind a pointer, a named tuple is a struct. `kept` gets what has to stay in memory.
    """
    if value is None:
        return ctypes.c_void_p()
    if isinstance(value, np.ndarray):
        kinds = {"f8": real, "f4": ctypes.c_float, "i4": ctypes.c_int, "b1": ctypes.c_bool}
        kind = kinds[value.dtype.str[1:]]
        numbers = np.ascontiguousarray(value, dtype=kind)
        kept.append(numbers)
        return numbers.ctypes.data_as(ctypes.POINTER(kind))
    if isinstance(value, bool | int | float):
        numeric: dict[type, Any] = {bool: ctypes.c_bool, int: ctypes.c_int, float: real}
        return numeric[type(value)](value)
    if not hasattr(value, "_fields"):
        if isinstance(value[0], int | float):
            kind = real if isinstance(value[0], float) else ctypes.c_int
            return (kind * len(value))(*value)
        structs = [to_c(each, real, kept) for each in value]
        # Structs of the same fields have one layout, and C sees their bytes only.
        array = ctypes.create_string_buffer(b"".join(bytes(each) for each in structs))
        kept.append(array)
        return ctypes.cast(array, ctypes.c_void_p)
    parts = [to_c(each, real, kept) for each in value]
    fields = [(name, type(part)) for name, part in zip(value._fields, parts, strict=True)]
    struct: Any = type(type(value).__name__, (ctypes.Structure,), {"_fields_": fields})
    return struct(*parts)


def _situation(real: Real) -> ctypes.Structure:
    """An `mdk_situation`."""
    fields = [
        ("state", real * N_STATES),
        ("curvature_per_m", real),
        ("path", real * len(PathReference._fields)),
        ("preview", real * len(CurvaturePreview._fields)),
        ("has_preview", ctypes.c_bool),
        ("applied", real * N_INPUTS),
        ("previous", real * N_INPUTS),
        ("n_under_way", ctypes.c_int),
        ("under_way", real * N_INPUTS * MOST_UNDER_WAY),
    ]
    struct: Any = type("Situation", (ctypes.Structure,), {"_fields_": fields})
    found: ctypes.Structure = struct()
    return found


def _qp(real: Real) -> Any:
    """The beginning of `mdk_qp`."""
    arrays = ["H", "L_inverse", "f", "v", "lower", "upper", "row_lower", "row_upper"]
    fields = [("size", ctypes.c_int), *((name, ctypes.POINTER(real)) for name in arrays)]
    return type("Qp", (ctypes.Structure,), {"_fields_": fields})
