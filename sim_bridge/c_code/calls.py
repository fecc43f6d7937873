"""`Calls`: calls of compiled functions, named tuples, functions of numbers, and new arrays."""

import ast
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from sim_bridge.c_code.annotations import is_named_tuple
from sim_bridge.c_code.c_types import (
    NUMBERS,
    Aggregate,
    ArrayType,
    CType,
    Scalar,
    StructType,
    TupleType,
    item_types,
    spelling,
    unified,
)
from sim_bridge.c_code.function_code import FunctionCode
from sim_bridge.c_code.known_functions import call_of_numbers
from sim_bridge.c_code.python_source import FunctionSource, is_compiled, source_of
from sim_bridge.c_code.scope import Scope
from sim_bridge.c_code.value import UNARY, Value, member, number, operand


class Arguments(Protocol):
    """What a call needs from the translation of expressions."""

    def value(self, node: ast.expr, expected: CType | None = None) -> Value:
        """The translation of an expression."""
        ...

    def in_order(
        self, nodes: Sequence[ast.expr], expected: Sequence[CType | None] | None = None
    ) -> list[Value]:
        """Several values, evaluated from left to right."""
        ...

    def global_object(self, node: ast.expr) -> Any:
        """The Python object that a name refers to; None if it is a local one."""
        ...

    def literal(self, kind: TupleType | StructType, items: Sequence[Value]) -> Value:
        """A tuple or struct of the given items."""
        ...

    def array_length(self, node: ast.expr) -> Value:
        """The length of a new array."""
        ...


class Functions(Protocol):
    """What a call needs from the whole program."""

    def function(self, kernel: Any, kinds: Sequence[CType]) -> FunctionCode:
        """The translation of a compiled function for arguments of these types."""
        ...

    def parameter_types(self, source: FunctionSource) -> list[CType | None]:
        """Types of the parameters; None where the argument decides."""
        ...

    def fields_of(self, kind: type) -> list[tuple[str, CType | None]]:
        """Names and types of the fields of a named tuple; None where a type is open."""
        ...

    def struct(self, kind: type, field_types: Sequence[CType]) -> StructType:
        """The struct of a named tuple with fields of these types."""
        ...


