"""`Subscripts`: elements, rows and pieces of arrays; items of tuples."""

import ast
from typing import Protocol

from sim_bridge.c_code.c_types import (
    ArrayType,
    CType,
    Scalar,
    StructType,
    TupleType,
    item_access,
    item_types,
    spelling,
)
from sim_bridge.c_code.scope import Scope
from sim_bridge.c_code.value import ADD, MULTIPLY, PRIMARY, UNARY, Value, member, number, operand


class Readers(Protocol):
    """What an index needs from the whole program."""

    def item_reader(self, kind: StructType) -> str:
        """Name of the function that reads a field by its position."""
        ...


class Owners(Protocol):
    """What an index needs from the translation of expressions."""

    def value(self, node: ast.expr, expected: CType | None = None) -> Value:
        """The translation of an expression."""
        ...


class Subscripts:
    """Translates the indices of one function."""

    def __init__(self, scope: Scope, readers: Readers, owners: Owners) -> None:
        self._scope = scope
        self._readers = readers
        self._owners = owners

    def value(self, node: ast.Subscript) -> Value:
        """a[i], a[i, j], a[i:j], a.shape[0], tuple[i]."""
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            return self._length(node, node.value.value)
        owner = self._owners.value(node.value)
        if isinstance(owner.kind, ArrayType):
            return self.element(node, owner)
        if isinstance(node.slice, ast.Tuple):
            for index in node.slice.elts:
                owner = self._item(node, index, owner)
            return owner
        return self._item(node, node.slice, owner)

    def element(self, node: ast.Subscript, array: Value) -> Value:
        """An element of an array, a row of a matrix, or a piece of either."""
        if isinstance(node.slice, ast.Slice):
            return self._piece(node, node.slice, array)
        if isinstance(node.slice, ast.Tuple):
            return self._element_of_matrix(node, node.slice.elts, array)
        index = self._index(node.slice)
        if array.kind is ArrayType.MATRIX:
            step = f"{operand(index, MULTIPLY)} * {member(array, 'columns')}"
            code = f"{member(array, 'data')} + {step}"
            return Value(code, ArrayType.VECTOR, ADD, roots=array.roots)
        return Value(f"{operand(array, PRIMARY)}[{index.code}]", Scalar.DOUBLE, is_place=True)

    def _element_of_matrix(
        self, node: ast.Subscript, indices: list[ast.expr], array: Value
    ) -> Value:
        if array.kind is not ArrayType.MATRIX or len(indices) != 2:
            self._scope.refuse(node, "more indices than the array has", "Use one for each.")
        row, column = (self._index(index) for index in indices)
        place = f"{operand(row, MULTIPLY)} * {member(array, 'columns')} + {operand(column, ADD)}"
        return Value(f"{member(array, 'data')}[{place}]", Scalar.DOUBLE, is_place=True)

    def _length(self, node: ast.Subscript, owner: ast.expr) -> Value:
        array = self._owners.value(owner)
        index = self._owners.value(node.slice)
        kind = array.kind
        if array.kind is ArrayType.MATRIX and index.constant in (0, 1):
            side = "rows" if index.constant == 0 else "columns"
            return Value(member(array, side), Scalar.INTEGER)
        for _ in range(int(index.constant or 0)):
            kind = kind.items[0] if isinstance(kind, TupleType) else kind
        if not isinstance(kind, TupleType):
            self._scope.refuse(
                node, "the shape of an array of one dimension", "Pass its length as an argument."
            )
        return number(len(kind.items))

    def _index(self, node: ast.expr) -> Value:
        index = self._owners.value(node)
        if index.kind is not Scalar.INTEGER:
            self._scope.refuse(node, f"an index of type {spelling(index.kind)}", "Use int(...).")
        if index.constant is not None and index.constant < 0:
            self._scope.refuse(
                node, "an array index that counts from the end", "Count from the front."
            )
        return index

    def _piece(self, node: ast.Subscript, piece: ast.Slice, array: Value) -> Value:
        if piece.step is not None:
            self._scope.refuse(node, "a slice with a step", "Use a loop over the indices.")
        first = number(0) if piece.lower is None else self._index(piece.lower)
        if array.kind is ArrayType.VECTOR:
            code = f"{operand(array, ADD)} + {operand(first, MULTIPLY)}"
            return Value(code, ArrayType.VECTOR, ADD, roots=array.roots)
        end = Value(member(array, "rows"), Scalar.INTEGER)
        if piece.upper is not None:
            end = self._index(piece.upper)
        columns = member(array, "columns")
        data = f"{member(array, 'data')} + {operand(first, MULTIPLY)} * {columns}"
        rows = f"{operand(end, ADD)} - {operand(first, MULTIPLY)}"
        return Value(f"(Matrix){{{data}, {rows}, {columns}}}", ArrayType.MATRIX, roots=array.roots)

    def _item(self, node: ast.Subscript, position_node: ast.expr, owner: Value) -> Value:
        kind = owner.kind
        if not isinstance(kind, TupleType | StructType):
            self._scope.refuse(
                node, f"an index of a {spelling(kind)}", "Only arrays and tuples have items."
            )
        index = self._owners.value(position_node)
        kinds = item_types(kind)
        if index.kind is not Scalar.INTEGER:
            self._scope.refuse(node, "an index of a tuple that is no int", "Use int(...).")
        if index.constant is not None:
            position = int(index.constant) + (len(kinds) if index.constant < 0 else 0)
            if not 0 <= position < len(kinds):
                self._scope.refuse(
                    node, f"position {index.constant} of {len(kinds)}", "Use a smaller one."
                )
            return owner.part(member(owner, item_access(kind, position)), kinds[position])
        if not kind.is_uniform:
            self._scope.refuse(
                node,
                "a computed index of a tuple with items of several types",
                "Name the field.",
            )
        if isinstance(kind, TupleType):
            code = member(owner, f"at[py_position({index.code}, {len(kinds)})]")
            return owner.part(code, kinds[0])
        if not (owner.is_pointer or owner.is_place):
            self._scope.refuse(node, "an index of a result", "Assign it to a variable first.")
        address = owner.code if owner.is_pointer else f"&{operand(owner, UNARY)}"
        return Value(f"{self._readers.item_reader(kind)}({address}, {index.code})", kinds[0])
