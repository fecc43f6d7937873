"""Functions of `math`, numpy and Python that exist in C under another name.

A minimum, maximum or remainder of C differs from Python's; those are in `python_math.h`.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from sim_bridge.c_code.c_types import CType, Scalar, unified
from sim_bridge.c_code.value import EQUAL, UNARY, Value, number, operand

_EXTREMES = {min: "py_min", max: "py_max"}


class KnownFunction(NamedTuple):
    """A function of numbers: its name in C, its number of arguments, the type of its result."""

    name: str
    n_arguments: int
    returned: Scalar = Scalar.DOUBLE


_ONE = (
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "sinh",
    "cosh",
    "tanh",
    "exp",
    "expm1",
    "log",
    "log1p",
    "log10",
    "log2",
    "sqrt",
    "fabs",
)
_TWO = ("atan2", "hypot", "pow", "copysign", "fmod")
_NUMPY = {
    "arcsin": "asin",
    "arccos": "acos",
    "arctan": "atan",
    "arctan2": "atan2",
    "absolute": "fabs",
    "power": "pow",
    "floor": "floor",
    "ceil": "ceil",
}
"""numpy's names, where they differ from C's; its floor and ceil give floats"""


def _table() -> list[tuple[Any, KnownFunction]]:
    table = [(getattr(math, name), KnownFunction(name, 1)) for name in _ONE]
    table += [(getattr(math, name), KnownFunction(name, 2)) for name in _TWO]
    for name in ("floor", "ceil", "trunc"):
        table.append((getattr(math, name), KnownFunction(name, 1, Scalar.INTEGER)))
    for name in ("isfinite", "isnan", "isinf"):
        known = KnownFunction(f"(bool){name}", 1, Scalar.BOOLEAN)
        table += [(getattr(math, name), known), (getattr(np, name), known)]
    for name in _ONE:
        if isinstance(getattr(np, name, None), np.ufunc):
            table.append((getattr(np, name), KnownFunction(name, 1)))
    for name, in_c in _NUMPY.items():
        n_arguments = 2 if in_c in _TWO else 1
        table.append((getattr(np, name), KnownFunction(in_c, n_arguments)))
    table.append((np.hypot, KnownFunction("hypot", 2)))
    table.append((math.radians, KnownFunction("py_radians", 1)))
    table.append((math.degrees, KnownFunction("py_degrees", 1)))
    return table


_FUNCTIONS = _table()

NAMES_IN_C = frozenset(known.name.rpartition(")")[2] for _, known in _FUNCTIONS)


def _known_function(function: Any) -> KnownFunction | None:
    """The function in C; None if it has none."""
    for python, known in _FUNCTIONS:
        if python is function:
            return known
    return None


def call_of_numbers(called: Any, values: Sequence[Value]) -> Value | None:
    """A function of numbers; None if it is not known."""
    if called in _EXTREMES and len(values) > 1:
        return _extreme(_EXTREMES[called], values)
    if called in _CONVERSIONS and len(values) == 1:
        return _CONVERSIONS[called](values[0])
    if called is np.clip and len(values) == 3:
        number_, lower, upper = values
        return _extreme("py_min", [_extreme("py_max", [number_, lower]), upper])
    known = _known_function(called)
    if known is None or known.n_arguments != len(values):
        return None
    code = f"{known.name}({', '.join(value.code for value in values)})"
    return Value(f"py_int({code})" if known.returned is Scalar.INTEGER else code, known.returned)


def _to_float(value: Value) -> Value:
    if value.kind is Scalar.DOUBLE:
        return value
    if value.constant is not None and value.code.isdigit():
        return number(float(value.constant))
    return Value(f"(double){operand(value, UNARY)}", Scalar.DOUBLE, UNARY)


def _to_int(value: Value) -> Value:
    if value.kind is Scalar.INTEGER:
        return value
    if value.kind is Scalar.BOOLEAN:
        return Value(f"(int64_t){operand(value, UNARY)}", Scalar.INTEGER, UNARY)
    return Value(f"py_int({value.code})", Scalar.INTEGER)


def _to_bool(value: Value) -> Value:
    return Value(f"{operand(value, EQUAL + 1)} != 0", Scalar.BOOLEAN, EQUAL)


def _absolute(value: Value) -> Value:
    if value.kind is Scalar.DOUBLE:
        return Value(f"fabs({value.code})", Scalar.DOUBLE)
    return Value(f"py_abs_int({value.code})", Scalar.INTEGER)


def _rounded(value: Value) -> Value:
    """To the nearest whole number, half-way cases to the even one, as Python does."""
    if value.kind is Scalar.INTEGER:
        return value
    return Value(f"py_int(rint({value.code}))", Scalar.INTEGER)


_CONVERSIONS: dict[Any, Callable[[Value], Value]] = {
    float: _to_float,
    np.float64: _to_float,
    int: _to_int,
    bool: _to_bool,
    abs: _absolute,
    round: _rounded,
}


def _extreme(name: str, values: Sequence[Value]) -> Value:
    kind: CType | None = None
    for value in values:
        kind = unified(kind, value.kind)
    kind = Scalar.DOUBLE if kind is Scalar.DOUBLE else Scalar.INTEGER
    suffix = "" if kind is Scalar.DOUBLE else "_int"
    code = values[0].code
    for value in values[1:]:
        code = f"{name}{suffix}({code}, {value.code})"
    return Value(code, kind)
