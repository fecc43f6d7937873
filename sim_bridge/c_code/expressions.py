"""`Expressions`: Python expressions to C."""

import ast
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, Protocol

from sim_bridge.c_code.c_types import (
    NUMBERS,
    ArrayType,
    CType,
    Scalar,
    StructType,
    TupleType,
    field_name,
    item_access,
    item_types,
    spelling,
    unified,
)
from sim_bridge.c_code.calls import Calls
from sim_bridge.c_code.operators import Operators
from sim_bridge.c_code.scope import Scope
from sim_bridge.c_code.subscripts import Subscripts
from sim_bridge.c_code.value import Value, as_object, member, number


class Program(Protocol):
    """What an expression needs from the whole program."""

    def constant(self, name: str, value: Any, module: str) -> Value | None:
        """A global constant under its name in C; None if it cannot be one."""
        ...

    def note_type(self, kind: CType) -> None:
        """Note that the code needs the definition of a type."""
        ...

    def item_reader(self, kind: StructType) -> str:
        """Name of the function that reads a field by its position."""
        ...


class Expressions:
    """Translates the expressions of one function."""

    def __init__(self, scope: Scope, program: Program, calls: Calls) -> None:
        self._scope = scope
        self._program = program
        self._calls = calls
        self.subscripts = Subscripts(scope, program, self)
        operators = Operators(scope, self)
        self._translations: dict[type[ast.expr], Callable[[Any, CType | None], Value]] = {
            ast.Constant: self._constant,
            ast.Name: self._name,
            ast.Attribute: self._attribute,
            ast.Subscript: lambda node, _: self.subscripts.value(node),
            ast.BinOp: lambda node, _: operators.arithmetic(node),
            ast.UnaryOp: lambda node, _: operators.unary(node),
            ast.Compare: lambda node, _: operators.comparison(node),
            ast.BoolOp: lambda node, _: operators.boolean(node),
            ast.IfExp: operators.choice,
            ast.Tuple: self._tuple,
            ast.Call: lambda node, _: self._calls.value(node, self),
        }

    def value(self, node: ast.expr, expected: CType | None = None) -> Value:
        """The translation of an expression; `expected` is the type that its place asks for.

        Raises:
            UnsupportedCodeError: it has none.
        """
        translate = self._translations.get(type(node))
        if translate is None:
            self._scope.refuse(
                node,
                f"an expression of the kind {type(node).__name__}",
                "Use numbers, names, fields, indices, + - * / // % **, comparisons, and/or/not, "
                "x if c else y, tuples and calls.",
            )
        return translate(node, expected)

    def condition(self, node: ast.expr) -> Value:
        """A truth value."""
        value = self.value(node)
        if value.kind not in NUMBERS:
            self._scope.refuse(node, f"a condition of type {spelling(value.kind)}", "Compare it.")
        return value

    def writes(self, node: ast.expr) -> bool:
        """True if a call inside writes to an array."""
        return self._calls.writes(node)

    def in_order(
        self, nodes: Sequence[ast.expr], expected: Sequence[CType | None] | None = None
    ) -> list[Value]:
        """Several values, evaluated from left to right as Python does.

        C does not fix an order. It matters only where a call writes to an array; then every value
        gets a variable.
        """
        wanted = expected or [None] * len(nodes)
        writes = any(self._calls.writes(node) for node in nodes)
        values = []
        for node, kind in zip(nodes, wanted, strict=True):
            value = self.value(node, kind)
            if writes and value.constant is None and not value.is_lasting:
                value = self._scope.temporary(node, value, "value")
            values.append(value)
        return values

    def global_object(self, node: ast.expr) -> Any:
        """The Python object that a name or dotted name refers to; None if it is a local one."""
        if isinstance(node, ast.Name) and node.id not in self._scope.local_names:
            names = self._scope.source.names
            if node.id in names:
                return names[node.id]
            builtins = names["__builtins__"]
            table = vars(builtins) if isinstance(builtins, ModuleType) else builtins
            return table.get(node.id)
        if isinstance(node, ast.Attribute):
            owner = self.global_object(node.value)
            return None if owner is None else getattr(owner, node.attr, None)
        return None

    def literal(self, kind: TupleType | StructType, items: Sequence[Value]) -> Value:
        """A tuple or struct of the given items."""
        codes = [as_object(item) for item in items]
        if isinstance(kind, StructType):
            named = zip(kind.fields, codes, strict=True)
            inside = ", ".join(f".{field_name(name)} = {code}" for (name, _), code in named)
        else:
            inside = ", ".join(codes)
            inside = f"{{{inside}}}" if kind.is_uniform else inside
        roots = frozenset[str]().union(*(item.roots for item in items))
        self._scope.mark_written(roots)
        self._program.note_type(kind)
        return Value(f"({spelling(kind)}){{{inside}}}", kind, roots=roots)

    def array_length(self, node: ast.expr) -> Value:
        """The length of a new array."""
        size = self.value(node)
        if size.kind is not Scalar.INTEGER or size.constant is None:
            self._scope.refuse(
                node,
                "an array whose length is computed",
                "Use a whole number or a constant of a module.",
            )
        return size

    def items(self, value: Value) -> list[Value]:
        """The items of a tuple or named tuple that has a name."""
        kind = value.kind
        assert isinstance(kind, TupleType | StructType)
        return [
            value.part(member(value, item_access(kind, i)), item)
            for i, item in enumerate(item_types(kind))
        ]

    def _constant(self, node: ast.Constant, expected: CType | None) -> Value:
        if not isinstance(node.value, bool | int | float):
            self._scope.refuse(node, f"{node.value!r}", "Constants are numbers.")
        if expected is Scalar.DOUBLE and type(node.value) is int:
            return number(float(node.value))
        return number(node.value)

    def _name(self, node: ast.Name, expected: CType | None) -> Value:
        if node.id in self._scope.local_names:
            return self._scope.variable(node)
        return self._global(node, node.id, self.global_object(node))

    def _global(self, node: ast.AST, name: str, found: Any) -> Value:
        value = self._program.constant(name, found, self._scope.source.module)
        if value is None:
            self._scope.refuse(
                node,
                f"{name}, a {type(found).__name__}",
                "Constants are numbers, tuples and named tuples of them; pass anything else as an "
                "argument.",
            )
        return value

    def _attribute(self, node: ast.Attribute, expected: CType | None) -> Value:
        owner = self.global_object(node.value)
        if owner is not None:
            is_plain = isinstance(owner, ModuleType)
            name = node.attr if is_plain else ast.unparse(node).replace(".", "_")
            return self._global(node, name, getattr(owner, node.attr, None))
        value = self.value(node.value)
        if not isinstance(value.kind, StructType):
            what = "an array" if isinstance(value.kind, ArrayType) else spelling(value.kind)
            self._scope.refuse(
                node,
                f".{node.attr} of {what}",
                "Only named tuples have fields; of an array, a.shape[0] and a.shape[1] are known "
                "if it has two dimensions.",
            )
        kind = value.kind.field(node.attr)
        if kind is None:
            self._scope.refuse(
                node, f"no field {node.attr} in {value.kind.name}", "Name one of its fields."
            )
        return value.part(member(value, field_name(node.attr)), kind)

    def _tuple(self, node: ast.Tuple, expected: CType | None) -> Value:
        wanted: Sequence[CType | None] = [None] * len(node.elts)
        if isinstance(expected, TupleType | StructType):
            of_place = item_types(expected)
            wanted = of_place if len(of_place) == len(node.elts) else wanted
        values = self.in_order(node.elts, wanted)
        items = [
            kind if kind is not None and unified(value.kind, kind) == kind else value.kind
            for value, kind in zip(values, wanted, strict=True)
        ]
        if expected is None and Scalar.DOUBLE in items:
            items = [Scalar.DOUBLE if kind is Scalar.INTEGER else kind for kind in items]
        return self.literal(TupleType(tuple(items)), values)
