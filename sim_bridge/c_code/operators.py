"""`Operators`: arithmetic, comparisons, conditions and choices."""

import ast
import operator
from collections.abc import Sequence
from typing import Protocol

from sim_bridge.c_code.c_types import NUMBERS, Aggregate, CType, Scalar, unified
from sim_bridge.c_code.scope import Scope
from sim_bridge.c_code.value import (
    ADD,
    AND,
    CHOICE,
    COMPARE,
    EQUAL,
    MULTIPLY,
    OR,
    UNARY,
    Value,
    as_object,
    number,
    operand,
)

_ARITHMETIC: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: ("+", ADD),
    ast.Sub: ("-", ADD),
    ast.Mult: ("*", MULTIPLY),
    ast.Div: ("/", MULTIPLY),
}
_ON_INTS = {"+": operator.add, "-": operator.sub, "*": operator.mul}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, int]] = {
    ast.Lt: ("<", COMPARE),
    ast.LtE: ("<=", COMPARE),
    ast.Gt: (">", COMPARE),
    ast.GtE: (">=", COMPARE),
    ast.Eq: ("==", EQUAL),
    ast.NotEq: ("!=", EQUAL),
}


class Operands(Protocol):
    """What an operator needs from the translation of expressions."""

    def value(self, node: ast.expr, expected: CType | None = None) -> Value:
        """The translation of an expression."""
        ...

    def condition(self, node: ast.expr) -> Value:
        """A truth value."""
        ...

    def in_order(self, nodes: Sequence[ast.expr]) -> list[Value]:
        """Several values, evaluated from left to right."""
        ...


