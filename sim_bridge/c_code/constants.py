"""`Constants`: global numbers and tuples of the Python modules, defined once in C."""

from typing import Any

from sim_bridge.c_code.annotations import TypeReader, table_of
from sim_bridge.c_code.c_types import CType, Scalar, StructType, TupleType, declaration, item_types
from sim_bridge.c_code.value import Value, number

_LARGEST_ENUMERATOR = 2**31 - 1
_OF_C = frozenset({"NULL", "NAN", "INFINITY", "EOF", "BUFSIZ", "HUGE_VAL", "I", "M_PI"})


class Constants:
    """The constants that a program uses, by their names in C."""

    def __init__(self, types: TypeReader) -> None:
        self._types = types
        self._defined: dict[str, tuple[Any, CType]] = {}

    def value(self, name: str, constant: Any, module: str) -> Value | None:
        """A constant under its name in C; None if there is no such constant in C.

        The name of the module goes before it if another module has another value of that name.
        """
        constant = table_of(constant)
        kind = self._types.of_value(constant)
        if kind is None or kind is Scalar.NOTHING:
            return None
        plain = name.lstrip("_")
        for candidate in (plain, f"{module}_{plain}", f"{module}_{plain}_"):
            if candidate in _OF_C:
                continue
            known = self._defined.setdefault(candidate, (constant, kind))
            if known[1] == kind and repr(known[0]) == repr(constant):
                is_number = isinstance(kind, Scalar)
                return Value(
                    candidate,
                    kind,
                    constant=constant if is_number else None,
                    is_place=True,
                    is_lasting=not is_number,
                )
        return None

    def enumerators(self) -> str:
        """Whole numbers, which may be lengths of arrays; for the header."""
        lines = "".join(
            f"    {name} = {int(constant)},\n"
            for name, (constant, kind) in self._defined.items()
            if _is_enumerator(constant, kind)
        )
        return f"enum {{\n{lines}}};\n" if lines else ""

    def definitions(self) -> str:
        """All other constants, for the source file."""
        return "".join(
            f"static const {declaration(kind, name)} = {_initialiser(constant, kind)};\n"
            for name, (constant, kind) in self._defined.items()
            if not _is_enumerator(constant, kind)
        )


def _is_enumerator(constant: Any, kind: CType) -> bool:
    return kind is Scalar.INTEGER and abs(constant) <= _LARGEST_ENUMERATOR


def _initialiser(constant: Any, kind: CType) -> str:
    if not isinstance(kind, TupleType | StructType):
        return number(float(constant) if kind is Scalar.DOUBLE else constant).code
    items = zip(constant, item_types(kind), strict=True)
    inside = ", ".join(_initialiser(item, item_kind) for item, item_kind in items)
    is_array = isinstance(kind, TupleType) and kind.is_uniform
    return f"{{{{{inside}}}}}" if is_array else f"{{{inside}}}"
