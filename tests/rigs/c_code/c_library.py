"""Compiled functions translated to C, compiled with the C compiler, and called from Python."""

import ctypes
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from sim_bridge.c_code.c_types import ArrayType, CType, Scalar, StructType, TupleType, item_types
from sim_bridge.c_code.function_code import FunctionCode
from sim_bridge.c_code.program import CProgram
from sim_bridge.c_code.python_source import source_of
from sim_bridge.fmu_export.compiler import compile_library

_SCALARS = {
    Scalar.DOUBLE: ctypes.c_double,
    Scalar.INTEGER: ctypes.c_int64,
    Scalar.BOOLEAN: ctypes.c_bool,
    Scalar.NOTHING: None,
}
STRICT = ("-Wall", "-Wextra", "-Werror")
"""no warning is left"""


class Matrix(ctypes.Structure):
    _fields_ = [
        ("data", ctypes.c_void_p),
        ("rows", ctypes.c_int64),
        ("columns", ctypes.c_int64),
    ]


class CLibrary:
    """The functions of a program, by their Python originals."""

    def __init__(
        self,
        folder: Path,
        program: CProgram,
        codes: dict[Any, FunctionCode],
        flags: tuple[str, ...],
    ) -> None:
        self._codes = codes
        header = resources.files("sim_bridge") / "c_code" / "python_math.h"
        (folder / "python_math.h").write_text(header.read_text("utf-8"))
        (folder / "sample.h").write_text(program.header("sample"))
        (folder / "sample.c").write_text(program.source("sample"))
        library = folder / "sample.so"
        compile_library([folder / "sample.c"], library, ("-fvisibility=default", *flags))
        self._library = ctypes.CDLL(str(library))

    def kinds(self, kernel: Any) -> tuple[CType, ...]:
        """Types of the parameters of a function."""
        return self._codes[kernel].kinds

    def call(self, kernel: Any, *arguments: Any) -> Any:
        """The result of the C function; arrays are changed in place."""
        sizes = self._codes[kernel].storage.values()
        return self.call_with_storage(kernel, [np.full(n, np.nan) for n in sizes], *arguments)

    def call_with_storage(self, kernel: Any, storage: list[np.ndarray], *arguments: Any) -> Any:
        """The same, with memory for the arrays that the function makes and returns."""
        code = self._codes[kernel]
        function = getattr(self._library, code.name)
        function.restype = ctypes_of(code.returned)
        passed = [_passed(kind, value) for kind, value in zip(code.kinds, arguments, strict=True)]
        passed += [array.ctypes.data_as(ctypes.c_void_p) for array in storage]
        return _python(code.returned, function(*passed))


def build(
    folder: Path,
    calls: list[tuple[Any, tuple[Any, ...]]],
    example: Any = (),
    flags: tuple[str, ...] = STRICT,
) -> CLibrary:
    """A library of kernels, each given with the arguments of one call, which show open types."""
    program = CProgram(example)
    codes = {}
    for kernel, arguments in calls:
        names = source_of(kernel).parameters
        shown = dict(zip(names, arguments, strict=True))
        codes[kernel] = program.add(kernel, {k: _shown(program, v) for k, v in shown.items()})
    return CLibrary(folder, program, codes, flags)


@cache
def ctypes_of(kind: CType) -> Any:
    """The type of a value for ctypes."""
    if isinstance(kind, Scalar):
        return _SCALARS[kind]
    if kind is ArrayType.VECTOR:
        return ctypes.c_void_p
    if isinstance(kind, StructType):
        fields = [(name, ctypes_of(item)) for name, item in kind.fields]
        return type(kind.name, (ctypes.Structure,), {"_fields_": fields})
    if kind.is_uniform:
        fields = [("at", ctypes_of(kind.items[0]) * len(kind.items))]
    else:
        fields = [(f"item{i}", ctypes_of(item)) for i, item in enumerate(kind.items)]
    return type("Tuple", (ctypes.Structure,), {"_fields_": fields})


def flat(value: Any) -> list[float]:
    """All numbers of a nested tuple."""
    if isinstance(value, tuple):
        return [number for item in value for number in flat(item)]
    return [value]


def _shown(program: CProgram, value: Any) -> CType | None:
    if isinstance(value, np.ndarray):
        return ArrayType.VECTOR if value.ndim == 1 else ArrayType.MATRIX
    return program.type_of_value(value)


def _passed(kind: CType, value: Any) -> Any:
    if kind is ArrayType.VECTOR:
        return value.ctypes.data_as(ctypes.c_void_p)
    if kind is ArrayType.MATRIX:
        return Matrix(value.ctypes.data, *value.shape)
    if isinstance(kind, Scalar):
        return _SCALARS[kind](value)
    return ctypes.byref(value if isinstance(value, ctypes.Structure) else filled(kind, value))


def filled(kind: CType, value: Any) -> Any:
    """A value for ctypes."""
    if isinstance(kind, Scalar):
        return value
    inside = [filled(item, v) for item, v in zip(item_types(kind), value, strict=True)]
    made = ctypes_of(kind)
    if isinstance(kind, TupleType) and kind.is_uniform:
        return made(dict(made._fields_)["at"](*inside))
    return made(*inside)


def _python(kind: CType, value: Any) -> Any:
    if isinstance(kind, TupleType):
        if kind.is_uniform:
            return tuple(_python(kind.items[0], item) for item in value.at)
        return tuple(_python(k, getattr(value, f"item{i}")) for i, k in enumerate(kind.items))
    if isinstance(kind, StructType):
        return tuple(_python(k, getattr(value, name)) for name, k in kind.fields)
    return value