class Calls:
    """Translates the calls of one function."""

    def __init__(self, scope: Scope, functions: Functions) -> None:
        self._scope = scope
        self._functions = functions

    def writes(self, node: ast.expr) -> bool:
        """True if a call inside writes to an array, as far as the pass before found out."""
        places = self._scope.before.writing_calls
        return any(
            (part.lineno, part.col_offset) in places
            for part in ast.walk(node)
            if isinstance(part, ast.Call)
        )

    def value(self, node: ast.Call, arguments: Arguments) -> Value:
        """The translation of a call."""
        called = arguments.global_object(node.func)
        name = ast.unparse(node.func)
        if called is None:
            self._scope.refuse(
                node, f"a call of {name}", "Call functions of a module by their name."
            )
        if is_compiled(called):
            return self._compiled(node, called, arguments)
        if is_named_tuple(called):
            return self._named_tuple(node, called, arguments)
        if called in (np.zeros, np.empty, np.array):
            return self._new_array(node, called, arguments)
        if node.keywords:
            self._scope.refuse(node, f"named arguments of {name}", "Give them by position.")
        if called is len:
            return self._length(node, arguments)
        values = arguments.in_order(node.args)
        if called is np.interp:
            return self._interpolation(node, values)
        if any(value.kind not in NUMBERS for value in values):
            self._scope.refuse(
                node, f"{name}() of something else than numbers", "Write it for each item."
            )
        found = call_of_numbers(called, values)
        if found is None:
            self._scope.refuse(
                node,
                f"a call of {name} with {len(values)} arguments",
                "Decorate it with @compiled, or use a function of `math`.",
            )
        return found

    def _new_array(self, node: ast.Call, maker: Any, arguments: Arguments) -> Value:
        is_plain = len(node.args) == 1 and not isinstance(node.args[0], ast.Tuple | ast.List)
        if not is_plain or node.keywords or self._scope.loops or self._scope.conditions:
            self._scope.refuse(
                node,
                f"{ast.unparse(node)} in a loop or in a part of an expression",
                "Write `name = np.zeros(length)` before the loop; arrays hold floats.",
            )
        name = self._scope.fresh_name("array")
        size = arguments.array_length(node.args[0])
        self._scope.pending += self._scope.new_array(name, size, maker is np.zeros)
        return Value(name, ArrayType.VECTOR, is_lasting=True, roots=frozenset({name}))

    def _length(self, node: ast.Call, arguments: Arguments) -> Value:
        value = arguments.value(node.args[0]) if len(node.args) == 1 else None
        if value is not None and value.kind is ArrayType.MATRIX:
            return Value(member(value, "rows"), Scalar.INTEGER)
        if value is None or not isinstance(value.kind, TupleType | StructType):
            self._scope.refuse(
                node, "len() of an array of one dimension", "Pass its length as an argument."
            )
        return number(len(item_types(value.kind)))

    def _interpolation(self, node: ast.Call, values: Sequence[Value]) -> Value:
        tables = [value.kind for value in values[1:]]
        is_table = len(values) == 3 and tables[0] == tables[1] and values[0].kind in NUMBERS
        table = tables[0] if is_table else None
        if not isinstance(table, TupleType) or set(table.items) != {Scalar.DOUBLE}:
            self._scope.refuse(
                node,
                "np.interp of something else than a number and two tables of equal length",
                "Pass tuples of floats, or arrays of the parameters.",
            )
        xs, ys = (member(value, "at") for value in values[1:])
        code = f"py_interp({values[0].code}, {xs}, {ys}, {len(table.items)})"
        return Value(code, Scalar.DOUBLE)

    def _bound(
        self, node: ast.Call, names: Sequence[str], optional: set[str]
    ) -> dict[str, ast.expr]:
        """The arguments by the names of the parameters."""
        given = dict(zip(names, node.args, strict=False))
        for keyword in node.keywords:
            if keyword.arg is None or keyword.arg not in names or keyword.arg in given:
                self._scope.refuse(node, f"the argument {keyword.arg or '**'}", "Name each once.")
                continue
            given[keyword.arg] = keyword.value
        starred = any(isinstance(argument, ast.Starred) for argument in node.args)
        missing = [name for name in names if name not in given and name not in optional]
        if starred or missing or len(node.args) > len(names):
            self._scope.refuse(
                node,
                f"a call that does not fit the parameters ({', '.join(names)})",
                "Give one argument for each, without *.",
            )
        return given

    def _named_tuple(self, node: ast.Call, kind: Any, arguments: Arguments) -> Value:
        fields = self._functions.fields_of(kind)
        names = [name for name, _ in fields]
        defaults = kind._field_defaults
        given = self._bound(node, names, set(defaults))
        nodes = [given.get(name) or _constant(node, defaults[name]) for name in names]
        values = arguments.in_order(nodes, [field for _, field in fields])
        kinds = []
        for (name, field), value in zip(fields, values, strict=True):
            if field is not None and unified(value.kind, field) != field:
                self._scope.refuse(
                    node, f"{name} of type {spelling(value.kind)}", f"Give a {spelling(field)}."
                )
            kinds.append(field or value.kind)
        return arguments.literal(self._functions.struct(kind, kinds), values)

    def _compiled(self, node: ast.Call, kernel: Any, arguments: Arguments) -> Value:
        source = source_of(kernel)
        given = self._bound(node, source.parameters, set(source.defaults))
        wanted = self._functions.parameter_types(source)
        nodes = [
            given.get(name) or _constant(node, source.defaults[name]) for name in source.parameters
        ]
        values = arguments.in_order(nodes, wanted)
        kinds = [kind or value.kind for kind, value in zip(wanted, values, strict=True)]
        for name, value, kind in zip(source.parameters, values, kinds, strict=True):
            if unified(value.kind, kind) != kind or (
                isinstance(kind, Aggregate) and value.kind != kind
            ):
                self._scope.refuse(
                    node,
                    f"{name} of type {spelling(value.kind)}",
                    f"{source.name} takes a {spelling(kind)}.",
                )
        code = self._functions.function(kernel, kinds)
        self._scope.found.called.add(code.name)
        roots = dict(zip(source.parameters, (value.roots for value in values), strict=True))
        for parameter in code.written:
            self._scope.mark_written(roots.get(parameter, frozenset()))
        if code.written:
            self._scope.found.writing_calls.add((node.lineno, node.col_offset))
        passed = [self._argument(node, value) for value in values]
        returned = frozenset[str]()
        for name, size in code.storage.items():
            storage = self._scope.fresh_name(name)
            if storage in self._scope.before.storage:
                self._scope.found.storage[storage] = size
            else:
                self._scope.pending.append(f"double {storage}[{size}];")
            passed.append(storage)
            roots[name] = frozenset({storage})
        for name in code.returned_roots:
            returned |= roots[name]
        return Value(f"{code.name}({', '.join(passed)})", code.returned, roots=returned)

    def _argument(self, node: ast.AST, value: Value) -> str:
        if value.is_pointer or not isinstance(value.kind, Aggregate):
            return value.code
        is_literal = value.code.startswith("(") and value.code.endswith("}")
        if not (value.is_place or is_literal):
            value = self._scope.temporary(node, value, "value")
        return f"&{operand(value, UNARY)}"


def _constant(node: ast.Call, value: Any) -> ast.expr:
    """A default as an expression at the place of the call."""
    return ast.copy_location(ast.Constant(value), node)
