"""`Assignments`: Python assignments to lines of C."""

import ast

import numpy as np

from sim_bridge.c_code.blocks import Declarations
from sim_bridge.c_code.c_types import (
    NUMBERS,
    Aggregate,
    ArrayType,
    Scalar,
    StructType,
    TupleType,
    declaration,
    has_array,
    spelling,
    unified,
)
from sim_bridge.c_code.expressions import Expressions
from sim_bridge.c_code.scope import Scope
from sim_bridge.c_code.value import MULTIPLY, Value, as_object, operand

_SIGNS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
}


class Assignments:
    """Translates the assignments of one function in one pass; lines come without indentation."""

    def __init__(self, scope: Scope, expressions: Expressions, declarations: Declarations) -> None:
        self._scope = scope
        self._expressions = expressions
        self._declarations = declarations

    def lines(self, node: ast.Assign, place: int) -> list[str]:
        """`a = b`; `place` is the id of the statement that may declare variables."""
        declared = self._declarations.by_assignment.get(place, set())
        if len(node.targets) > 1:
            return self._chain(node, declared)
        [target] = node.targets
        array = self._new_array(target, node.value)
        if array is not None:
            return array
        if isinstance(target, ast.Tuple):
            return self._unpacking(node, target, declared)
        if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            self._scope.refuse(node, "an assignment to a slice", "Use a loop over the indices.")
        expected = None
        if isinstance(target, ast.Name):
            expected = self._scope.before.types.get(target.id)
        return self._store(target, self._expressions.value(node.value, expected), declared)

    def _chain(self, node: ast.Assign, declared: set[str]) -> list[str]:
        if not all(isinstance(target, ast.Name) for target in node.targets):
            self._scope.refuse(node, "a chain of assignments to items", "Write one for each.")
        value = self._expressions.value(node.value)
        if value.kind not in NUMBERS:
            self._scope.refuse(node, "a chain of assignments of arrays", "Write one for each.")
        first = self._store(node.targets[-1], value, declared)
        name = node.targets[-1]
        rest = [
            self._store(target, self._expressions.value(_loaded(name)), declared)
            for target in node.targets[:-1]
        ]
        return [line for lines in (first, *rest) for line in lines]

    def _unpacking(self, node: ast.Assign, target: ast.Tuple, declared: set[str]) -> list[str]:
        value_node = node.value
        if isinstance(value_node, ast.Tuple) and len(value_node.elts) == len(target.elts):
            values = self._expressions.in_order(value_node.elts)
            assigned = {t.id for t in target.elts if isinstance(t, ast.Name)}
            is_read = any(
                isinstance(part, ast.Name) and part.id in assigned for part in ast.walk(value_node)
            )
            if is_read or any(isinstance(t, ast.Subscript) for t in target.elts):
                values = [
                    value
                    if value.constant is not None
                    else self._scope.temporary(node, value, "value")
                    for value in values
                ]
        else:
            value = self._expressions.value(value_node)
            if not isinstance(value.kind, TupleType | StructType):
                self._scope.refuse(node, "an array on the right of several names", "Index it.")
            if not (value.is_place or value.is_pointer):
                value = self._scope.temporary(node, value, "result")
            values = self._expressions.items(value)
        if len(values) != len(target.elts) or any(isinstance(t, ast.Tuple) for t in target.elts):
            self._scope.refuse(
                node,
                f"{len(values)} values for {len(target.elts)} names",
                "Give one name for each.",
            )
        return [
            line
            for item, value in zip(target.elts, values, strict=True)
            for line in self._store(item, value, declared)
        ]

    def _store(self, target: ast.expr, value: Value, declared: set[str]) -> list[str]:
        if isinstance(target, ast.Subscript):
            return self._store_item(target, value)
        if not isinstance(target, ast.Name):
            self._scope.refuse(target, "an assignment to a field", "Make a new named tuple.")
        name = target.id
        if name in self._scope.parameters and value.kind not in NUMBERS:
            self._scope.refuse(target, f"a new value for the parameter {name}", "Use another name.")
        if name not in self._scope.parameters:
            self._scope.bind(target, name, value)
        variable = self._scope.c_name(name)
        if has_array(value.kind):
            self._scope.mark_written(value.roots)
        if name not in declared:
            is_array = isinstance(value.kind, ArrayType)
            if is_array and name not in self._declarations.assigned_once:
                self._scope.refuse(target, f"a second array for {name}", "Use another name.")
            return [f"{variable} = {as_object(value)};"]
        is_constant = name in self._declarations.constants
        if isinstance(value.kind, Aggregate) and is_constant and value.is_lasting:
            self._scope.found.pointers.add(name)
            kind = spelling(value.kind)
            code = value.code if value.is_pointer else f"&{value.code}"
            return [f"const {kind} *const {variable} = {code};"]
        kind_of_name = self._scope.found.types[name]
        const = "const " if is_constant and kind_of_name is not ArrayType.VECTOR else ""
        return [f"{const}{declaration(kind_of_name, variable)} = {as_object(value)};"]

    def _store_item(self, target: ast.Subscript, value: Value) -> list[str]:
        if self._expressions.writes(target):
            self._scope.refuse(
                target,
                "an index with a call that writes to an array",
                "Assign its result to a variable first.",
            )
        array = self._expressions.value(target.value)
        if not isinstance(array.kind, ArrayType):
            self._scope.refuse(target, "an assignment to an item of a tuple", "Make a new tuple.")
        self._scope.mark_written(array.roots)
        place = self._expressions.subscripts.element(target, array)
        if place.kind is not Scalar.DOUBLE or value.kind not in NUMBERS:
            self._scope.refuse(
                target, "an assignment of a whole row", "Use a loop over the columns."
            )
        return [f"{place.code} = {value.code};"]

    def _new_array(self, target: ast.expr, node: ast.expr) -> list[str] | None:
        """Lines for `x = np.zeros(n)` and its like; None if this is something else."""
        if not isinstance(node, ast.Call):
            return None
        maker = self._expressions.global_object(node.func)
        if maker not in (np.zeros, np.empty, np.array):
            return None
        name = target.id if isinstance(target, ast.Name) else ""
        if not name or self._scope.loops or len(node.args) != 1 or node.keywords:
            self._scope.refuse(
                node,
                "a new array in a loop, in a part of an expression, or with a type",
                "Write `name = np.zeros(length)` before the loop; arrays hold floats.",
            )
        if name not in self._declarations.assigned_once:
            self._scope.refuse(node, f"a second array for {name}", "Use another name.")
        [content] = node.args
        if maker is np.array:
            return self._filled_array(target, name, content)
        if isinstance(content, ast.Tuple) and len(content.elts) == 2:
            return self._new_matrix(target, name, content, maker is np.zeros)
        size = self._expressions.array_length(content)
        self._bind_array(target, name, ArrayType.VECTOR)
        return self._scope.new_array(self._scope.c_name(name), size, maker is np.zeros)

    def _filled_array(self, target: ast.expr, name: str, content: ast.expr) -> list[str]:
        if not isinstance(content, ast.Tuple | ast.List):
            self._scope.refuse(
                content, "np.array of something else than a row of numbers", "Write the numbers."
            )
        values = self._expressions.in_order(content.elts, [Scalar.DOUBLE] * len(content.elts))
        if any(value.kind is not Scalar.DOUBLE for value in values):
            self._scope.refuse(content, "np.array with ints or tuples", "Write floats: 1.0.")
        self._bind_array(target, name, ArrayType.VECTOR)
        variable = self._scope.c_name(name)
        if variable in self._scope.before.storage:
            self._scope.found.storage[variable] = len(values)
            return [f"{variable}[{i}] = {value.code};" for i, value in enumerate(values)]
        inside = ", ".join(value.code for value in values)
        return [f"double {variable}[{len(values)}] = {{{inside}}};"]

    def _new_matrix(
        self, target: ast.expr, name: str, shape: ast.Tuple, is_zero: bool
    ) -> list[str]:
        rows, columns = (self._expressions.array_length(part) for part in shape.elts)
        self._bind_array(target, name, ArrayType.MATRIX)
        if self._scope.c_name(name) in self._scope.before.storage:
            self._scope.refuse(
                target,
                "a returned array of two dimensions",
                "Let the caller make it and pass it as an argument.",
            )
        variable = self._scope.c_name(name)
        start = " = {0.0}" if is_zero else ""
        size = f"{operand(rows, MULTIPLY)} * {operand(columns, MULTIPLY)}"
        return [
            f"double {variable}_data[{size}]{start};",
            f"const Matrix {variable} = {{{variable}_data, {rows.code}, {columns.code}}};",
        ]

    def _bind_array(self, target: ast.expr, name: str, kind: ArrayType) -> None:
        self._scope.bind(
            target, name, Value(name, kind, roots=frozenset({self._scope.c_name(name)}))
        )

    def with_operator(self, node: ast.AugAssign) -> list[str]:
        """`a += b`."""
        if self._expressions.writes(node.value):
            self._scope.refuse(
                node,
                "an operator with a call that writes to an array",
                "Assign its result to a variable first.",
            )
        value = self._expressions.value(node.value)
        old = self._expressions.value(_loaded(node.target))
        kind = unified(old.kind, value.kind)
        sign = _SIGNS.get(type(node.op))
        is_int_division = sign == "/" and kind is not Scalar.DOUBLE
        if sign is None or kind not in (Scalar.DOUBLE, Scalar.INTEGER) or is_int_division:
            self._scope.refuse(
                node, "this assignment with an operator", "Write `x = x + y` with numbers."
            )
        if isinstance(node.target, ast.Subscript):
            array = self._expressions.value(node.target.value)
            if not isinstance(array.kind, ArrayType):
                self._scope.refuse(node, "a change of an item of a tuple", "Make a new tuple.")
            self._scope.mark_written(array.roots)
        elif isinstance(node.target, ast.Name) and node.target.id not in self._scope.parameters:
            self._scope.bind(node.target, node.target.id, value)
        return [f"{old.code} {sign}= {value.code};"]


def _loaded(node: ast.expr) -> ast.expr:
    """The same place, to be read."""
    if isinstance(node, ast.Name):
        return ast.copy_location(ast.Name(node.id, ast.Load()), node)
    return node
