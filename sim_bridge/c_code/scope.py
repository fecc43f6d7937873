"""`Scope`: what one pass over a function knows and finds out.

A function is translated several times, until a pass finds nothing that the pass before did not:
the type of a variable may follow from a statement after its first use.
"""

import ast
from dataclasses import dataclass, field
from typing import NoReturn

from sim_bridge.c_code.c_types import KEYWORDS, ArrayType, CType, declaration, unified
from sim_bridge.c_code.known_functions import NAMES_IN_C
from sim_bridge.c_code.python_source import FunctionSource
from sim_bridge.c_code.refusal import refuse
from sim_bridge.c_code.value import Value


@dataclass(slots=True)
class Findings:
    """Results of a pass; those of the last pass are the input of the next one."""

    types: dict[str, CType] = field(default_factory=dict)
    roots: dict[str, frozenset[str]] = field(default_factory=dict)
    pointers: set[str] = field(default_factory=set)
    """local names that hold the address of a tuple or struct"""
    writing_calls: set[tuple[int, int]] = field(default_factory=set)
    """places of calls of functions that write to arrays"""
    written: set[str] = field(default_factory=set)
    """parameters and local arrays that are written to"""
    storage: dict[str, int] = field(default_factory=dict)
    """new arrays that the function returns, with their lengths: the caller owns their memory"""
    called: set[str] = field(default_factory=set)
    """names of the functions that are called, in C"""
    returned: CType | None = None
    returned_roots: frozenset[str] = frozenset()


class Scope:
    """Names, temporaries and pending statements of one pass."""

    def __init__(self, source: FunctionSource, local_names: set[str], before: Findings) -> None:
        self.source = source
        self.local_names = local_names
        self.before = before
        self.found = Findings(types=dict(before.types), storage=dict(before.storage))
        self.parameters: dict[str, Value] = {}
        self.pending: list[str] = []
        """statements that have to stand before the one that is being translated"""
        self.conditions = 0
        """above 0 inside an expression that is evaluated only under a condition"""
        self.loops = 0
        """above 0 inside a loop"""
        self._n_temporaries: dict[str, int] = {}
        self._c_names = _names_in_c(local_names, before.called)

    def refuse(self, node: ast.AST, found: str, remedy: str) -> NoReturn:
        """Raise an error for a piece of this function.

        Raises:
            UnsupportedCodeError: always.
        """
        refuse(self.source.file, node, found, remedy)

    def c_name(self, name: str) -> str:
        """Name of a local variable in C."""
        return self._c_names[name]

    def variable(self, node: ast.Name) -> Value:
        """A local variable or parameter."""
        if node.id in self.parameters:
            return self.parameters[node.id]
        kind = self.found.types.get(node.id)
        if kind is None:
            refuse(
                self.source.file,
                node,
                f"{node.id} before it has a value",
                "Assign it in a statement above.",
            )
        is_pointer = node.id in self.before.pointers
        return Value(
            self.c_name(node.id),
            kind,
            is_place=not is_pointer,
            is_pointer=is_pointer,
            is_lasting=is_pointer,
            roots=self.before.roots.get(node.id, frozenset()),
        )

    def bind(self, node: ast.AST, name: str, value: Value) -> None:
        """Note the type of a variable that gets a value."""
        kind = unified(self.found.types.get(name), value.kind)
        if kind is None:
            self.refuse(node, f"{name} with values of two types", "Use two names.")
        self.found.types[name] = kind
        self.found.roots[name] = self.found.roots.get(name, frozenset()) | value.roots

    def mark_written(self, roots: frozenset[str]) -> None:
        """Note that the memory behind these names is written to."""
        self.found.written |= roots

    def temporary(self, node: ast.AST, value: Value, stem: str) -> Value:
        """The value in a variable of its own, computed before the current statement."""
        if self.conditions:
            self.refuse(
                node,
                "a call inside a condition that needs a variable of its own",
                "Assign its result to a variable in a statement before.",
            )
        name = self.fresh_name(stem)
        const = "" if value.kind is ArrayType.VECTOR else "const "
        self.pending.append(f"{const}{declaration(value.kind, name)} = {value.code};")
        return Value(name, value.kind, is_place=True, is_lasting=True, roots=value.roots)

    def new_array(self, name: str, size: Value, is_zero: bool) -> list[str]:
        """Lines that make an array of a constant length: here, or in the caller's memory."""
        if name not in self.before.storage:
            return [f"double {name}[{size.code}]{' = {0.0}' if is_zero else ''};"]
        self.found.storage[name] = int(size.constant or 0)
        if not is_zero:
            return []
        return [f"for (int64_t i = 0; i < {size.code}; ++i) {{", f"    {name}[i] = 0.0;", "}"]

    def fresh_name(self, stem: str) -> str:
        """A name that no variable of the function has."""
        while True:
            self._n_temporaries[stem] = self._n_temporaries.get(stem, 0) + 1
            name = f"{stem}_{self._n_temporaries[stem]}"
            if name not in self._c_names.values():
                return name

    def take_pending(self) -> list[str]:
        """The pending statements; none are left."""
        taken, self.pending = self.pending, []
        return taken


def _names_in_c(local_names: set[str], called: set[str]) -> dict[str, str]:
    """A name in C for each local variable; none is a word of C or the name of a called function."""
    taken = KEYWORDS | NAMES_IN_C | called
    names: dict[str, str] = {}
    for name in sorted(local_names, key=lambda name: (name.startswith("_"), name)):
        plain = name.lstrip("_") or "unused"
        while plain in taken or plain.startswith("py_"):
            plain = f"{plain.removeprefix('py_')}_"
        names[name] = plain
        taken = taken | {plain}
    return names
