"""The constants of a control law as C source."""

from typing import Any

import numpy as np

from rt_controller.native.constants import Struct

_PER_LINE = 8
_KINDS = {"f8": "mdk_real", "f4": "float", "i4": "int", "b1": "bool"}


def model_source(constants: Struct, name: str) -> str:
    """A C file that defines `const mdk_model name`."""
    arrays: list[str] = []
    value = _initialiser(constants, "model", arrays)
    return "\n".join(
        ('#include "mdk_internal.h"', "", *arrays, f"const mdk_model {name} = {value};", "")
    )


def _initialiser(value: Any, name: str, arrays: list[str]) -> str:
    """The value as C initialises it; what is behind a pointer becomes an array in `arrays`."""
    if value is None:
        return "NULL"
    if isinstance(value, np.ndarray):
        kind = _KINDS[value.dtype.str[1:]]
        write = _float if kind == "float" else _number
        numbers = [write(each) for each in value.ravel().tolist()]
        numbers = numbers or ["0"]  # C has no empty arrays
        rows = (", ".join(numbers[i : i + _PER_LINE]) for i in range(0, len(numbers), _PER_LINE))
        arrays.append(f"static const {kind} {name}[] = {{\n    " + ",\n    ".join(rows) + "};\n")
        return name
    if hasattr(value, "__dict__"):
        parts = {
            field: _initialiser(v, f"{name}_{field}", arrays) for field, v in vars(value).items()
        }
        return "{" + ", ".join(f".{field} = {text}" for field, text in parts.items()) + "}"
    if not isinstance(value, tuple):
        return _number(value)
    text = ", ".join(_initialiser(each, f"{name}_{i}", arrays) for i, each in enumerate(value))
    if not hasattr(value[0], "__dict__"):
        return f"{{{text}}}"
    arrays.append(f"static const mdk_layer {name}[] = {{{text}}};\n")
    return name


def _float(value: float) -> str:
    digits = f"{value:.9g}"  # exact
    return f"{digits}f" if "." in digits or "e" in digits else f"{digits}.0f"


def _number(value: bool | int | float) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return str(value)
    return f"R({value!r})" if np.isfinite(value) else "INFINITY"
