"""Where the variables of a function are declared in C.

A variable of Python belongs to the whole function, one of C to its block. It is declared by its
first assignment if that stands in a block that contains all its uses, and otherwise before.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

_Path = tuple[int, ...]
"""blocks around a statement, outermost first: positions of the blocks in the order of the text"""


class Use(NamedTuple):
    """A place where a name is read or assigned."""

    name: str
    is_assignment: bool
    is_whole: bool
    """assigned with `=`, and not added to or counted by a loop"""
    path: _Path
    statement: ast.stmt
    ancestors: dict[_Path, int]
    """by block: id of the statement directly inside of it that contains the use"""


@dataclass(slots=True)
class Declarations:
    """Which statement declares which variables."""

    by_assignment: dict[int, set[str]] = field(default_factory=dict)
    """by the id of the assignment: the variables that it declares"""
    before: dict[int, list[str]] = field(default_factory=dict)
    """by the id of a statement: the variables that are declared before it"""
    constants: set[str] = field(default_factory=set)
    """variables with one assignment, which declares them"""
    assigned_once: set[str] = field(default_factory=set)
    assigned_parameters: set[str] = field(default_factory=set)


class StaleCounter(NamedTuple):
    """A loop variable that is read after its loop."""

    name: str
    node: ast.AST


def names_of(body: list[ast.stmt]) -> set[str]:
    """All names that are assigned in a function."""
    return {
        node.id
        for statement in body
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }


def declarations_of(body: list[ast.stmt], parameters: set[str]) -> Declarations:
    """Places for the declarations of all local variables."""
    uses = list(_uses(body, (), set()))
    loops = _loop_paths(body)
    result = Declarations(assigned_parameters=names_of(body) & parameters)
    for name in {use.name for use in uses} & names_of(body) - parameters:
        mine = [use for use in uses if use.name == name]
        _place(name, mine, loops, result)
    return result


def stale_counters(body: list[ast.stmt]) -> Iterator[StaleCounter]:
    """Loop variables that are read after their loop, where Python still has their last value."""
    counters: set[str] = set()
    for statement in body:
        yield from _stale(statement, counters)


def _place(name: str, uses: list[Use], loops: set[_Path], result: Declarations) -> None:
    common = uses[0].path
    for use in uses:
        common = _common(common, use.path)
    first = uses[0]
    assignments = [use for use in uses if use.is_assignment]
    if len(assignments) == 1:
        result.assigned_once.add(name)
    if first.is_whole and first.path == common:
        result.by_assignment.setdefault(id(first.statement), set()).add(name)
        if len(assignments) == 1:
            result.constants.add(name)
        return
    # Its value may come from the round before: the declaration must be outside of all loops.
    while any(common[: len(loop)] == loop for loop in loops):
        common = common[:-1]
    for use in uses:
        if use.path[: len(common)] == common:
            result.before.setdefault(use.ancestors[common], []).append(name)
            return


def _common(one: _Path, other: _Path) -> _Path:
    length = 0
    while length < min(len(one), len(other)) and one[length] == other[length]:
        length += 1
    return one[:length]


def _blocks_of(statement: ast.stmt) -> list[list[ast.stmt]]:
    blocks = []
    for name in ("body", "orelse"):
        block = getattr(statement, name, None)
        if isinstance(block, list) and block and isinstance(block[0], ast.stmt):
            blocks.append(block)
    return blocks


def _loop_paths(body: list[ast.stmt], path: _Path = ()) -> set[_Path]:
    found: set[_Path] = set()
    for statement in body:
        for block in _blocks_of(statement):
            inner = (*path, id(block))
            if isinstance(statement, ast.For | ast.While):
                found.add(inner)
            found |= _loop_paths(block, inner)
    return found


def _uses(
    body: list[ast.stmt],
    path: _Path,
    counters: set[str],
    ancestors: dict[_Path, int] | None = None,
) -> Iterator[Use]:
    for statement in body:
        mine = {**(ancestors or {}), path: id(statement)}
        for use in _own_uses(statement, counters):
            yield use._replace(path=path, ancestors=mine)
        inner = set(counters)
        if isinstance(statement, ast.For) and isinstance(statement.target, ast.Name):
            inner.add(statement.target.id)
        for block in _blocks_of(statement):
            yield from _uses(block, (*path, id(block)), inner, mine)


def _own_uses(statement: ast.stmt, counters: set[str]) -> Iterator[Use]:
    """Uses outside of inner blocks: what is read comes before what is assigned."""
    parts: list[ast.AST] = []
    for name, value in ast.iter_fields(statement):
        if name in ("body", "orelse") or (name == "target" and isinstance(statement, ast.For)):
            continue
        parts += [v for v in (value if isinstance(value, list) else [value]) if _is_node(v)]
    nodes = [node for part in parts for node in ast.walk(part) if isinstance(node, ast.Name)]
    nodes = [node for node in nodes if node.id not in counters]
    for node in nodes:
        if isinstance(node.ctx, ast.Load):
            yield Use(node.id, False, False, (), statement, {})
    is_whole = isinstance(statement, ast.Assign | ast.AnnAssign)
    for node in nodes:
        if isinstance(node.ctx, ast.Store):
            yield Use(node.id, True, is_whole, (), statement, {})


def _is_node(value: object) -> bool:
    return isinstance(value, ast.AST)


def _stale(statement: ast.stmt, counters: set[str]) -> Iterator[StaleCounter]:
    if isinstance(statement, ast.For) and isinstance(statement.target, ast.Name):
        inner = counters - {statement.target.id}
        for child in statement.body:
            yield from _stale(child, inner)
        counters |= inner | {statement.target.id}
        return
    for use in _own_uses(statement, set()):
        if not use.is_assignment and use.name in counters:
            yield StaleCounter(use.name, statement)
    for block in _blocks_of(statement):
        inner = set(counters)
        for child in block:
            yield from _stale(child, inner)
        counters |= inner
    for use in _own_uses(statement, set()):
        if use.is_whole:
            counters.discard(use.name)
