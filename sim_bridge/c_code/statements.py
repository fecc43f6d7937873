"""`Statements`: Python statements to lines of C."""

import ast
from collections.abc import Sequence

from sim_bridge.c_code.assignments import Assignments
from sim_bridge.c_code.blocks import Declarations
from sim_bridge.c_code.c_types import (
    CType,
    Scalar,
    TupleType,
    declaration,
    spelling,
    unified,
)
from sim_bridge.c_code.expressions import Expressions
from sim_bridge.c_code.scope import Scope
from sim_bridge.c_code.value import COMPARE, as_object, member, number, operand

INDENT = "    "


class Statements:
    """Translates the statements of one function in one pass."""

    def __init__(
        self,
        scope: Scope,
        expressions: Expressions,
        declarations: Declarations,
        returned: CType | None,
    ) -> None:
        self._scope = scope
        self._expressions = expressions
        self._assignments = Assignments(scope, expressions, declarations)
        self._declarations = declarations
        self._returned = returned

    def block(self, body: Sequence[ast.stmt], indent: str) -> list[str]:
        """Lines of a block.

        Raises:
            UnsupportedCodeError: a statement has no translation.
        """
        lines: list[str] = []
        for statement in body:
            lines += [
                f"{indent}{declaration(self._scope.before.types[name], self._scope.c_name(name))};"
                for name in self._declarations.before.get(id(statement), [])
                if name in self._scope.before.types
            ]
            own = self._statement(statement, indent)
            lines += [f"{indent}{line}" for line in self._scope.take_pending()]
            lines += own
        return lines

    def _statement(self, node: ast.stmt, indent: str) -> list[str]:
        match node:
            case ast.If():
                return self._if(node, indent)
            case ast.For():
                return self._for(node, indent)
            case ast.While():
                return self._while(node, indent)
            case _:
                return [f"{indent}{line}" for line in self._simple(node)]

    def _simple(self, node: ast.stmt) -> list[str]:
        """Lines of a statement without a block of its own, without indentation."""
        lines: list[str] = []
        match node:
            case ast.Assign():
                lines = self._assignments.lines(node, id(node))
            case ast.AnnAssign(value=ast.expr() as value, target=ast.Name() as target):
                plain = ast.copy_location(ast.Assign([target], value), node)
                lines = self._assignments.lines(plain, id(node))
            case ast.AugAssign():
                lines = self._assignments.with_operator(node)
            case ast.Return():
                lines = self._return(node)
            case ast.Expr(value=ast.Call() as call):
                lines = [f"{self._expressions.value(call).code};"]
            case ast.Break() | ast.Continue():
                lines = [f"{type(node).__name__.lower()};"]
            case ast.Pass():
                pass
            case _:
                self._scope.refuse(
                    node,
                    f"a statement of the kind {type(node).__name__}",
                    "Use assignments, if, for over range, while, break, continue, return and "
                    "calls.",
                )
        return lines

    def _return(self, node: ast.Return) -> list[str]:
        if node.value is None or (
            isinstance(node.value, ast.Constant) and node.value.value is None
        ):
            return ["return;"]
        value = self._expressions.value(node.value, self._returned)
        kind = unified(self._returned or self._scope.found.returned, value.kind)
        if kind is None or (self._returned is not None and kind != self._returned):
            self._scope.refuse(
                node,
                f"a result of type {spelling(value.kind)}",
                "Return what the annotation says, in every return.",
            )
        self._scope.found.returned = kind
        self._scope.found.returned_roots |= value.roots
        return [f"return {as_object(value)};"]

    def _if(self, node: ast.If, indent: str) -> list[str]:
        test = self._expressions.condition(node.test)
        before = [f"{indent}{line}" for line in self._scope.take_pending()]
        lines = [*before, f"{indent}if ({test.code}) {{"]
        lines += self.block(node.body, indent + INDENT)
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            inner = self.block(node.orelse, indent)
            if inner[0].startswith(f"{indent}if ("):
                return [*lines, f"{indent}}} else {inner[0].lstrip()}", *inner[1:]]
        if node.orelse:
            lines.append(f"{indent}}} else {{")
            lines += self.block(node.orelse, indent + INDENT)
        return [*lines, f"{indent}}}"]

    def _for(self, node: ast.For, indent: str) -> list[str]:
        if not isinstance(node.target, ast.Name) or node.orelse:
            self._scope.refuse(
                node, "a loop with several names or with else", "Loop with one name."
            )
        name = node.target.id
        self._require_not_assigned(node, name)
        call = node.iter
        if isinstance(call, ast.Call) and self._expressions.global_object(call.func) is range:
            head = self._range(node, call, self._scope.c_name(name))
            return self._loop(node, indent, (name, Scalar.INTEGER), head, [])
        items = self._expressions.value(call)
        kinds = items.kind.items if isinstance(items.kind, TupleType) else ()
        if len(set(kinds)) != 1:
            self._scope.refuse(
                node,
                "a loop over something else than range(...) or a tuple of items of one type",
                "Loop over range(...) and use an index.",
            )
        if not items.is_lasting:
            items = self._scope.temporary(node, items, "items")
        position = self._scope.fresh_name("position")
        head = f"int64_t {position} = 0; {position} < {len(kinds)}; ++{position}"
        item = member(items, f"at[{position}]")
        first = f"const {declaration(kinds[0], self._scope.c_name(name))} = {item};"
        return self._loop(node, indent, (name, kinds[0]), head, [first])

    def _loop(
        self, node: ast.For, indent: str, variable: tuple[str, CType], head: str, first: list[str]
    ) -> list[str]:
        """Lines of a loop; `variable` is the name and type of what changes from round to round."""
        lines = [f"{indent}{line}" for line in self._scope.take_pending()]
        lines.append(f"{indent}for ({head}) {{")
        lines += [f"{indent}{INDENT}{line}" for line in first]
        name, kind = variable
        outer = self._scope.found.types.get(name)
        self._scope.found.types[name] = kind
        self._scope.loops += 1
        lines += self.block(node.body, indent + INDENT)
        self._scope.loops -= 1
        if outer is not None:
            self._scope.found.types[name] = outer
        return [*lines, f"{indent}}}"]

    def _range(self, node: ast.For, call: ast.Call, name: str) -> str:
        """The head of a loop over a range."""
        values = self._expressions.in_order(call.args)
        if any(value.kind is not Scalar.INTEGER for value in values) or call.keywords:
            self._scope.refuse(node, "range() of floats", "Use ints.")
        first, last = (number(0), values[0]) if len(values) == 1 else values[:2]
        step = int((values[2] if len(values) == 3 else number(1)).constant or 0)
        if step == 0:
            self._scope.refuse(
                node, "a loop whose step is computed or 0", "Write the step as a number."
            )
        if last.constant is None and not self._is_fixed(call.args[min(len(values), 2) - 1]):
            last = self._scope.temporary(node, last, "end")
        sign = "<" if step > 0 else ">"
        change = {1: f"++{name}", -1: f"--{name}"}.get(step, f"{name} += {step}")
        end = operand(last, COMPARE + 1)
        return f"int64_t {name} = {first.code}; {name} {sign} {end}; {change}"

    def _is_fixed(self, node: ast.expr) -> bool:
        """True for a variable with one value only: Python evaluates the end of a range once."""
        if not isinstance(node, ast.Name):
            return False
        is_parameter = node.id in self._scope.parameters
        return node.id in self._declarations.constants or (
            is_parameter and node.id not in self._declarations.assigned_parameters
        )

    def _require_not_assigned(self, node: ast.For, name: str) -> None:
        for statement in node.body:
            for part in ast.walk(statement):
                if isinstance(part, ast.Name) and part.id == name and _is_store(part):
                    self._scope.refuse(
                        part, f"a new value for the loop variable {name}", "Use another name."
                    )

    def _while(self, node: ast.While, indent: str) -> list[str]:
        if node.orelse:
            self._scope.refuse(node, "else after while", "Use a variable.")
        test = self._expressions.condition(node.test)
        pending = self._scope.take_pending()
        self._scope.loops += 1
        inner = self.block(node.body, indent + INDENT)
        self._scope.loops -= 1
        if not pending:
            return [f"{indent}while ({test.code}) {{", *inner, f"{indent}}}"]
        return [
            f"{indent}for (;;) {{",
            *(f"{indent}{INDENT}{line}" for line in pending),
            f"{indent}{INDENT}if (!({test.code})) {{ break; }}",
            *inner,
            f"{indent}}}",
        ]


def _is_store(name: ast.Name) -> bool:
    return isinstance(name.ctx, ast.Store)