class Operators:
    """Translates the operators of one function."""

    def __init__(self, scope: Scope, operands: Operands) -> None:
        self._scope = scope
        self._operands = operands

    def arithmetic(self, node: ast.BinOp) -> Value:
        """a + b and its like."""
        left, right = self._operands.in_order([node.left, node.right])
        if left.kind not in NUMBERS or right.kind not in NUMBERS:
            self._scope.refuse(
                node, "arithmetic of whole tuples or arrays", "Write it for each item."
            )
        if isinstance(node.op, ast.Pow):
            return self._power(node, left, right)
        is_int = Scalar.DOUBLE not in (left.kind, right.kind)
        kind = Scalar.INTEGER if is_int else Scalar.DOUBLE
        if isinstance(node.op, ast.Mod):
            return Value(f"py_mod{'_int' if is_int else ''}({left.code}, {right.code})", kind)
        if isinstance(node.op, ast.FloorDiv):
            if not is_int:
                self._scope.refuse(node, "// of floats", "Write floor(a / b).")
            return Value(f"py_floor_div({left.code}, {right.code})", kind)
        if type(node.op) not in _ARITHMETIC:
            self._scope.refuse(node, "an operator on bits or matrices", "Use + - * / // % **.")
        return self._plain(node.op, left, right, kind)

    def _plain(self, op: ast.operator, left: Value, right: Value, kind: Scalar) -> Value:
        sign, level = _ARITHMETIC[type(op)]
        left_code, right_code = operand(left, level), operand(right, level + 1)
        constant = None
        if kind is Scalar.INTEGER and sign == "/":
            kind, left_code = Scalar.DOUBLE, f"(double){operand(left, UNARY)}"
        elif kind is Scalar.INTEGER and left.constant is not None and right.constant is not None:
            constant = _ON_INTS[sign](int(left.constant), int(right.constant))
        return Value(f"{left_code} {sign} {right_code}", kind, level, constant)

    def _power(self, node: ast.BinOp, base: Value, exponent: Value) -> Value:
        if exponent.kind is Scalar.INTEGER and exponent.constant is not None:
            if base.kind is not Scalar.DOUBLE:
                self._scope.refuse(node, "a power of an int", "Write float(base) ** exponent.")
            return Value(f"py_power({base.code}, {exponent.code})", Scalar.DOUBLE)
        return Value(f"pow({base.code}, {exponent.code})", Scalar.DOUBLE)

    def unary(self, node: ast.UnaryOp) -> Value:
        """-a, +a, not a."""
        if isinstance(node.op, ast.Not):
            inner = self._operands.condition(node.operand)
            return Value(f"!{operand(inner, UNARY)}", Scalar.BOOLEAN, UNARY)
        value = self._operands.value(node.operand)
        if value.kind not in NUMBERS or isinstance(node.op, ast.Invert):
            self._scope.refuse(
                node, "a sign or ~ before something else than a number", "Use - with numbers."
            )
        if isinstance(node.op, ast.UAdd):
            return value
        if isinstance(node.operand, ast.Constant) and value.constant is not None:
            return number(-value.constant)
        kind = Scalar.INTEGER if value.kind is Scalar.BOOLEAN else value.kind
        constant = None if value.constant is None else -value.constant
        return Value(f"-{operand(value, UNARY + 1)}", kind, UNARY, constant)

    def comparison(self, node: ast.Compare) -> Value:
        """a < b, a < b <= c, a in (b, c)."""
        if len(node.ops) == 1 and isinstance(node.ops[0], ast.In | ast.NotIn):
            return self._membership(node, node.comparators[0])
        values = self._operands.in_order([node.left, *node.comparators])
        parts = []
        for sign_node, left, right in zip(node.ops, values, values[1:], strict=False):
            is_known = type(sign_node) in _COMPARISONS
            if not (is_known and left.kind in NUMBERS and right.kind in NUMBERS):
                self._scope.refuse(
                    node,
                    "a comparison of something else than numbers",
                    "Use < <= > >= == != between numbers.",
                )
            sign, level = _COMPARISONS[type(sign_node)]
            parts.append(f"{operand(left, level + 1)} {sign} {operand(right, level + 1)}")
        level = _COMPARISONS[type(node.ops[0])][1] if len(parts) == 1 else AND
        return Value(" && ".join(parts), Scalar.BOOLEAN, level)

    def _membership(self, node: ast.Compare, choices: ast.expr) -> Value:
        if not isinstance(choices, ast.Tuple | ast.Set | ast.List):
            self._scope.refuse(node, "`in` with a name", "Write the numbers: x in (1, 2).")
        sought, *values = self._operands.in_order([node.left, *choices.elts])
        if any(value.kind not in NUMBERS for value in (sought, *values)):
            self._scope.refuse(node, "`in` of something else than numbers", "Compare the items.")
        left = operand(sought, EQUAL + 1)
        parts = [f"{left} == {operand(value, EQUAL + 1)}" for value in values]
        code = Value(" || ".join(parts), Scalar.BOOLEAN, OR if len(parts) > 1 else EQUAL)
        if isinstance(node.ops[0], ast.NotIn):
            return Value(f"!({code.code})", Scalar.BOOLEAN, UNARY)
        return code

    def boolean(self, node: ast.BoolOp) -> Value:
        """a and b, a or b."""
        sign, level = ("&&", AND) if isinstance(node.op, ast.And) else ("||", OR)
        parts = []
        for i, part in enumerate(node.values):
            self._scope.conditions += 1 if i else 0
            value = self._operands.value(part)
            self._scope.conditions -= 1 if i else 0
            if value.kind is not Scalar.BOOLEAN:
                self._scope.refuse(
                    node,
                    "`and` or `or` of something else than conditions",
                    "Compare: `x > 0.0 and y`, or write `x if c else y`.",
                )
            # Parentheses between && and || for readers.
            is_same = isinstance(part, ast.BoolOp) and isinstance(part.op, type(node.op))
            parts.append(operand(value, level if is_same else EQUAL))
        return Value(f" {sign} ".join(parts), Scalar.BOOLEAN, level)

    def choice(self, node: ast.IfExp, expected: CType | None) -> Value:
        """a if c else b."""
        test = self._operands.condition(node.test)
        self._scope.conditions += 1
        yes = self._operands.value(node.body, expected)
        no = self._operands.value(node.orelse, expected)
        self._scope.conditions -= 1
        kind = unified(yes.kind, no.kind)
        if kind is None or (isinstance(kind, Aggregate) and yes.kind != no.kind):
            self._scope.refuse(node, "two results of different types", "Make them one type.")
        codes = []
        for value in (yes, no):
            if value.constant is not None and value.kind is Scalar.INTEGER is not kind:
                codes.append(number(float(value.constant)).code)
            else:
                whole = Value(as_object(value), value.kind, min(value.level, UNARY))
                codes.append(operand(whole, CHOICE + 1))
        code = f"{operand(test, CHOICE + 1)} ? {codes[0]} : {codes[1]}"
        return Value(code, kind, CHOICE, roots=yes.roots | no.roots)
