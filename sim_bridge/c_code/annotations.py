"""`TypeReader`: the C types of annotations and of values."""

import ast
import types
import typing
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_bridge.c_code.c_types import CType, Scalar, StructType, TupleType
from sim_bridge.c_code.refusal import refuse

_SCALARS: dict[Any, Scalar] = {
    float: Scalar.DOUBLE,
    int: Scalar.INTEGER,
    bool: Scalar.BOOLEAN,
    None: Scalar.NOTHING,
    type(None): Scalar.NOTHING,
}
_VALUES = {bool: Scalar.BOOLEAN, int: Scalar.INTEGER, float: Scalar.DOUBLE}
"""in this order: True is an int too"""
_ALIAS = (typing.TypeAliasType,) if hasattr(typing, "TypeAliasType") else (types.NoneType,)


def is_named_tuple(kind: Any) -> bool:
    """True for a class made with `NamedTuple`."""
    return isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")


class TypeReader:
    """Reads types.

    Some annotations leave a type open, as for numba: an array may have one or two dimensions, a
    tuple any length, and a named tuple of such fields has as many structs as it is used with.
    """

    def __init__(self, example: Any) -> None:
        """Learn the structs of a named tuple with its lengths, such as a car's parameters."""
        self._variants: dict[type, list[StructType]] = {}
        self._names: dict[str, type] = {}
        self.of_value(example)

    def of_annotation(self, kind: Any, file: str, node: ast.AST | None = None) -> CType | None:
        """The type; None where it is open.

        Raises:
            UnsupportedCodeError: there is no such type in C.
        """
        kind = _plain(kind)
        if kind in _SCALARS:
            return _SCALARS[kind]
        if is_named_tuple(kind):
            fields = self.fields_of(kind)
            is_open = any(field is None for _, field in fields)
            return None if is_open else self.struct(kind, [f for _, f in fields if f is not None])
        origin, arguments = typing.get_origin(kind), typing.get_args(kind)
        if origin not in (np.ndarray, tuple):
            refuse(
                file,
                node,
                f"a value of type {kind}",
                "Use float, int, bool, Array, tuples and named tuples of them.",
            )
        if origin is np.ndarray or not arguments or arguments[-1] is Ellipsis:
            return None
        items = [self.of_annotation(item, file, node) for item in arguments]
        known = tuple(item for item in items if item is not None)
        return TupleType(known) if len(known) == len(items) else None

    def fields_of(self, kind: type) -> list[tuple[str, CType | None]]:
        """Names and types of the fields of a named tuple; None where a type is open."""
        hints = typing.get_type_hints(kind)
        names: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
        return [(name, self.of_annotation(hints[name], kind.__module__)) for name in names]

    def struct(self, kind: type, field_types: Sequence[CType]) -> StructType:
        """The struct of a named tuple with fields of these types."""
        names: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
        fields = tuple(zip(names, field_types, strict=True))
        variants = self._variants.setdefault(kind, [])
        for variant in variants:
            if variant.fields == fields:
                return variant
        suffix = f"_{len(variants) + 1}" if variants else ""
        variants.append(StructType(f"{self._name_of(kind)}{suffix}", fields))
        return variants[-1]

    def only_struct(self, kind: Any) -> StructType | None:
        """The struct of a named tuple if it has one only."""
        variants = self._variants.get(kind, [])
        return variants[0] if len(variants) == 1 else None

    def of_value(self, value: Any) -> CType | None:
        """The type of a Python value; None if it has none in C. An array counts as a table."""
        value = table_of(value)
        for python, scalar in _VALUES.items():
            if isinstance(value, python):
                return scalar
        if not isinstance(value, tuple) or not value:
            return None
        items = [self.of_value(item) for item in value]
        known = [item for item in items if item is not None]
        if len(known) != len(items):
            return None
        if not is_named_tuple(type(value)):
            return TupleType(tuple(known))
        annotated = [field for _, field in self.fields_of(type(value))]
        return self.struct(
            type(value), [a or _with_floats(k) for a, k in zip(annotated, known, strict=True)]
        )

    def _name_of(self, kind: type) -> str:
        taken = self._names.setdefault(kind.__name__, kind)
        if taken is kind:
            return kind.__name__
        return f"{kind.__module__.rpartition('.')[2].title().replace('_', '')}{kind.__name__}"


def table_of(value: Any) -> Any:
    """An array as nested tuples; anything else as it is."""
    if not isinstance(value, np.ndarray) or value.dtype != np.float64:
        return value
    return tuple(table_of(row) for row in value) if value.ndim > 1 else tuple(value.tolist())


def _plain(kind: Any) -> Any:
    """Without `Annotated` and type aliases."""
    while typing.get_origin(kind) is typing.Annotated:
        kind = typing.get_args(kind)[0]
    return getattr(kind, "__value__", kind) if isinstance(kind, _ALIAS) else kind


def _with_floats(kind: CType) -> CType:
    """A table of a car file may hold 1 beside 0.5; all of its numbers are floats."""
    if isinstance(kind, TupleType):
        return TupleType(tuple(_with_floats(item) for item in kind.items))
    return Scalar.DOUBLE if kind is Scalar.INTEGER else kind
