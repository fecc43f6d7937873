"""`translate`: one compiled function to C, for arguments of given types."""

import ast
from collections.abc import Sequence
from typing import Protocol

from sim_bridge.c_code.blocks import declarations_of, names_of, stale_counters
from sim_bridge.c_code.c_types import (
    Aggregate,
    ArrayType,
    CType,
    Scalar,
    declaration,
    has_array,
    spelling,
)
from sim_bridge.c_code.calls import Calls, Functions
from sim_bridge.c_code.expressions import Expressions, Program
from sim_bridge.c_code.function_code import FunctionCode
from sim_bridge.c_code.python_source import FunctionSource, body_of, docstring_of
from sim_bridge.c_code.refusal import refuse
from sim_bridge.c_code.scope import Findings, Scope
from sim_bridge.c_code.statements import INDENT, Statements
from sim_bridge.c_code.value import Value

_MOST_PASSES = 12


class Whole(Program, Functions, Protocol):
    """What a function needs from the whole program."""


def translate(
    source: FunctionSource,
    kinds: Sequence[CType],
    returned: CType | None,
    name: str,
    program: Whole,
) -> FunctionCode:
    """The function in C.

    Args:
        kinds: types of the parameters.
        returned: type of the result; None if the return statements decide it.
        name: of the function in C.

    Raises:
        UnsupportedCodeError: it uses something that has no translation.
    """
    body = body_of(source)
    parameters = dict(zip(source.parameters, kinds, strict=True))
    for stale in stale_counters(body):
        refuse(
            source.file,
            stale.node,
            f"the loop variable {stale.name} after its loop",
            "Assign it to another name inside the loop.",
        )
    declarations = declarations_of(body, set(parameters))
    local_names = names_of(body) | set(parameters)
    before = Findings()
    for _ in range(_MOST_PASSES):
        scope = Scope(source, local_names, before)
        for parameter, kind in parameters.items():
            is_pointer = isinstance(kind, Aggregate)
            scope.parameters[parameter] = Value(
                scope.c_name(parameter),
                kind,
                is_place=not is_pointer,
                is_pointer=is_pointer,
                is_lasting=is_pointer,
                roots=frozenset({parameter}) if has_array(kind) else frozenset(),
            )
        expressions = Expressions(scope, program, Calls(scope, program))
        lines = Statements(scope, expressions, declarations, returned).block(body, INDENT)
        found = scope.found
        for root in sorted(found.returned_roots - set(parameters)):
            found.storage.setdefault(root, 0)
        if found == before:
            break
        before = found
    else:
        refuse(
            source.file,
            source.tree,
            f"{source.name}, whose types do not settle",
            "Annotate its variables, or use one name for each type.",
        )
    result = found.returned or returned or Scalar.NOTHING
    arguments = [
        _parameter(kind, scope.c_name(parameter), parameter in found.written)
        for parameter, kind in parameters.items()
    ] + [f"double *{storage}" for storage in found.storage]
    read = {node.id for part in body for node in ast.walk(part) if isinstance(node, ast.Name)}
    unread = [f"{INDENT}(void){scope.c_name(name)};" for name in parameters if name not in read]
    return FunctionCode(
        name=name,
        signature=declaration(result, f"{name}({', '.join(arguments) or 'void'})"),
        body="\n".join([*unread, *lines]),
        comment=f"{source.module}.py, {source.name}: {docstring_of(source)}".rstrip(": "),
        kinds=tuple(kinds),
        returned=result,
        returned_roots=found.returned_roots,
        written=frozenset(found.written & set(parameters)),
        storage=dict(found.storage),
    )


def _parameter(kind: CType, name: str, is_written: bool) -> str:
    if isinstance(kind, Aggregate):
        return f"const {spelling(kind)} *{name}"
    if kind is ArrayType.VECTOR and not is_written:
        return f"const double *{name}"
    return declaration(kind, name)
