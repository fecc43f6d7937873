"""The structs of `c/mdk.h` in memory, as C has them."""

import ctypes
from typing import Any

import numpy as np

from rt_controller.contract.signals import N_INPUTS, N_STATES, CurvaturePreview, PathReference
from rt_controller.control.mpc import MOST_UNDER_WAY

Real = type[ctypes.c_double] | type[ctypes.c_float]


def to_c(value: Any, real: Real, kept: list[Any]) -> Any:
    """A value of the constants as C has it: a number, an array, a struct, or a pointer.

    A tuple of numbers is an array within its struct; a numpy array and a tuple of structs are
    behind a pointer. `kept` gets what has to stay in memory.
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
    if isinstance(value, tuple):
        parts = [to_c(each, real, kept) for each in value]
        if not isinstance(parts[0], ctypes.Structure):
            return (type(parts[0]) * len(parts))(*(part.value for part in parts))
        # Structs of the same fields have one layout, and C sees their bytes only.
        array = ctypes.create_string_buffer(b"".join(map(bytes, parts)))
        kept.append(array)
        return ctypes.cast(array, ctypes.c_void_p)
    fields = {name: to_c(each, real, kept) for name, each in vars(value).items()}
    return struct(**{name: type(part) for name, part in fields.items()})(**fields)


def struct(**fields: Any) -> Any:
    """The type of a struct with fields of these types, in their order."""
    return type("Struct", (ctypes.Structure,), {"_fields_": list(fields.items())})


def situation(real: Real) -> Any:
    """The type `mdk_situation`."""
    return struct(
        state=real * N_STATES,
        curvature_per_m=real,
        path=real * len(PathReference._fields),
        preview=real * len(CurvaturePreview._fields),
        has_preview=ctypes.c_bool,
        applied=real * N_INPUTS,
        previous=real * N_INPUTS,
        n_under_way=ctypes.c_int,
        under_way=real * N_INPUTS * MOST_UNDER_WAY,
    )


def qp(real: Real) -> Any:
    """The type of the beginning of `mdk_qp`."""
    arrays = ("H", "L_inverse", "f", "v", "lower", "upper", "row_lower", "row_upper")
    return struct(size=ctypes.c_int, **dict.fromkeys(arrays, ctypes.POINTER(real)))
